"""Handout: a site's scan, piece by piece, to the elements whose neighbourhood its points are in."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from linear_ik.scan import Scan
from linear_ik.site.neighbourhood import Neighbourhoods
from linear_ik.site.spill import Spill

Array = npt.NDArray[np.float64]

UNKNOWN = -1


@dataclass
class Extent:
    """What was read of a scan; of a COPC file only what may be near an element.

    Attributes:
        points: how many.
        handed_out: how many of them are in a neighbourhood.
        low_m, high_m: [3] of all of them.
        stations: [S][3] rows, as they came.
        left_out: points that are none, see `no_points`.
        mixed: how many elements have points of known stations and points of unknown ones: of those no station is used.
    """

    points: int = 0
    handed_out: int = 0
    low_m: Array = field(default_factory=lambda: np.full(3, np.inf))
    high_m: Array = field(default_factory=lambda: np.full(3, -np.inf))
    stations: list[tuple[float, ...]] = field(default_factory=list)
    left_out: int = 0
    mixed: int = 0


def moved(pieces: Iterable[Scan], T_model_scan: Array | None) -> Iterator[Scan]:  # noqa: N803
    """Yield the pieces of a scan in the model's coordinates, without normals."""
    for piece in pieces:
        if T_model_scan is None:
            yield replace(piece, normals=None)
            continue
        R, t = T_model_scan[:3, :3], T_model_scan[:3, 3]
        stations = None if piece.stations is None else piece.stations @ R.T + t
        yield Scan(piece.points @ R.T + t, None, stations, piece.station_index, piece.left_out)


def boxes_back(boxes_m: Array, T_model_scan: Array | None) -> Array:  # noqa: N803
    """Return upright boxes [B][2][3] in the scan's coordinates that hold those in the model's."""
    if T_model_scan is None:
        return boxes_m
    # That of a map carries the map's scale: its transpose is no inverse.
    T_scan_model = np.linalg.inv(T_model_scan)
    R, t = T_scan_model[:3, :3], T_scan_model[:3, 3]
    middle, half = boxes_m.mean(axis=1), (boxes_m[:, 1] - boxes_m[:, 0]) / 2
    # A box turned is as large as its edges' shadows together.
    centre, extent = middle @ R.T + t, half @ np.abs(R.T)
    return np.stack([centre - extent, centre + extent], axis=1)


def hand_out(
    pieces: Iterable[Scan],
    neighbourhoods: Neighbourhoods,
    spill: Spill,
    on_piece: Callable[[int], object] | None = None,
) -> Extent:
    """Give every point to the elements whose neighbourhood it is in.

    Args:
        pieces: of the scan, in the model's coordinates; each from one station, or from unknown ones.
        neighbourhoods: of the elements.
        spill: takes their points.
        on_piece: called with the number of points so far.
    """
    extent, rows = Extent(), dict[tuple[float, ...], int]()
    seen = np.zeros((2, len(spill.received)), dtype=bool)  # from an unknown station, from a known one
    for piece in pieces:
        points = piece.points
        station = UNKNOWN
        if piece.stations is not None and len(piece.stations) == 1:
            station = rows.setdefault(tuple(piece.stations[0].tolist()), len(rows))
        extent.points += len(points)
        extent.left_out += piece.left_out
        extent.low_m = np.minimum(extent.low_m, points.min(axis=0))
        extent.high_m = np.maximum(extent.high_m, points.max(axis=0))
        pairs = neighbourhoods.pairs(points)
        seen[int(station != UNKNOWN), pairs.member] = True
        near = np.zeros(len(points), dtype=bool)
        near[pairs.row] = True
        extent.handed_out += int(near.sum())
        starts = np.flatnonzero(np.diff(pairs.member, prepend=-1))
        for start, end in zip(starts, np.append(starts, len(pairs.row))[1:], strict=True):
            rows_of = pairs.row[start:end]
            spill.add(int(pairs.member[start]), points[rows_of], station, pairs.stretch[start:end])
        if on_piece is not None:
            on_piece(extent.points)
    spill.flush()
    extent.stations, extent.mixed = list(rows), int(seen.all(axis=0).sum())
    return extent
