"""Scan: the measured points, in the scan's own coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scan:
    """Points of one or more scanner stations.

    Coordinates are metres in the scan's own frame (a site or map system, possibly
    hundreds of kilometres from its origin) and double precision throughout; whoever
    computes in single precision subtracts a local origin first.

    Attributes:
        points: [P][3] metres. Points with a coordinate that is not finite are dropped.
        normals: [P][3] unit vectors, or None. Nothing says which side they point to.
        stations: [S][3] scanner positions in metres, or None.
        station_index: [P] row of ``stations`` that saw each point, or None.

    Raises:
        ScanError: no finite point is left, or the arrays do not belong together.
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
        if index is not None and stations is not None:
            index = np.asarray(index, dtype=np.int32)
            if index.shape != (len(points),):
                raise ScanError("station_index", f"shape {index.shape}", f"one a point: {len(points)}")
            if len(index) and not (0 <= index.min() and index.max() < len(stations)):
                raise ScanError("station_index", f"value {index.max()}", f"a row of stations, 0 to {len(stations) - 1}")
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            points = points[finite]
            normals = None if normals is None else normals[finite]
            index = None if index is None else index[finite]
        if not len(points):
            raise ScanError("scan", "no point with finite coordinates", "at least one")
        for name, value in zip(("points", "normals", "stations", "station_index"), (points, normals, stations, index)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)


def merge(scans: list[Scan]) -> Scan:
    """Return several scans as one; stations keep their points.

    Normals are kept when every part has them, stations when every part has them.
    """
    if not scans:
        raise ScanError("scan", "no files", "at least one")
    if len(scans) == 1:
        return scans[0]
    stations = station_index = None
    parts = [(s.stations, s.station_index) for s in scans]
    if all(st is not None for st, _ in parts):
        stations = np.concatenate([st for st, _ in parts if st is not None])
        offsets = np.cumsum([0] + [len(st) for st, _ in parts if st is not None])
        station_index = np.concatenate([ix + o for (_, ix), o in zip(parts, offsets) if ix is not None])
    normals = [s.normals for s in scans if s.normals is not None]
    return Scan(
        points=np.concatenate([s.points for s in scans]),
        normals=np.concatenate(normals) if len(normals) == len(scans) else None,
        stations=stations,
        station_index=station_index,
    )


def _rows(name: str, value: npt.ArrayLike) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ScanError(name, "not numbers", "an array of shape [P][3]") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ScanError(name, f"shape {array.shape}", "[P][3]")
    return array
