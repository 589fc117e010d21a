"""Evidence: how much a member bends is told by its own scan, as the strength of the prior on its joints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.descent import (
    Descended,
)
from linear_ik.problem import Problem
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

EVIDENCE_ROUNDS = 12
# Degrees of freedom of Student's distribution of the angles: many joints that hardly bend, and few that kink.
FREEDOM = 2.0
STIFFEST_RAD, LOOSEST_RAD = np.radians(0.02), np.radians(20.0)


def evidence(problem: Problem, x: Array, objective: Objective, noise_m: float) -> Array:
    """Return the prior's deviations [6 + 3N] that make the joints from 2 on most probable.

    The angles of a joint, against the design, follow Student's distribution: a normal one, whose variances are those
    of the axes, s_a^2, times a factor that the joint draws for itself. By expectation maximisation on the Gaussian
    model of the last step (Liu and Rubin 1995; s as Kent, Tyler and Vardi 1994, which takes a tenth of the rounds),
    with ``m_ia = theta_ia^2 + S_ii`` and ``w_i = (nu + d) / (nu + sum_a m_ia / s_a^2)`` of d axes:
    ``s_a^2 = sum_i w_i m_ia / sum_i w_i``, and the joint's variances are ``s_a^2 / w_i``. A straight member earns a
    stiff prior; one sharp kink loosens its own joint, about all axes, and leaves the others stiff.

    Args:
        problem: with the prior that ``objective`` contains.
        x: [6 + 3N] where the fit is.
        objective: sum of all terms but the damping, at x.
        noise_m: standard deviation of a point.
    """
    if problem.element.segments < 3:
        return problem.prior_sd
    moving = problem.variables
    sd, now = problem.prior_sd.copy(), 1.0 / problem.prior_sd[moving] ** 2
    information = objective.H[np.ix_(moving, moving)] / noise_m**2 - np.diag(now)
    # Right-hand side of the normal equations of the points alone, in the departure from the design instead of dx.
    off = (x - problem.prior_mean)[moving]
    pull = information @ off - (objective.c[moving] / noise_m**2 - now * off)
    axes = [np.arange(BASE + 3 + axis, len(sd), 3) for axis in range(3)]
    rows = [(joints, np.searchsorted(moving, joints)) for joints in axes if np.isin(joints, moving).all()]
    scale = np.array([[np.mean(sd[joints] ** 2)] for joints, _ in rows])
    diagonal = np.diag_indices(len(moving))
    for _ in range(EVIDENCE_ROUNDS if len(moving) <= 200 else 3):
        before = sd.copy()
        posterior = information.copy()
        posterior[diagonal] += 1.0 / sd[moving] ** 2
        S = np.linalg.inv(posterior)
        second_moment = (S @ pull) ** 2 + np.diag(S)
        moment = np.array([second_moment[at] for _, at in rows])  # [axes][joints]
        weight = (FREEDOM + len(rows)) / (FREEDOM + (moment / scale).sum(axis=0))
        scale = (moment @ weight / weight.sum())[:, None]
        for (joints, _), variance in zip(rows, scale / weight, strict=True):
            sd[joints] = np.clip(np.sqrt(variance), STIFFEST_RAD, LOOSEST_RAD)
        if (np.abs(sd - before) <= 0.02 * before).all():
            break
    return np.asarray(sd)


def prior_move(before: Problem, after: Problem, found: Descended, objective: Objective, noise_m: float) -> float:
    """Return how far a change of the prior moves any node, in metres, by the linear model of the last step.

    Args:
        before: with the prior that ``objective`` contains.
        after: with the new one.
        found: where the fit is.
        objective: sum of all terms but the damping, at ``found``.
        noise_m: standard deviation of a point.
    """
    moving = after.variables
    old, new = ((noise_m / p.prior_sd) ** 2 for p in (before, after))
    pull = new * (found.x - after.prior_mean) - old * (found.x - before.prior_mean)
    step = np.zeros(len(pull))
    H = objective.H[np.ix_(moving, moving)] + np.diag((new - old)[moving])
    step[moving] = -np.linalg.solve(H, pull[moving])
    return float(np.abs(found.pose.node_jacobians() @ step).max())
