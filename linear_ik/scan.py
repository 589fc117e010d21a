"""Scan: the measured points, in the scan's own coordinates."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]

FARTHEST_M = 1e8


@dataclass(frozen=True, eq=False)
class Scan:
    """Points of one or more scanner stations.

    Coordinates are metres in the scan's own frame (a site or map system, possibly
    hundreds of kilometres from its origin) and double precision throughout; whoever
    computes in single precision subtracts a local origin first.

    Attributes:
        points: [P][3] metres. Points with a coordinate that is not finite are dropped.
        normals: [P][3] unit vectors (zero where unknown), or None. Nothing says which side they point to.
        stations: [S][3] scanner positions in metres, or None.
        station_index: [P] row of ``stations`` that saw each point, or None.

    Raises:
        ScanError: no finite point is left, a coordinate beyond 1e8 m (no place on Earth has one,
            and its square would spoil sums of millions), or the arrays do not belong together.
    """

    points: Array
    normals: Array | None = None
    stations: Array | None = None
    station_index: npt.NDArray[np.int32] | None = None

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
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            points = points[finite]
            normals = None if normals is None else normals[finite]
            index = None if index is None else index[finite]
        if not len(points):
            raise ScanError("scan", "no point with finite coordinates", "at least one")
        farthest = max(points.max(), -points.min())
        if farthest > FARTHEST_M:
            raise ScanError("points", f"a coordinate of {farthest:.3g} m", f"at most {FARTHEST_M:g} m")
        values = (points, normals, stations, index)
        for name, value in zip(("points", "normals", "stations", "station_index"), values, strict=True):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)


def merge(scans: Iterable[Scan]) -> Scan:
    """Return several scans as one; stations keep their points.

    Normals are kept when every part has them, stations when every part has them. Stations at
    the same place are one. Parts that nobody else holds are freed on the way, so that the
    whole takes its own memory once.

    Raises:
        ScanError: nothing to merge.
    """
    parts = deque(scans)
    if not parts:
        raise ScanError("scan", "no files", "at least one")
    if len(parts) == 1:
        return parts[0]
    count = sum(map(len, parts))
    points = np.empty((count, 3))
    normals = np.empty((count, 3)) if all(s.normals is not None for s in parts) else None
    index = np.empty(count, dtype=np.int32) if all(s.stations is not None for s in parts) else None
    rows: dict[tuple[float, ...], int] = {}
    end = 0
    while parts:
        part = parts.popleft()
        start, end = end, end + len(part)
        points[start:end] = part.points
        if normals is not None:
            normals[start:end] = part.normals
        if index is not None and part.stations is not None:
            own = [rows.setdefault(tuple(station), len(rows)) for station in part.stations.tolist()]
            index[start:end] = np.array(own, dtype=np.int32)[part.station_index]
    return Scan(points, normals, np.array(list(rows)) if index is not None else None, index)


def _rows(name: str, value: npt.ArrayLike) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ScanError(name, "not numbers", "an array of shape [P][3]") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ScanError(name, f"shape {array.shape}", "[P][3]")
    return array
