"""Start-up: finding the right basin from the base outwards, one segment at a time.

A descent finds the nearest fit, which may be the wrong side of a plate or a neighbour.
So the chain is grown: each new segment goes on as designed where that explains the points
around it, and else the direction is searched, by counting the points a candidate would
explain. Hypotheses compete by that count, less what their bends cost under the prior.
Matches are narrow throughout (a few times the noise): clutter 50 mm away does not pull.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.descent import Log, descend
from linear_ik.distance_field import NEAR_M, distance_fields
from linear_ik.ik_step import Solver
from linear_ik.problem import AXIAL, Problem
from linear_ik.repair import repair
from linear_ik.search_cloud import SearchCloud
from linear_ik.search_directions import base_shifts, bend_rotations, joint_bends
from linear_ik.seen_through import Refuter
from linear_ik.settings import FitSettings
from linear_ik.stage import Stage

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

POINTS_A_SEARCH = 600
LEAST_TAU_M, MOST_TAU_M = 0.004, 0.012  # wider, and the two sides of a plate are one
CHILDREN, FIRST_CHILDREN = 3, 8  # directions taken; of the first segment on a base that moves
MOST_LOOKED_AT = 2000  # directions, best first, among which these are found
APART_M, DISTINCT_M = 0.03, 0.003  # ends of two directions, nodes of two refined chains: nearer ones are the same
BEAM = (8, 4, 4, 2, 2, 1)  # hypotheses kept after each segment, where the base floats too
EXPLAINED_SHARE = 0.9
USUAL_SHARE, LOST_SHARE = 0.6, 0.1  # of what the segments before explain: enough to go on, and next to nothing
JOINT_SHARE = 0.1  # of a segment at each end, where its neighbour's surface explains points too
LEAST_SUPPORT = 12  # points: of a segment, and of a search
SLIDES = (-0.8, -0.4, 0.4, 0.8)  # of what the start's tolerance allows
BENT_RAD = np.radians(3.0)  # from where on bends show a slide


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A chain grown so far.

    Attributes:
        x: [6 + 3N] variables; those of segments not grown yet are the design's.
        score: points explained, less the cost of the bends.
        arm: first segment of a stretch that no point supports (from 0), or None.
        support: points that each grown segment explains.
    """

    x: Array
    score: float
    arm: int | None
    support: tuple[int, ...]


