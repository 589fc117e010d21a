"""Thinning: at most one point a voxel, of a scan of any size, read piece by piece."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]

MOST_POINTS = 400_000
# Voxels each way from the first point; three of them make one 63-bit number.
REACH = 1 << 20


class Thinner:
    """Keeps the first point of every voxel; the voxels grow when they become too many.

    A real point, not the mean: between the two faces of a thin plate there is no steel.

    Attributes:
        voxel_m: edge of a voxel, as grown.
    """

    def __init__(self, voxel_m: float, most: int = MOST_POINTS) -> None:
        """Start with voxels of ``voxel_m``, and keep at most ``most`` points."""
        self.voxel_m = voxel_m
        self._most = most
        self._origin = np.full(3, np.nan)
        self._keys = np.empty(0, dtype=np.int64)
        self._points = np.empty((0, 3))

    def add(self, points: Array) -> None:
        """Take some points [P][3], metres."""
        if not len(points):
            return
        if np.isnan(self._origin).any():
            self._origin = np.floor(points[0])
        keys, near = self._keys_of(points)
        self._keep(np.concatenate([self._keys, keys]), np.concatenate([self._points, points[near]]))
        while len(self._points) > self._most:
            self.voxel_m *= 1.5
            keys, near = self._keys_of(self._points)
            self._keep(keys, self._points[near])

    def points(self) -> Array:
        """Return the points kept [P][3], metres.

        Raises:
            ScanError: there are none.
        """
        if not len(self._points):
            raise ScanError("scan", "no point with finite coordinates", "at least one")
        return self._points

    def _keys_of(self, points: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        cells = np.floor((points - self._origin) / self.voxel_m)
        near = np.asarray((np.abs(cells) < REACH).all(axis=1))
        x, y, z = (cells[near].astype(np.int64) + REACH).T
        return np.asarray((x << 42) | (y << 21) | z), near

    def _keep(self, keys: npt.NDArray[np.int64], points: Array) -> None:
        self._keys, first = np.unique(keys, return_index=True)
        self._points = points[first]


def thin(parts: Iterable[Array], voxel_m: float, most: int = MOST_POINTS) -> tuple[Array, float]:
    """Return some of the points of all parts [P][3], and the voxel they are one in.

    Raises:
        ScanError: no points.
    """
    thinner = Thinner(voxel_m, most)
    for part in parts:
        thinner.add(part)
    return thinner.points(), thinner.voxel_m
