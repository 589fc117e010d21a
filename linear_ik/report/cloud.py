"""Cloud: the scan's points near each member of a report, and where on it they lie."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import product

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Chain
from linear_ik.result import FitResult
from linear_ik.tapered_surface import surface_of

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

NEAR_M = 0.05  # from the fitted surface; what lies farther off is another body
CELL_M, BITS = 0.5, 20  # of a cell, some sections wide; of its number along each axis, three in 64 bits
MOST_POINTS = 40_000  # of a member, before anything is computed: six times what its view shows
MOST_OF_ALL, LEAST_OF_EACH = 4_000_000, 2_000  # of all members together: about 250 MB; and of each at least


@dataclass(frozen=True, eq=False)
class NearPoints:
    """Points near a fitted member.

    Attributes:
        points: [P][3] in the scan's coordinates.
        segment: [P] the nearest one, from 0.
        xy: [P][2] in that segment's section, local X and Y.
        s_m: [P] distance from the start along the chain.
        distance_m: [P] to the fitted surface.
    """

    points: Array
    segment: Index
    xy: Array
    s_m: Array
    distance_m: Array


class Cloud:
    """A scan, sorted once into cells, so that the points about a member are found without a look at all others."""

    def __init__(self, points: Array) -> None:
        """Sort the points [P][3] by their cells."""
        self._origin = points.min(axis=0)
        keys = np.zeros(len(points), dtype=np.int64)
        for axis in range(3):
            keys = (keys << BITS) | self._cells(points[:, axis], axis)
        order = np.argsort(keys, kind="stable")
        self._points, self._keys = points[order], keys[order]

    def near(self, result: FitResult, frames: Array, seed: int = 0) -> NearPoints:
        """Return the points within 50 mm of a fitted member, a random choice where there are many.

        Args:
            result: of the fit.
            frames: [N][4][4] of its segments, `T_world_segments`.
            seed: of the choice.
        """
        kept = _Kept(MOST_POINTS, seed)
        kept.add(self.all_near(result, frames))
        return kept.near

    def all_near(self, result: FitResult, frames: Array) -> NearPoints:
        """Return all points within 50 mm of a fitted member; arguments as of `near`."""
        near = _beside(result, frames, self._about(result))
        return _rows(near, np.flatnonzero(near.distance_m <= NEAR_M))

    def _about(self, result: FitResult) -> Array:
        """Return the points of the cells that the segments' boxes touch."""
        reach, nodes = surface_of(result.element).reach_m + NEAR_M, result.nodes_m
        low, high = np.minimum(nodes[1:], nodes[:-1]) - reach, np.maximum(nodes[1:], nodes[:-1]) + reach
        first = np.stack([self._cells(low[:, axis], axis) for axis in range(3)], axis=1)
        last = np.stack([self._cells(high[:, axis], axis) for axis in range(3)], axis=1)
        # Cells above each other follow each other: one look-up for all of them.
        columns: dict[tuple[int, int], tuple[int, int]] = {}
        for (x0, y0, z0), (x1, y1, z1) in zip(first.tolist(), last.tolist(), strict=True):
            for column in product(range(x0, x1 + 1), range(y0, y1 + 1)):
                bottom, top = columns.get(column, (z0, z1))
                columns[column] = min(bottom, z0), max(top, z1)
        keys = np.array([[((x << BITS | y) << BITS) | z for z in zs] for (x, y), zs in columns.items()])
        begin = np.searchsorted(self._keys, keys[:, 0], side="left")
        end = np.searchsorted(self._keys, keys[:, 1], side="right")
        return np.concatenate([self._points[a:b] for a, b in zip(begin, end, strict=True)])

    def _cells(self, values: Array, axis: int) -> npt.NDArray[np.int64]:
        """Return the cells of coordinates; what is farther off than there are numbers shares the last one."""
        cells: Array = np.floor((values - self._origin[axis]) / CELL_M)
        return np.clip(cells, 0, (1 << BITS) - 1).astype(np.int64)


