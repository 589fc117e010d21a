"""Ends: where an element begins and stops along its axis, and whether it stands where it is held.

Faces say nothing of a slide along them. Where the points themselves begin and stop, and
nothing continues beyond, the two ends say how far the element has slid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.correspondence import Correspondences
from linear_ik.problem import AXIAL, Problem
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]

AGREEMENT_M = 0.012
LEAST_SD_M = 0.002
LEAST_POINTS = 30
EXTREME = 3  # the third point from the end, against strays
ON_SURFACE = 4.0  # deviations
LEAST_SHIFT_M = 0.002
SIGNIFICANT = 11.8  # chi-square of 2 degrees of freedom at 3 sigma
LOOSE_M = 0.1


@dataclass(frozen=True)
class Slide:
    """How far along its axis an element lies from where the chain is.

    Attributes:
        shift_m: towards the end node.
        sd_m: its standard deviation.
    """

    shift_m: float
    sd_m: float


def slide_of_ends(problem: Problem, pairs: Correspondences, noise_m: float) -> Slide | None:
    """Return the slide that both ends of the point cloud agree on to 12 mm, or None.

    With a the height at which points begin above the start node and b the height by which
    they pass the end node, an element that slid shows a = b; one that is hidden at an end,
    or continued by something else, does not.
    """
    ends = []
    for k, sign in ((0, 1.0), (len(pairs.starts) - 2, -1.0)):
        rows = slice(pairs.starts[k], pairs.starts[k + 1])
        on = np.abs(pairs.residual_m[rows]) <= ON_SURFACE * noise_m
        z = np.sort(sign * pairs.local[rows, 2][on])
        if len(z) < LEAST_POINTS:
            return None
        spacing = float(z[2 * EXTREME] - z[0]) / 2
        ends.append((sign * float(z[EXTREME - 1]), spacing))
    (begin, first), (stop, last) = ends
    a, b = begin, stop - float(problem.chain.segment_length_m[-1])
    if abs(a - b) > AGREEMENT_M:
        return None
    return Slide((a + b) / 2, max(LEAST_SD_M, abs(a - b) / 2, first, last))


def shift_at_start(problem: Problem, points: Objective, others: Objective, noise_m: float) -> Array | None:
    """Return how far across the axis [2] the points put a held start from its place, or None.

    A score test: the step that the normal equations ask for once the start is let go.
    None where the start may move anyway, or where they ask for less than 2 mm or 3 sigma.

    Args:
        problem: for the support and the prior.
        points: what all points ask of the step, over all variables [6 + 3N].
        others: all other terms but the damping; its prior on a held base is undone.
        noise_m: standard deviation of a point.
    """
    held = np.array([0, 1])
    if problem.chain.upper[0] > problem.chain.lower[0]:
        return None
    rows = np.union1d(problem.variables, held)
    H, c = points.H + others.H, points.c + others.c
    H[held, held] += (noise_m / LOOSE_M) ** 2 - (noise_m / problem.prior_sd[held]) ** 2
    inverse = np.linalg.inv(H[np.ix_(rows, rows)])
    at = np.searchsorted(rows, held)
    shift = -(inverse @ c[rows])[at]
    spread = noise_m**2 * inverse[np.ix_(at, at)]
    if np.linalg.norm(shift) < LEAST_SHIFT_M or shift @ np.linalg.solve(spread, shift) < SIGNIFICANT:
        return None
    return np.asarray(shift)


def anchored(problem: Problem, x: Array, slide: Slide) -> Problem:
    """Return the problem with the slide free, and expected where the ends say."""
    mean, sd = problem.prior_mean.copy(), problem.prior_sd.copy()
    lower, upper = problem.chain.lower[AXIAL], problem.chain.upper[AXIAL]
    mean[AXIAL] = min(max(float(x[AXIAL]) + slide.shift_m, float(lower)), float(upper))
    sd[AXIAL] = slide.sd_m
    return problem.expecting(sd, mean).released()
