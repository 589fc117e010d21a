"""Descent: the loop of the paper's figure 2, for every stage of a fit.

Match each point to a face, weigh the matches, add up the terms, solve the box-constrained
step, move. Stages differ in their points, their weights and the variables that may move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.errors import StepError
from linear_ik.ik_step import Solver
from linear_ik.problem import Problem
from linear_ik.result import IterationRecord
from linear_ik.settings import FitSettings, TermWeights
from linear_ik.stage import PointTerm, Stage
from linear_ik.terms.continuity import continuity
from linear_ik.terms.damping import Damping, damping
from linear_ik.terms.directional_constraint import directional_constraint
from linear_ik.terms.objective import Objective
from linear_ik.terms.point_residual import point_residual
from linear_ik.terms.prior import prior
from linear_ik.terms.support import end_support

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

CALMER = 0.7  # times as long, a step after one that it takes back


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
    gain, last = 1.0, np.zeros(len(moving))
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
        if stage.calm_after is not None and i >= stage.calm_after:
            # Points between two faces go to and fro: where their pulls balance, only shorter steps come to rest.
            gain = CALMER * gain if float(last @ objective.H @ dx) < 0.0 else min(gain / CALMER, 1.0)
            last, dx = dx, gain * dx
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
        objective += end_support(problem.element, pose, noise_m**2, problem.end_m).of(moving)
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