class _Kept:
    """A random choice of the points near a member, all equally likely, however they come in pieces."""

    def __init__(self, most: int, seed: int = 0) -> None:
        self._most, self._rng = most, np.random.default_rng(seed)
        self._order = np.empty(0)
        nothing = np.empty(0)
        self.near = NearPoints(np.empty((0, 3)), np.empty(0, dtype=np.intp), np.empty((0, 2)), nothing, nothing)

    def add(self, near: NearPoints) -> None:
        """Take more points."""
        order = np.concatenate([self._order, self._rng.random(len(near.points))])
        both = NearPoints(
            *(np.concatenate([getattr(part, f.name) for part in (self.near, near)]) for f in fields(NearPoints))
        )
        rows = np.arange(len(order))
        if len(order) > self._most:
            # Those with the lowest lots stay: the same choice as of all at once.
            rows = np.sort(np.argpartition(order, self._most)[: self._most])
        self._order, self.near = order[rows], _rows(both, rows)


def gather(pieces: Iterable[Array], members: Sequence[tuple[FitResult, Array] | None]) -> list[NearPoints | None]:
    """Return the points near each of several members, read piece by piece; a random choice where there are many.

    Args:
        pieces: points [P][3] of a scan, of which only those near members are kept.
        members: a result and its frames, see `T_world_segments`; None of one that was not found.
    """
    most = min(MOST_POINTS, max(LEAST_OF_EACH, MOST_OF_ALL // max(len(members), 1)))
    kept = [None if member is None else _Kept(most) for member in members]
    for points in pieces:
        if not len(points):
            continue
        cloud, low, high = Cloud(points), points.min(axis=0), points.max(axis=0)
        for member, mine in zip(members, kept, strict=True):
            if member is None or mine is None:
                continue
            result, frames = member
            reach = surface_of(result.element).reach_m + NEAR_M
            apart = (result.nodes_m.min(axis=0) - reach > high) | (result.nodes_m.max(axis=0) + reach < low)
            if not apart.any():
                mine.add(cloud.all_near(result, frames))
    return [None if mine is None else mine.near for mine in kept]


def _rows(near: NearPoints, rows: Index) -> NearPoints:
    return NearPoints(*(getattr(near, f.name)[rows] for f in fields(NearPoints)))


def T_world_segments(result: FitResult) -> Array:  # noqa: N802 (T_target_source, as small_gicp names transforms)
    """Return the frame [N][4][4] of each fitted segment."""
    return np.asarray(result.base_pose @ Chain.of(result.fitted_element).segment_poses(result.q))


def _beside(result: FitResult, T: Array, points: Array) -> NearPoints:
    """Return where points lie; those past the ends, or far beside, are infinitely far."""
    element = result.fitted_element
    step_m, n = element.segment_length_m, element.segments
    surface = surface_of(element)
    reach = surface.reach_m + NEAR_M
    segment, xy = np.zeros(len(points), dtype=np.intp), np.zeros((len(points), 2))
    s_m, distance = np.zeros(len(points)), np.full(len(points), np.inf)
    apart = np.full(len(points), np.inf)
    for k in range(n):
        local = (points - T[k, :3, 3]) @ T[k, :3, :3]
        past = np.maximum(np.maximum(-local[:, 2], local[:, 2] - step_m), 0.0)
        off = np.hypot(past, np.hypot(local[:, 0], local[:, 1]))
        # Within a bend both neighbours are near; at the ends nothing belongs beyond the last segment.
        rows = (off < apart) & (off <= reach)
        if k == 0:
            rows &= local[:, 2] >= 0
        if k == n - 1:
            rows &= local[:, 2] <= step_m
        apart[rows], segment[rows], xy[rows] = off[rows], k, local[rows, :2]
        s_m[rows] = k * step_m + np.clip(local[rows, 2], 0.0, step_m)
    for k in range(n):
        mine = np.flatnonzero((segment == k) & np.isfinite(apart))
        if len(mine):
            distance[mine] = surface.section(k).distances(xy[mine])
    return NearPoints(points, segment, xy, s_m, distance)
