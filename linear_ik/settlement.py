"""Settlement: from the right basin to the best estimate.

The start-up leaves a chain on the right faces, each joint free to follow what lies near.
Here the scan says how much its own member bends (the prior's strength, from the
evidence), whether its slide along the axis is seen at all, and which segments were
fitted to something else: a flange, a bracket, a notch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.correspondence import Correspondences
from linear_ik.descent import (
    Descended,
    Log,
    damped_step,
    descend,
    known_terms,
    record,
    step_objective,
)
from linear_ik.doubts import seen_around
from linear_ik.ends import Slide, anchored, shift_at_start, slide_of_ends
from linear_ik.evidence import evidence, prior_move
from linear_ik.foreign import at_limits, foreign_segments
from linear_ik.ik_step import Solver
from linear_ik.problem import AXIAL, Problem
from linear_ik.section_check import SectionMisfit, section_misfit
from linear_ik.settings import FitSettings
from linear_ik.side_noise import touched_segments, trust_of
from linear_ik.stage import Stage, depth_of, on_surface
from linear_ik.straightening import straightened
from linear_ik.tally import MATCHED, Tally, tally
from linear_ik.terms.damping import Damping
from linear_ik.terms.objective import Objective
from linear_ik.uncertainty import covariance, noise_of
from linear_ik.visible_sides import has_thin_plates, may_be_told, told_apart

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# In standard deviations of the noise: 2 % less efficient than least squares, and 9 %, where what lies
# beside the surface must not pull.
ROBUST_SCALE, NARROW_SCALE = 5.0, 3.0
NOISE_MISGIVEN = 3.0
STILL = 0.1  # of the noise: what the step on all points may be left to do
MOST_ROUNDS = 5
MOST_ITERATIONS, CALM_AFTER = 50, 12
SLIDE_SEEN_M = 0.003


@dataclass(frozen=True, eq=False)
class Settled:
    """A fit that every point had its say in.

    Attributes:
        problem: with the prior, the variables and the section it ended with.
        x: [6 + 3N] where it ended.
        pose: the chain there.
        objective: all terms but the damping, of all points, over all variables.
        tally: the points counted.
        pairs: matches of the sample, made one step before.
        some: [S][3] the sample.
        matched: [P] which of these lie on the surface, within 4 deviations.
        noise_m: standard deviation of the matched points.
        scale_m: robust scale of the weights.
        foreign: [N] segments whose points belong to something else.
        touched: [N] segments of which one side has lost its weight, as something touches it.
        unseen: [E] faces that were surely not seen.
        misfit: what the section measures, where that is not what was designed.
        converged: whether it came to rest.
        still: [6 + 3N] the step that the points still ask for; a method that stops
            elsewhere is that far off.
        start_shift_m: [2] across the axis, where the points put a held start elsewhere.
        slide: how far both ends of the points say it still has slid, where they agree.
    """

    problem: Problem
    x: Array
    pose: Pose
    objective: Objective
    tally: Tally
    pairs: Correspondences
    some: Array
    matched: Mask
    noise_m: float
    scale_m: float
    foreign: Mask
    touched: Mask
    unseen: Mask
    misfit: SectionMisfit | None
    converged: bool
    still: Array
    start_shift_m: Array | None
    slide: Slide | None


@dataclass(frozen=True, eq=False)
class _Descents:
    """Descents on one sample of the points."""

    some: Array
    settings: FitSettings
    solver: Solver
    log: Log
    robust_scale: float

    def from_(
        self, problem: Problem, x: Array, noise_m: float, foreign: Mask, trust: Array | None, stop: float = 0.1
    ) -> Descended:
        """Descend from x [6 + 3N] until no node moves by a share of the noise."""
        stage = Stage(
            "sample",
            self.some,
            (self.robust_scale * noise_m,),
            noise_m,
            MOST_ITERATIONS,
            max(2e-5, stop * noise_m),
            ignored=foreign if foreign.any() else None,
            depth_m=depth_of(problem, noise_m),
            trust=trust,
            calm_after=CALM_AFTER,
        )
        return descend(problem, x, stage, self.settings, self.solver, self.log)


def settle(
    problem: Problem,
    found: Descended,
    some: Array,
    settings: FitSettings,
    solver: Solver,
    log: Log,
    robust_scale: float,
) -> Settled:
    """Refine the fit that is in the right basin, on a sample of the points, then once on all.

    Args:
        problem: with all points near the element.
        found: a fit in the right basin.
        some: [S][3] the sample.
        settings: of the fit.
        solver: of the steps.
        log: of the iterations.
        robust_scale: of the points' weights, in deviations of the noise.
    """
    designed = problem.surface
    foreign = np.zeros(problem.element.segments, dtype=bool)
    misfit: SectionMisfit | None = None
    noise_m = noise_used(found, settings)
    descents = _Descents(some, settings, solver, log, robust_scale)
    found = descents.from_(problem, found.x, noise_m, foreign, None, stop=0.2)
    trust: Array | None = None
    unseen = np.zeros(len(problem.surface.corners), dtype=bool)
    noise_m = noise_used(found, settings)
    # Where all sides are seen, and are no noise of their opposites, nothing has taken the place of another.
    in_doubt = robust_scale < ROBUST_SCALE and (
        has_thin_plates(problem.surface, noise_m) or not seen_around(problem.surface, found.pairs)
    )
    if in_doubt and may_be_told(problem):
        down = partial(descents.from_, noise_m=noise_m, foreign=foreign, trust=None)
        problem, found, unseen = told_apart(problem, found, noise_m, down)
    for _ in range(MOST_ROUNDS):
        noise_m = noise_used(found, settings)
        before_trust, trust = trust, trust_of(found.pairs, found.weights, noise_m, at_limits(problem, found.x))
        changed = (trust is None) != (before_trust is None)
        changed |= bool((touched_segments(trust, len(foreign)) != touched_segments(before_trust, len(foreign))).any())
        if misfit is None:
            misfit = section_misfit(designed, found.pairs, _matched(found, noise_m), noise_m)
            if misfit is not None and misfit.plausible:
                problem = problem.measuring(designed.scaled(misfit.scale))
                changed = True
        objective = step_objective(problem, found.x, found.pose, found.pairs, found.weights, noise_m)
        before, problem = problem, problem.expecting(*evidence(problem, found.x, objective, noise_m))
        if not changed and problem.may_slide and AXIAL not in problem.variables:
            slide = slide_of_ends(problem, found.pairs, noise_m)
            if slide is not None:
                problem, changed = anchored(problem, found.x, slide), True
            elif slide_seen(problem, found, objective, noise_m):
                problem, changed = problem.released(), True
        if not changed:
            worse = foreign | foreign_segments(problem, found, foreign)
            changed, foreign = bool((worse != foreign).any()), worse
            if changed and problem.prior_mean[AXIAL] == 0.0:
                # What told the slide may have been the foreign segments.
                problem = problem.held()
        if not changed and found.converged and prior_move(before, problem, found, objective, noise_m) < STILL * noise_m:
            break  # the step on all points will take the new prior in
        found = descents.from_(problem, found.x, noise_m, foreign, trust)
        if not changed:
            break
    if in_doubt and not foreign.any():
        noise_m = noise_used(found, settings)
        down = partial(descents.from_, noise_m=noise_m, foreign=foreign, trust=trust)
        problem, found = straightened(problem, found, noise_m, robust_scale, down)
    noise_m = noise_used(found, settings)
    settled = count(problem, found, some, noise_m, foreign, trust, unseen, misfit, robust_scale)
    return last_step(settled, settings, solver, log)


def noise_used(found: Descended, settings: FitSettings) -> float:
    """Return the noise that was given, or where points scatter three times as much what they show."""
    shown_m = noise_of(found.pairs, found.weights)
    given_m = settings.range_noise_m
    return shown_m if given_m is None or shown_m > NOISE_MISGIVEN * given_m else given_m


def count(
    problem: Problem,
    found: Descended,
    some: Array,
    noise_m: float,
    foreign: Mask,
    trust: Array | None,
    unseen: Mask,
    misfit: SectionMisfit | None,
    robust_scale: float,
) -> Settled:
    """Count all points at the pose that the sample came to rest at."""
    scale_m = robust_scale * noise_m
    counted = tally(problem, found.pose, noise_m, scale_m, foreign if foreign.any() else None, trust)
    others = known_terms(problem, found.x, found.pose, noise_m)
    objective = counted.objective + others
    moving, still = problem.variables, np.zeros(len(found.x))
    still[moving] = -np.linalg.solve(objective.of(moving).H, objective.c[moving])
    return Settled(
        problem,
        found.x,
        found.pose,
        objective,
        counted,
        found.pairs,
        some,
        _matched(found, noise_m),
        noise_m,
        scale_m,
        foreign,
        touched_segments(trust, len(foreign)),
        unseen,
        misfit,
        found.converged,
        still,
        shift_at_start(problem, counted.objective, others, noise_m),
        slide_of_ends(problem, found.pairs, noise_m),
    )


def last_step(settled: Settled, settings: FitSettings, solver: Solver, log: Log) -> Settled:
    """Take one step on all points together."""
    if len(log.records) >= settings.max_iterations:
        return replace(settled, converged=False)
    problem, counted, x = settled.problem, settled.tally, settled.x.copy()
    chain, moving = problem.chain, problem.variables
    objective, lam = settled.objective.of(moving), Damping(settings.weights.damping)
    dx, lam = damped_step(objective, lam, chain.lower[moving] - x[moving], chain.upper[moving] - x[moving], solver)
    x[moving] += dx
    x = chain.clip(x)
    whole = settled.objective
    # What the terms still ask for past the step: limits are judged by it.
    left = Objective(whole.H, whole.c + whole.H @ (x - settled.x))
    step_rad = float(np.abs(dx).max(initial=0.0))
    record(problem, log, "full", counted.weighted, counted.weighted_rms_m, settled.scale_m, lam.weight, step_rad, x)
    return replace(settled, x=x, pose=chain.pose(x), objective=left, still=np.zeros(len(x)))


def measured(problem: Problem, found: Descended, settings: FitSettings) -> Settled:
    """Return another method's fit as it stands, measured by the distance of all points to its surface."""
    pairs, _, _ = on_surface(problem, found.pose, Stage("measure", problem.points), 0)
    noise_m = settings.range_noise_m or noise_of(pairs)
    stage = Stage("measure", problem.points, (ROBUST_SCALE * noise_m,))
    pairs, weights, _ = on_surface(problem, found.pose, stage, 0)
    found = Descended(found.x, found.pose, pairs, weights, found.converged)
    no_segments, no_faces = (np.zeros(n, dtype=bool) for n in (problem.element.segments, len(problem.surface.corners)))
    return count(problem, found, problem.points, noise_m, no_segments, None, no_faces, None, ROBUST_SCALE)


def _matched(found: Descended, noise_m: float) -> Mask:
    return np.asarray((found.weights > 0) & (found.pairs.distance_m <= MATCHED * noise_m))


def slide_seen(problem: Problem, found: Descended, objective: Objective, noise_m: float) -> bool:
    """Whether the bends of the element fix its place along its axis to 3 mm."""
    S, _ = covariance(problem.released(), found.pose, objective, noise_m)
    return bool(np.sqrt(S[AXIAL, AXIAL]) < SLIDE_SEEN_M)
