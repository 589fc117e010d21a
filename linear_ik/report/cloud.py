"""Cloud: the scan's points near each member of a report, and where on it they lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Chain
from linear_ik.result import FitResult
from linear_ik.tapered_surface import surface_of

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

NEAR_M = 0.05  # from the fitted surface; what lies farther off is another body
MOST_POINTS = 40_000  # of a member, before anything is computed


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
    """A scan, sorted once so that the points about a member are found without a look at all others."""

    def __init__(self, points: Array) -> None:
        """Sort the points [P][3] along x."""
        self._points = points[np.argsort(points[:, 0])]

    def near(self, result: FitResult, frames: Array, seed: int = 0) -> NearPoints:
        """Return the points within 50 mm of a fitted member, a random choice where there are many.

        Args:
            result: of the fit.
            frames: [N][4][4] of its segments, `T_world_segments`.
            seed: of the choice.
        """
        nodes, reach = result.nodes_m, surface_of(result.element).reach_m + NEAR_M
        low, high = nodes.min(axis=0) - reach, nodes.max(axis=0) + reach
        first, last = np.searchsorted(self._points[:, 0], [low[0], high[0]])
        box = self._points[first:last]
        box = box[((box[:, 1:] >= low[1:]) & (box[:, 1:] <= high[1:])).all(axis=1)]
        near = _beside(result, frames, box)
        rows = np.flatnonzero(near.distance_m <= NEAR_M)
        if len(rows) > MOST_POINTS:
            rows = np.sort(np.random.default_rng(seed).choice(rows, MOST_POINTS, replace=False))
        return NearPoints(near.points[rows], near.segment[rows], near.xy[rows], near.s_m[rows], near.distance_m[rows])


def T_world_segments(result: FitResult) -> Array:  # noqa: N802 (T_target_source, as small_gicp names transforms)
    """Return the frame [N][4][4] of each fitted segment."""
    return np.asarray(result.base_pose @ Chain.of(result.element).segment_poses(result.q))


def _beside(result: FitResult, T: Array, points: Array) -> NearPoints:
    """Return where points lie; those past the ends, or far beside, are infinitely far."""
    step_m, n = result.element.segment_length_m, result.element.segments
    surface = surface_of(result.element)
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
