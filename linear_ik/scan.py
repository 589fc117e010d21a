"""Scan: the measured points, in the scan's own coordinates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]

FARTHEST_M = 1e8


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """Points of one or more scanner stations.

    Coordinates are metres in the scan's own frame (a site or map system, possibly
    hundreds of kilometres from its origin) and double precision throughout; whoever
    computes in single precision subtracts a local origin first.

    Attributes:
        points: [P][3] metres. Points with a coordinate that is not finite, or beyond 1e8 m, are dropped.
        normals: [P][3] unit vectors (zero where unknown), or None. Nothing says which side they point to.
        stations: [S][3] scanner positions in metres, or None.
        station_index: [P] row of ``stations`` that saw each point, or None.
        left_out: how many points that are none came with these and were dropped, see `no_points`.

    Raises:
        ScanError: no finite point is left, most have a coordinate beyond 1e8 m (no place on Earth has
            one, and its square would spoil sums of millions), or the arrays do not belong together.
    """

    points: Array
    normals: Array | None = None
    stations: Array | None = None
    station_index: npt.NDArray[np.int32] | None = None
    left_out: int = 0

    def __post_init__(self) -> None:
        """Check the shapes and drop the points that are no points."""
        points = _rows("points", self.points)
        normals = None if self.normals is None else _rows("normals", self.normals)
        stations = None if self.stations is None else _rows("stations", self.stations)
        index = self.station_index
        if normals is not None and len(normals) != len(points):
            raise ScanError("normals", f"{len(normals)} rows", f"one a point: {len(points)}")
        if (stations is None) != (index is None):
            raise ScanError("stations", "given without station_index or the reverse", "both, or neither")
        if stations is not None and not np.isfinite(stations).all():
            raise ScanError("stations", "a position that is not finite", "metres")
        if index is not None and stations is not None:
            index = np.asarray(index, dtype=np.int32)
            if index.shape != (len(points),):
                raise ScanError("station_index", f"shape {index.shape}", f"one a point: {len(points)}")
            if len(index) and not (0 <= index.min() and index.max() < len(stations)):
                wrong = index.min() if index.min() < 0 else index.max()
                raise ScanError("station_index", f"value {wrong}", f"a row of stations, 0 to {len(stations) - 1}")
        strays = Strays()
        keep = strays.apart_from(points)
        if not keep.all():
            object.__setattr__(self, "left_out", self.left_out + int((~keep).sum()))
            points = points[keep]
            normals = None if normals is None else normals[keep]
            index = None if index is None else index[keep]
        strays.check()
        if not len(points):
            raise ScanError("scan", "no point with finite coordinates", "at least one")
        values = (points, normals, stations, index)
        for name, value in zip(("points", "normals", "stations", "station_index"), values, strict=True):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Say how much it is, not all of what."""
        stations = "unknown stations" if self.stations is None else f"{len(self.stations)} stations"
        return f"<Scan: {len(self)} points, {stations}, {'no ' if self.normals is None else ''}normals>"

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)


class Strays:
    """Points beyond 1e8 m: a few are left out; where most are so, the scan is not what it seems."""

    def __init__(self) -> None:
        """Begin with none."""
        self._used = self._beyond = 0
        self._farthest_m = 0.0

    def apart_from(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which of some points [P][3] are to be used: finite ones of up to 1e8 m."""
        # What is no number is no less than anything. Most clouds are sound, which two looks tell without a copy.
        if len(points) and max(points.max(), -points.min()) <= FARTHEST_M:
            self._used += len(points)
            return np.ones(len(points), dtype=bool)
        far_m = np.abs(points).max(axis=1)
        keep = np.asarray(far_m <= FARTHEST_M)
        beyond = far_m[~keep & np.isfinite(far_m)]
        self._used, self._beyond = self._used + int(keep.sum()), self._beyond + len(beyond)
        self._farthest_m = max(self._farthest_m, float(beyond.max(initial=0.0)))
        return keep

    def check(self) -> None:
        """Refuse the points so far where most of the finite ones are beyond.

        Raises:
            ScanError: they are.
        """
        if self._beyond > self._used:
            raise ScanError(
                "points",
                f"a coordinate of {self._farthest_m:.3g} m",
                f"at most {FARTHEST_M:g} m: is it in millimetres?",
            )


def merge(scans: Iterable[Scan]) -> Scan:
    """Return several scans as one; stations keep their points.

    Normals are kept when every part has them, stations when every part has them. Stations at
    the same place are one. Parts are taken one by one, so that what an iterator yields is in
    memory once, and not a second time as the whole.

    Raises:
        ScanError: nothing to merge.
    """
    parts = iter(scans)
    head = list(islice(parts, 2))
    if not head:
        raise ScanError("scan", "no files", "at least one")
    if len(head) == 1:
        return head[0]
    points, normals, index = np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int32)
    rows: dict[tuple[float, ...], int] = {}
    has_normals = has_stations = True
    left_out = 0
    for part in chain(head, parts):
        _append(points, part.points)
        left_out += part.left_out
        if has_normals := has_normals and part.normals is not None:
            _append(normals, part.normals)
        if has_stations := has_stations and part.stations is not None:
            own = [rows.setdefault(tuple(station), len(rows)) for station in part.stations.tolist()]
            _append(index, np.array(own, dtype=np.int32)[part.station_index])
    return Scan(
        points,
        normals if has_normals else None,
        np.array(list(rows)) if has_stations else None,
        index if has_stations else None,
        left_out,
    )


def no_points(count: int) -> str:
    """Return how a person is told of points that are left out."""
    return f"{count:,} point{'s' if count > 1 else ''} without usable coordinates, withheld or noise"


def _append(array: npt.NDArray[np.generic], rows: npt.NDArray[np.generic]) -> None:
    """Lengthen ``array`` in place: the system moves its pages instead of copying them."""
    start = len(array)
    array.resize((start + len(rows), *array.shape[1:]), refcheck=False)
    array[start:] = rows


def _rows(name: str, value: npt.ArrayLike) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ScanError(name, "not numbers", "an array of shape [P][3]") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ScanError(name, f"shape {array.shape}", "[P][3]")
    return array
