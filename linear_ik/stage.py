"""Stage: one run of the loop: its points, how they are matched and weighed, and what may move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.correspondence import Correspondences
from linear_ik.problem import Problem
from linear_ik.side_noise import sides
from linear_ik.terms.objective import Objective
from linear_ik.terms.point_residual import point_residual

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

FARTHEST = 3.0  # robust scales: beyond, a match has no weight
CAP_REACH, MOST_CAP_SHARE = 4.0, 0.05  # deviations from an end, and share of its segment


class Paired(NamedTuple):
    """Matches of one iteration.

    Attributes:
        pairs: what was matched to what.
        weights: [P] weight of each match.
        scale_m: distance that the weights were made with.
    """

    pairs: Any
    weights: Array
    scale_m: float


Pairing = Callable[[Problem, Pose, "Stage", int], Paired]
PointTerm = Callable[[Pose, Any, Array, Index], Objective]


@dataclass(frozen=True, eq=False)
class Stage:
    """One run of the loop.

    Attributes:
        phase: name in the history.
        points: [P][3] points to fit, element's frame.
        scales_m: robust scale of each iteration, the last one repeated; inf for
            unweighted.
        noise_m: standard deviation of a point, which the priors are weighed against.
        iterations: most iterations.
        stop_m: converged when no node moves farther.
        segments: fit only the first so many segments.
        first: leave out the segments before this one (from 0).
        variables: [n] the variables that move; all movable ones when None.
        ignored: [N] segments whose matches have no weight, or None.
        depth_m: matches deeper inside have no weight: through an open end a scanner sees a
            hollow section from inside.
        trust: [N][8] factor on the weights of each side of a segment that a match faces, or None for 1.
        pair: finds and weighs the matches of an iteration.
        term: what the matches ask of the step.
        close_m: converged too when no match is farther apart.
        calm_after: from this iteration on steps that turn back are shortened; None: never.
    """

    phase: str
    points: Array
    scales_m: tuple[float, ...] = (np.inf,)
    noise_m: float = 1e-3
    iterations: int = 30
    stop_m: float = 1e-5
    segments: int | None = None
    first: int = 0
    variables: Index | None = None
    ignored: npt.NDArray[np.bool_] | None = None
    depth_m: float = np.inf
    trust: Array | None = None
    pair: Pairing = field(default_factory=lambda: on_surface)
    term: PointTerm = point_residual
    close_m: float = 0.0
    calm_after: int | None = None


def on_surface(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
    """Pair each scan point with the nearest face, weighed robustly by its distance."""
    scale_m = stage.scales_m[min(i, len(stage.scales_m) - 1)]
    pairs = problem.matcher.match(pose, stage.points, stage.segments, stage.first)
    weights = robust_weights(pairs.distance_m, scale_m)
    if stage.trust is not None:
        weights *= stage.trust[pairs.segment, sides(pairs.gradient)]
    if stage.ignored is not None:
        weights[stage.ignored[pairs.segment]] = 0.0
    if np.isfinite(stage.depth_m):
        weights[pairs.residual_m < -stage.depth_m] = 0.0
    if np.isfinite(scale_m):
        for rows in end_rows(problem, pairs, stage.noise_m):
            weights[rows] = 0.0
    return Paired(pairs, weights, scale_m)


def depth_of(problem: Problem, noise_m: float) -> float:
    """Return the depth below the outside from where a point is nearer to the inside of a hollow section."""
    return max(0.5 * problem.wall_m, 3.0 * noise_m)


def end_rows(problem: Problem, pairs: Correspondences, noise_m: float) -> tuple[Index, Index]:
    """Return the matches that may lie on the start's or the end's cap, or on what stands there.

    A point of a cap has no lateral face. The nearest one pulls at it, and where the face
    across is hidden nothing pulls back.
    """
    n, starts, length_m = problem.element.segments, pairs.starts, problem.chain.segment_length_m
    first, last = pairs.local[starts[0] : starts[1], 2], pairs.local[starts[n - 1] :, 2] if len(starts) > n else None
    margin_m = CAP_REACH * noise_m
    begun = np.flatnonzero(first < min(margin_m, MOST_CAP_SHARE * length_m[0]))
    if last is None:
        return begun, begun[:0]
    ended = np.flatnonzero(last > length_m[-1] - min(margin_m, MOST_CAP_SHARE * length_m[-1]))
    return begun, starts[n - 1] + ended


def robust_weights(distance_m: Array, scale_m: float) -> Array:
    """Return Geman and McClure's weights ``(s^2 / (s^2 + d^2))^2``, 0 beyond 3 s; 1 for s = inf."""
    if not np.isfinite(scale_m):
        return np.ones(len(distance_m))
    ratio = (distance_m / scale_m) ** 2
    return np.where(ratio <= FARTHEST**2, 1.0 / (1.0 + ratio) ** 2, 0.0)


def robust_cost(distance_m: Array, scale_m: float) -> float:
    """Return ``sum r / (1 + r)``, r = d^2 / s^2, beyond 3 s as there: what `robust_weights` are the weights of."""
    ratio = np.minimum((distance_m / scale_m) ** 2, FARTHEST**2)
    return float((ratio / (1.0 + ratio)).sum())
