"""Descent: the loop of the paper's figure 2, for every stage of a fit.

Match each point to a face, weigh the matches, add up the terms, solve the box-constrained
step, move. Stages differ in their points, their weights and the variables that may move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.errors import StepError
from linear_ik.ik_step import Solver
from linear_ik.problem import Problem
from linear_ik.result import IterationRecord
from linear_ik.settings import FitSettings, TermWeights
from linear_ik.side_noise import sides
from linear_ik.terms.continuity import continuity
from linear_ik.terms.damping import Damping, damping
from linear_ik.terms.directional_constraint import directional_constraint
from linear_ik.terms.objective import Objective
from linear_ik.terms.point_residual import point_residual
from linear_ik.terms.prior import prior
from linear_ik.terms.support import end_support

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


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
        trust: [8] factor on the weights of each side that a match faces, or None for 1.
        pair: finds and weighs the matches of an iteration.
        term: what the matches ask of the step.
        close_m: converged too when no match is farther apart.
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
    trust: Array | None = None
    pair: Pairing = field(default_factory=lambda: on_surface)
    term: PointTerm = point_residual
    close_m: float = 0.0


@dataclass(eq=False)
class Log:
    """History of a fit over all its stages, and who wants to hear of it."""

    on_iteration: Callable[[IterationRecord], object] | None = None
    T_world_element: Array = field(default_factory=lambda: np.eye(4))
    records: list[IterationRecord] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Descended:
    """Where a stage ended.

    Attributes:
        x: [6 + 3N] the variables, within their box.
        pose: the chain there.
        pairs: the last matches, made one step before ``x``.
        weights: [P] their weights.
        converged: whether it stopped by itself.
    """

    x: Array
    pose: Pose
    pairs: Correspondences
    weights: Array
    converged: bool


def descend(problem: Problem, x: Array, stage: Stage, settings: FitSettings, solver: Solver, log: Log) -> Descended:
    """Run one stage from ``x`` [6 + 3N] until it converges or has used its iterations."""
    chain = problem.chain
    moving = problem.variables if stage.variables is None else stage.variables
    lower, upper = chain.lower[moving], chain.upper[moving]
    lam = Damping(settings.weights.damping)
    pose, cost_m2, converged = chain.pose(x), np.inf, False
    for i in range(stage.iterations):
        pairs, weights, scale_m = stage.pair(problem, pose, stage, i)
        if len(log.records) >= settings.max_iterations:
            break
        previous_m2, cost_m2 = cost_m2, float(weights @ pairs.residual_m**2) / max(float(weights.sum()), 1e-300)
        lam = lam.after(cost_m2 <= previous_m2)
        objective = step_objective(problem, x, pose, pairs, weights, stage.noise_m, moving, stage.term)
        if settings.weights.continuity or settings.weights.directional:
            shape = shape_damping(x - problem.prior_mean, objective.mean_information(), settings.weights)
            objective += shape.of(moving)
        dx, lam = damped_step(
            objective,
            lam,
            np.maximum(lower - x[moving], -settings.max_step_rad),
            np.minimum(upper - x[moving], settings.max_step_rad),
            solver,
        )
        x = x.copy()
        x[moving] += dx
        x = chain.clip(x)

        before, pose = pose, chain.pose(x)
        matched, rms_m = int(np.count_nonzero(weights)), float(np.sqrt(cost_m2))
        record(problem, log, stage.phase, matched, rms_m, scale_m, lam.weight, float(np.abs(dx).max()), x)
        moved_m = float(np.abs(pose.nodes_m - before.nodes_m).max())
        close = len(pairs.distance_m) > 0 and float(pairs.distance_m.max()) < stage.close_m
        if close or (moved_m < stage.stop_m and i + 1 >= len(stage.scales_m)):
            converged = True
            break
    return Descended(x, pose, pairs, weights, converged)


def on_surface(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
    """Pair each scan point with the nearest face, weighed robustly by its distance."""
    scale_m = stage.scales_m[min(i, len(stage.scales_m) - 1)]
    pairs = problem.matcher.match(pose, stage.points, stage.segments, stage.first)
    weights = robust_weights(pairs.distance_m, scale_m)
    if stage.trust is not None:
        weights *= stage.trust[sides(pairs.gradient)]
    if stage.ignored is not None:
        weights[stage.ignored[pairs.segment]] = 0.0
    return Paired(pairs, weights, scale_m)


def damped_step(
    objective: Objective, lam: Damping, lower: Array, upper: Array, solver: Solver
) -> tuple[Array, Damping]:
    """Return the step within its box, and the damping it took.

    A program too ill-conditioned for the solver is damped until it is not.

    Raises:
        StepError: the solver fails whatever the damping.
    """
    mean = objective.mean_information()
    while True:
        try:
            return solver(objective + damping(len(lower), lam.weight * mean + 1e-12), lower, upper), lam
        except StepError:
            if lam.weight >= lam.most:
                raise
            lam = Damping(max(100.0 * lam.weight, 1e-4), lam.least, lam.most)


def step_objective(
    problem: Problem,
    x: Array,
    pose: Pose,
    pairs: Correspondences,
    weights: Array,
    noise_m: float,
    moving: Index | None = None,
    term: PointTerm = point_residual,
) -> Objective:
    """Return what points, prior and supports ask of the step, over some variables or all [6 + 3N]."""
    moving = np.arange(len(x)) if moving is None else moving
    known = known_terms(problem, x, pose, noise_m, moving, len(pairs.starts) - 1)
    return term(pose, pairs, weights, moving) + known


def known_terms(
    problem: Problem,
    x: Array,
    pose: Pose,
    noise_m: float,
    moving: Index | None = None,
    grown: int | None = None,
) -> Objective:
    """Return the sum of the prior and the supports: what is known besides the points.

    The end's support counts once the whole chain has ``grown``.
    """
    moving = np.arange(len(x)) if moving is None else moving
    objective = prior(x[moving], problem.prior_mean[moving], (noise_m / problem.prior_sd[moving]) ** 2)
    if problem.element.end != "free" and grown in (None, pose.n_segments):
        objective += end_support(problem.element, pose, noise_m**2).of(moving)
    return objective


def shape_damping(bends: Array, information: float, weights: TermWeights) -> Objective:
    """Return the paper's Q and C, for bends against the design [6 + 3N], weighed against the mean ``information``."""
    n = len(bends)
    objective = Objective(np.zeros((n, n)), np.zeros(n))
    if weights.continuity:
        objective += continuity(n, weights.continuity * information)
    if weights.directional:
        objective += directional_constraint(bends, weights.directional * information)
    return objective


def robust_weights(distance_m: Array, scale_m: float) -> Array:
    """Return Geman and McClure's weights ``(s^2 / (s^2 + d^2))^2``, 0 beyond 3 s; 1 for s = inf."""
    if not np.isfinite(scale_m):
        return np.ones(len(distance_m))
    ratio = (distance_m / scale_m) ** 2
    return np.where(ratio <= 9.0, 1.0 / (1.0 + ratio) ** 2, 0.0)


def record(
    problem: Problem,
    log: Log,
    phase: str,
    points: int,
    rms_m: float,
    scale_m: float,
    damping_weight: float,
    step_rad: float,
    x: Array,
) -> None:
    """Note an iteration in the history, and tell whoever listens."""
    T, base = log.T_world_element, problem.chain.base_pose(x) if x[:BASE].any() else np.eye(4)
    entry = IterationRecord(
        iteration=len(log.records) + 1,
        phase=phase,
        points=points,
        surface_rmse_m=rms_m if points else float("nan"),
        scale_m=scale_m,
        damping=damping_weight,
        step_rad=step_rad,
        q=x[BASE:].copy(),
        base_pose=T @ base,
    )
    log.records.append(entry)
    if log.on_iteration is not None:
        log.on_iteration(entry)
