"""Straightening: bends that few points ask for are put back where the chain is more probable without them.

Where a face shows few points, these may have been taken for the other side of a plate, or are none of
the face's: mixed pixels, or a neighbour's. Followed, they bend joints that nothing else bends. A chain
without those bends explains the points a little worse, and may be far more probable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from linear_ik.descent import Descended, step_objective
from linear_ik.evidence import evidence, joints_by_axis, unlikelihood
from linear_ik.problem import Problem
from linear_ik.repair import drawn_back, straighter, through
from linear_ik.stage import robust_cost

Array = npt.NDArray[np.float64]

MOST_STRAIGHTENED = 4
LEAST_LIKELIER = 1.0  # log likelihood


def straightened(
    problem: Problem,
    found: Descended,
    noise_m: float,
    robust_scale: float,
    down: Callable[[Problem, Array], Descended],
) -> tuple[Problem, Descended]:
    """Return a problem's prior and its fit, or those of a straighter chain that is more probable.

    Tried are the chain itself and those with nodes that stick out put back between their neighbours, each under a
    prior that is stiff in every joint at first; then which of them bend is told again. They compete by what the points
    cost, ``sum s^2 r^2 / (s^2 + r^2) / 2`` in deviations of the noise (Geman and McClure's, of which the weights are),
    and what the joints cost (`evidence.unlikelihood`).

    Args:
        problem: with the prior that the fit was made under.
        found: the fit.
        noise_m: standard deviation of a point.
        robust_scale: s, in deviations of the noise.
        down: descends from variables [6 + 3N] under a problem's prior.
    """

    def cost(there: Problem, at: Descended) -> float:
        points = 0.5 * robust_scale**2 * robust_cost(at.pairs.distance_m, robust_scale * noise_m)
        objective = step_objective(there, at.x, at.pose, at.pairs, at.weights, noise_m)
        return points + unlikelihood(there, at.x, objective, noise_m)

    def likely(x: Array) -> tuple[Problem, Descended]:
        stiff = problem.expecting(stiffest(problem.prior_sd))
        at = down(stiff, x)
        objective = step_objective(stiff, at.x, at.pose, at.pairs, at.weights, noise_m)
        there = stiff.expecting(*evidence(stiff, at.x, objective, noise_m))
        return there, down(there, at.x)

    best = cost(problem, found)
    for _ in range(MOST_STRAIGHTENED):
        chain, x, pose = problem.chain, found.x, found.pose
        put_back = (drawn_back(chain, through(chain, x, nodes), pose, nodes) for nodes in straighter(pose))
        for start in (x, *put_back):
            there, trial = likely(start)
            if (value := cost(there, trial)) < best - LEAST_LIKELIER:
                problem, found, best = there, trial, value
                break
        else:
            break
    return problem, found


def stiffest(prior_sd: Array) -> Array:
    """Return prior deviations [6 + 3N], those of an axis's joints from 2 on all as small as their smallest."""
    sd: Array = prior_sd.copy()
    for joints in joints_by_axis(len(sd)):
        sd[joints] = sd[joints].min(initial=np.inf)
    return sd
