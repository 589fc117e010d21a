"""Tally: one pass over all points of a scan, however many, in pieces.

The fit settles on a sample; here every point has its say once, at the pose the sample
gave: what it adds to the normal equations, and which segment it lies on or beside. Only
sums are kept, so memory does not grow with the scan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.correspondence import Correspondences
from linear_ik.problem import POINTS_A_PIECE, Problem
from linear_ik.side_noise import SIDES, sides
from linear_ik.stage import Stage, depth_of, on_surface
from linear_ik.terms.objective import Objective
from linear_ik.terms.point_residual import point_residual

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

COVERAGE_RADIUS = 0.02  # of the element's length (the design contract)
MATCHED = 4.0  # deviations of the noise
BESIDE = 16.0  # deviations; four times as far as a match
HALVES = 2  # of a segment, each with its patches
LEAST_POINTS = 8  # of a patch


@dataclass(frozen=True, eq=False)
class Tally:
    """Sums over all points.

    Attributes:
        objective: what the points ask of the step, over all variables [6 + 3N].
        matched: [N] points on each segment's surface, within 4 deviations of the noise.
        beside: [N] points nearest to it between 4 and 16.
        squares_m2: [N] sum of the squared residuals of the matched points.
        weighted: points with a weight.
        cost_m2: weighted sum of squared residuals.
        weight: sum of the weights.
        touched: [N][around][along] cells of each segment's surface that hold a matched point.
        patch_score: [N][sides][halves] sum of the weighted residuals of the matched points of
            one side of half a segment, over the root of the sum of their squares: standard
            normal where points err independently of each other. NaN for a patch of few points.
        patch_off_m: [N][sides][halves] their weighted mean.
    """

    objective: Objective
    matched: Index
    beside: Index
    squares_m2: Array
    weighted: int
    cost_m2: float
    weight: float
    touched: Mask
    patch_score: Array
    patch_off_m: Array

    @property
    def weighted_rms_m(self) -> float:
        """Rms distance of all points with a weight, weighted."""
        return float(np.sqrt(self.cost_m2 / self.weight)) if self.weight else float("nan")

    @property
    def surface_rmse_m(self) -> float:
        """Rms distance of the matched points to the surface."""
        return float(np.sqrt(self.squares_m2.sum() / self.matched.sum())) if self.matched.sum() else float("nan")


def tally(
    problem: Problem, pose: Pose, noise_m: float, scale_m: float, ignored: Mask | None, trust: Array | None
) -> Tally:
    """Match every point of the problem to the chain at ``pose`` and return the sums.

    Args:
        problem: for its points, surface and variables.
        pose: where the chain is.
        noise_m: standard deviation of a point on the surface.
        scale_m: robust scale of the weights.
        ignored: [N] segments whose points have no weight, or None.
        trust: [N][8] factor on the weights of each side of each segment, or None.
    """
    n, columns, depth_m = pose.n_segments, np.arange(problem.chain.nv), depth_of(problem, noise_m)
    touched = np.zeros((n, *cells(problem)), dtype=bool)

    objective = Objective(np.zeros((len(columns), len(columns))), np.zeros(len(columns)))
    points, patches = np.zeros((6, n)), np.zeros((4, n * HALVES * SIDES))
    for start in range(0, len(problem.points), POINTS_A_PIECE):
        some = problem.points[start : start + POINTS_A_PIECE]
        piece = Stage("full", some, (scale_m,), noise_m, ignored=ignored, depth_m=depth_m, trust=trust)
        pairs, weights, _ = on_surface(problem, pose, piece, 0)
        on = (weights > 0) & (pairs.distance_m <= MATCHED * noise_m)
        objective += point_residual(pose, pairs, weights, columns)
        points += _point_sums(pairs, weights, on, noise_m, depth_m)
        patches += _patch_sums(problem, pairs, weights, on)
        _touch(touched, problem, pairs, on)
    matched, beside, squares_m2, weighted, cost_m2, weight = points
    patches[:, patches[3] < LEAST_POINTS] = np.nan
    pull_m, pull_squares_m2, weights, _ = patches.reshape(4, n, SIDES, HALVES)
    with np.errstate(invalid="ignore", divide="ignore"):
        score, off_m = pull_m / np.sqrt(pull_squares_m2), pull_m / weights
    return Tally(
        objective,
        matched.astype(np.intp),
        beside.astype(np.intp),
        squares_m2,
        int(weighted.sum()),
        float(cost_m2.sum()),
        float(weight.sum()),
        touched,
        score,
        off_m,
    )


def _point_sums(pairs: Correspondences, weights: Array, on: Mask, noise_m: float, depth_m: float) -> Array:
    """Return of each segment [6][N] points on it, beside it, their squares, weighted points, cost and weight."""
    squares = pairs.residual_m**2
    near = ~on & (pairs.distance_m > MATCHED * noise_m)
    near &= (pairs.distance_m <= BESIDE * noise_m) & (pairs.residual_m > -depth_m)
    each = (on, near, squares * on, weights > 0, squares * weights, weights)
    out = np.zeros((len(each), len(pairs.starts) - 1))
    filled = np.flatnonzero(np.diff(pairs.starts))
    for row, what in zip(out, each, strict=True):
        row[filled] = np.add.reduceat(what, pairs.starts[filled], dtype=np.float64)
    return out


def _patch_sums(problem: Problem, pairs: Correspondences, weights: Array, on: Mask) -> Array:
    """Return sums of the weighted residuals, of their squares, of the weights, and the count [4][patches]."""
    side = (pairs.segment * SIDES + sides(pairs.gradient)) * HALVES
    patch = side + (pairs.local[:, 2] > 0.5 * problem.element.segment_length_m)
    w, most = weights * on, problem.element.segments * SIDES * HALVES
    each = w * pairs.residual_m
    sums = [np.bincount(patch, what, minlength=most) for what in (each, each**2, w)]
    return np.stack([*sums, np.bincount(patch[on], minlength=most)])


def cells(problem: Problem) -> tuple[int, int]:
    """Return into how many cells around and along a segment's surface is divided.

    A cell is a quarter of the radius in which a point covers the surface.
    """
    cell_m = COVERAGE_RADIUS * problem.element.length_m / 4
    around = int(np.clip(np.ceil(problem.surface.perimeter_m / cell_m), 4, 1000))
    return around, int(np.ceil(problem.element.segment_length_m / cell_m))


def _touch(touched: Mask, problem: Problem, pairs: Correspondences, on: Mask) -> None:
    _, around, along = touched.shape
    s = problem.surface.length_along(pairs.section, pairs.face) * (around / problem.surface.perimeter_m)
    z = pairs.local[:, 2] * (along / problem.element.segment_length_m)
    row = np.minimum(s.astype(np.int32), around - 1)
    cell = (pairs.segment.astype(np.int32) * around + row) * along + np.clip(z.astype(np.int32), 0, along - 1)
    touched.reshape(-1)[cell[on]] = True


def nearby(problem: Problem, pose: Pose, reach_m: float) -> Array:
    """Return the problem's points within ``reach_m`` of the chain's surface."""
    kept = []
    for start in range(0, len(problem.points), POINTS_A_PIECE):
        piece = problem.points[start : start + POINTS_A_PIECE]
        pairs = problem.matcher.match(pose, piece)
        kept.append(piece[np.sort(pairs.order[pairs.distance_m < reach_m])])
    return np.concatenate(kept)