class Startup:
    """The search for one element in one (thinned) cloud."""

    def __init__(
        self,
        problem: Problem,
        points: Array,
        noise_m: float,
        settings: FitSettings,
        solver: Solver,
        log: Log,
        refuted: Refuter | None = None,
    ) -> None:
        """Take a cloud of even density, element's frame, its noise, and what says that a chain cannot be."""
        self.refuted: Refuter = refuted or (lambda x, grown: False)
        self.problem, self.points, self.noise_m = problem, points, noise_m
        self.cloud = SearchCloud(points, problem.surface.reach_m + NEAR_M)
        self.settings, self.solver, self.log = settings, solver, log
        # The two sides of a pole are as far apart as it is thick.
        most_m = max(MOST_TAU_M, 0.5 * (problem.surface.radius_m or 0.0))
        self.tau_m = float(np.clip(4.0 * noise_m, LEAST_TAU_M, most_m))
        self.fields = distance_fields(problem.surface)
        self.rng = np.random.default_rng(settings.seed)
        self.design = problem.designed
        self.floating = bool(problem.chain.upper[0] > 0)

    def run(self) -> Array:
        """Return the variables [6 + 3N] of the best hypothesis, refined on all joints."""
        beam = [Hypothesis(self.design, 0.0, None, ())]
        for k in range(self.problem.element.segments):
            children = [child for parent in beam for child in self.extend(parent, k, alone=len(beam) == 1)]
            beam = self.best(children, BEAM[min(k, len(BEAM) - 1)] if self.floating else 1)
        best = self.repaired(self.better(self.finish(h.x) for h in beam))
        return self.better([best, *self.slid(best)])

    def slid(self, x: Array) -> Iterator[Array]:
        """Yield a bent chain slid along its axis, where its base may and did not yet, and refined with the slide free.

        Grown from the base, the chain has its first bend where the design's slide puts it: off by that much, the rest
        may have settled on the wrong sides.
        """
        problem = self.problem
        if not problem.may_slide or AXIAL in problem.variables:
            return
        along = problem.chain.pose(x).rotations[:, :, 2]
        if (along @ along[0]).min() > np.cos(BENT_RAD):
            return
        free = problem.released()
        other = Startup(free, self.points, self.noise_m, self.settings, self.solver, self.log, self.refuted)

        def moved(share: float) -> Array:
            start = x.copy()
            start[AXIAL] += share * problem.chain.upper[AXIAL]
            return other.finish(problem.chain.clip(start))

        yield other.repaired(other.better(map(moved, SLIDES)))

    def better(self, candidates: Iterable[Array]) -> Array:
        """Return the candidate [6 + 3N] of the highest score, of those not refuted if there are any."""
        ranked = sorted(candidates, key=self.score, reverse=True)
        n = self.problem.element.segments
        return ranked[0] if len(ranked) == 1 else next((x for x in ranked if not self.refuted(x, n)), ranked[0])

    def repaired(self, x: Array) -> Array:
        """Return ``x`` [6 + 3N] itself, or with nodes moved across a plate where that explains more points."""
        # The two sides of a thin plate are told apart by a score no wider than the noise asks for.
        sharp_m = float(np.clip(2.5 * self.noise_m, LEAST_TAU_M / 2, self.tau_m))
        sharply = partial(self.score, tau_m=sharp_m)
        return repair(self.problem, x, self.around(x), self.fields, sharp_m, self.touched_up, sharply)

    def extend(self, parent: Hypothesis, k: int, alone: bool) -> list[Hypothesis]:
        """Return the ways to add segment k (from 0) to a hypothesis."""
        design_on = self.refined(parent.x, k, parent, alone)
        if (k > 0 or not self.floating) and self.explains(design_on, k):
            return [design_on]
        return [design_on, *(self.refined(x, k, parent, alone) for x in self.searched(parent, k))]

    def refined(self, x: Array, k: int, parent: Hypothesis, alone: bool) -> Hypothesis:
        """Descend on joint k, then on the last three, and score the outcome.

        Hypotheses of one parent differ in their last joints only: with no other parent
        to compete with, the points around those are all that need scoring.
        """
        t = self.tau_m
        arm = k if parent.arm is None else parent.arm
        first = max(0, arm - 3)
        local = self.around(x, k + 1, first)
        if len(local):
            x = self.descend(x, k, first, [arm], local, (3 * t, 2 * t, 1.5 * t, t))
            x = self.descend(x, k, first, list(range(max(0, arm - 2), k + 1)), local, (1.5 * t, t, t, 0.7 * t))
        else:
            local = self.points[:1]
        pairs = self.problem.matcher.match(self.problem.chain.pose(x), local, k + 1, first)
        found = int(np.count_nonzero(pairs.distance_m[pairs.starts[k] :] < self.tau_m))
        expected = float(np.median(parent.support)) if parent.support else 0.0
        lost = found < max(LEAST_SUPPORT, LOST_SHARE * expected)
        if alone and k > 2:
            score = explained(pairs.distance_m, self.tau_m) - self.bend_cost(x)
        else:
            score = self.score(x, k)
        return Hypothesis(x, score, arm if lost else None, (*parent.support, found))

    def descend(
        self, x: Array, k: int, first: int, joints: list[int], points: Array, scales_m: tuple[float, ...]
    ) -> Array:
        """Descend on some joints of segments ``first`` to k (from 0)."""
        rows = [BASE + 3 * j + i for j in joints for i in range(3)]
        if min(joints) < 3:
            rows += [0, 1, 3, 4, 5]
        moving = np.intersect1d(rows, self.problem.variables)
        stage = Stage("search", points, scales_m, self.noise_m, len(scales_m), 1e-4, k + 1, first, moving)
        return descend(self.problem, x, stage, self.settings, self.solver, self.log).x

    def explains(self, h: Hypothesis, k: int) -> bool:
        """Whether the points around segment k are on it, and enough of them."""
        pose = self.problem.chain.pose(h.x)
        length = float(self.problem.chain.segment_length_m[k])
        local = (self.cloud.within(pose.nodes_m[k], length) - pose.nodes_m[k]) @ pose.rotations[k]
        beside = np.hypot(local[:, 0], local[:, 1]) < self.problem.surface.reach_m + NEAR_M
        around = local[beside & (local[:, 2] > JOINT_SHARE * length) & (local[:, 2] < (1.0 - JOINT_SHARE) * length)]
        if len(around) < LEAST_SUPPORT:
            return False
        share = float(np.mean(self.problem.surface.section(k).distances(around[:, :2]) < self.tau_m))
        usual = float(np.median(h.support))
        return share >= EXPLAINED_SHARE and h.support[k] >= USUAL_SHARE * usual

    def searched(self, parent: Hypothesis, k: int) -> Iterator[Array]:
        """Yield the variables of the most promising directions of segment k (or its arm)."""
        first = k if parent.arm is None else parent.arm
        chain = self.problem.chain
        pose = chain.pose(parent.x)
        length = float(chain.segment_length_m[first : k + 1].sum())
        points = self.unexplained(parent, k, pose.nodes_m[first], length)
        if len(points) < LEAST_SUPPORT:
            return
        before = pose.rotations[first - 1] if first else np.eye(3)
        shifts = base_shifts(self.problem.chain) if first == 0 else np.zeros((1, 3))
        bends = joint_bends(self.problem, first, parent.x)
        row = BASE + 3 * first + 1
        designed = self.design[row : row + 2]
        turns = before @ bend_rotations(bends, float(self.design[row - 1]))
        field = self.fields((first + k) // 2)
        scores = np.stack([field.scores(points - pose.nodes_m[first] - s, turns, length) for s in shifts])
        scores -= 0.5 * (((bends - designed) / self.problem.prior_sd[row : row + 2]) ** 2).sum(axis=1)
        wanted = FIRST_CHILDREN if len(shifts) > 1 else CHILDREN
        taken: list[tuple[Array, Array]] = []
        for best in np.argsort(-scores, axis=None)[:MOST_LOOKED_AT]:
            shift, bend = shifts[best // len(bends)], bends[best % len(bends)]
            direction = turns[best % len(bends), :, 2] * length + shift
            if all(np.linalg.norm(direction - d) + np.linalg.norm(shift - s) > APART_M for d, s in taken):
                taken.append((direction, shift))
                x = parent.x.copy()
                x[:3] += shift
                # A base that may turn takes what its tolerance allows, the joint the rest.
                held = np.clip(bend - designed, chain.lower[4:6], chain.upper[4:6]) if first == 0 else np.zeros(2)
                if first == 0:
                    x[3:6] = [0.0, *held]
                # The rest of an arm goes on as designed.
                arm = slice(BASE + 3 * first, BASE + 3 * k + 3)
                x[arm] = self.design[arm]
                x[row : row + 2] = bend - held
                yield chain.clip(x)
            if len(taken) == wanted:
                return

    def turned(self, x: Array, k: int) -> Array:
        """Return the variables [6 + 3N], joints from k (from 0) on turned one by one to what they would explain."""
        x = x.copy()
        x[BASE + 3 * k :] = self.design[BASE + 3 * k :]
        for j in range(k, self.problem.element.segments):
            x = next(self.searched(Hypothesis(x, 0.0, None, ()), j), x)
        return x

    def unexplained(self, parent: Hypothesis, k: int, node: Array, length_m: float) -> Array:
        """Return up to 600 points near a node that no segment grown so far explains."""
        points = self.cloud.within(node, length_m)
        first = k if parent.arm is None else parent.arm
        if first and len(points):
            pairs = self.problem.matcher.match(self.problem.chain.pose(parent.x), points, first)
            points = points[pairs.order[pairs.distance_m > self.tau_m]]
        if len(points) > POINTS_A_SEARCH:
            points = self.rng.choice(points, POINTS_A_SEARCH, replace=False)
        return points

    def around(self, x: Array, grown: int | None = None, first: int = 0) -> Array:
        """Return the points that segments ``first`` to ``grown`` - 1 could explain, and their surroundings."""
        nodes = self.problem.chain.pose(x).nodes_m
        return self.cloud.around(nodes[first : None if grown is None else grown + 1])

    def score(self, x: Array, k: int | None = None, tau_m: float | None = None) -> float:
        """Return the points explained, each between 0 and 1, less the cost of the bends."""
        grown = None if k is None else k + 1
        points = self.around(x, grown)
        if not len(points):
            return -self.bend_cost(x)
        pairs = self.problem.matcher.match(self.problem.chain.pose(x), points, grown)
        return explained(pairs.distance_m, tau_m or self.tau_m) - self.bend_cost(x)

    def bend_cost(self, x: Array) -> float:
        """Return what the bends cost under the prior: minus the logarithm of their probability."""
        return 0.5 * float((((x - self.design) / self.problem.prior_sd)[BASE:] ** 2).sum())

    def supported(self, x: Array) -> int:
        """Return how many segments of a chain explain a dozen points."""
        n = self.problem.element.segments
        pairs = self.problem.matcher.match(self.problem.chain.pose(x), self.points)
        on = np.bincount(pairs.segment[pairs.distance_m < self.tau_m], minlength=n)
        return int(np.count_nonzero(on >= LEAST_SUPPORT))

    def best(self, hypotheses: list[Hypothesis], width: int) -> list[Hypothesis]:
        """Return the best distinct hypotheses, best first; refuted ones only where there are no others."""
        kept: list[Hypothesis] = []
        ranked = sorted(hypotheses, key=lambda h: -h.score)
        for h in ranked:
            nodes = self.problem.chain.pose(h.x).nodes_m
            grown = len(h.support) + 1
            others = (self.problem.chain.pose(o.x).nodes_m for o in kept)
            if all(np.abs(nodes[:grown] - o[:grown]).max() > DISTINCT_M for o in others):
                if len(ranked) == 1 or not self.refuted(h.x, len(h.support)):
                    kept.append(h)
            if len(kept) == width:
                break
        return kept or ranked[:1]

    def finish(self, x: Array) -> Array:
        """Descend on all joints, the scale shrinking to the noise."""
        return self._finished(x, (2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 0.7))

    def touched_up(self, x: Array) -> Array:
        """Descend on all joints from where nodes were moved to: a wider look would take them back."""
        return self._finished(x, (0.7,))

    def _finished(self, x: Array, scales: tuple[float, ...]) -> Array:
        if not len(points := self.around(x)):
            return x
        stage = Stage("search", points, tuple(s * self.tau_m for s in scales), self.noise_m, 20, 5e-5)
        return descend(self.problem, x, stage, self.settings, self.solver, self.log).x


def explained(distance_m: Array, tau_m: float) -> float:
    """Return ``sum max(0, 1 - d^2 / tau^2)``: how many points a surface explains."""
    return float(np.maximum(0.0, 1.0 - (distance_m / tau_m) ** 2).sum())
