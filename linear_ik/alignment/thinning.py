"""Thinning: at most one point a voxel, of a scan of any size, read piece by piece."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]

MOST_POINTS = 400_000
# Voxels each way from the middle of the first piece; three of them make one 63-bit number.
REACH = 1 << 20


class Thinner:
    """Keeps the first point of every voxel; the voxels grow when they become too many.

    A real point, not the mean: between the two faces of a thin plate there is no steel.

    Attributes:
        voxel_m: edge of a voxel, as grown.
        dropped: points too far from the middle of the first piece to be numbered: strays.
    """

    def __init__(self, voxel_m: float, most: int = MOST_POINTS) -> None:
        """Start with voxels of ``voxel_m``, and keep at most ``most`` points."""
        self.voxel_m = voxel_m
        self.dropped = 0
        self._taken = 0
        self._most = most
        self._origin = np.full(3, np.nan)
        self._keys = np.empty(0, dtype=np.int64)
        self._points = np.empty((0, 3))

    def add(self, points: Array) -> None:
        """Take some points [P][3 or more]: x, y, z in metres, and whatever goes along with each; always as many."""
        if not len(points):
            return
        if np.isnan(self._origin).any():
            # Not the first point: scanners write (0, 0, 0) for a pulse that did not come back.
            self._origin = np.floor(np.median(points[:, :3], axis=0))
            self._points = np.empty((0, points.shape[1]))
        keys, near = self._keys_of(points)
        self._taken += len(points)
        self.dropped += int((~near).sum())
        self._keep(np.concatenate([self._keys, keys]), np.concatenate([self._points, points[near]]))
        while len(self._points) > self._most:
            self.voxel_m *= 1.5
            keys, near = self._keys_of(self._points)
            self._keep(keys, self._points[near])

    def points(self) -> Array:
        """Return the points kept [P][3 or more], as they came.

        Raises:
            ScanError: there are none, or most lie too far from the first piece.
        """
        if 2 * self.dropped > self._taken:
            far = f"{self.dropped:,} of {self._taken:,} points lie more than {self.reach_km:.0f} km from the first ones"
            raise ScanError("scan", far, "a scan of one place")
        if not len(self._points):
            raise ScanError("scan", "no point with finite coordinates", "at least one")
        return self._points

    @property
    def reach_km(self) -> float:
        """How far from the middle of the first piece points are taken."""
        return REACH * self.voxel_m / 1000.0

    def _keys_of(self, points: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        # Voxels are counted from zero, so that they are the same wherever the origin of the numbers is.
        cells = np.floor(points[:, :3] / self.voxel_m) - np.floor(self._origin / self.voxel_m)
        near = np.asarray((np.abs(cells) < REACH).all(axis=1))
        x, y, z = (cells[near].astype(np.int64) + REACH).T
        return np.asarray((x << 42) | (y << 21) | z), near

    def _keep(self, keys: npt.NDArray[np.int64], points: Array) -> None:
        self._keys, first = np.unique(keys, return_index=True)
        self._points = points[first]


def thin(parts: Iterable[Array], voxel_m: float, most: int = MOST_POINTS) -> Thinner:
    """Return a thinner that has taken all parts [P][3 or more].

    Raises:
        ScanError: no points, or most lie too far from the first part.
    """
    thinner = Thinner(voxel_m, most)
    for part in parts:
        thinner.add(part)
    thinner.points()
    return thinner
