"""Evidence: how much a member bends is told by its own scan, as the strength of the prior on its joints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.descent import Descended
from linear_ik.problem import BEND_SD_RAD, TWIST_SD_RAD, Problem
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

EVIDENCE_ROUNDS = 12
# Degrees of freedom of Student's distribution of the angles: many joints that hardly bend, and few that kink.
FREEDOM = 2.0
STIFFEST_RAD, LOOSEST_RAD = np.radians(0.02), np.radians(20.0)


def joints_by_axis(variables: int) -> list[Index]:
    """Return which of the variables turn joints from 2 on about z, y and x: those that the evidence speaks of."""
    return [np.arange(BASE + 3 + axis, variables, 3) for axis in range(3)]


def evidence(problem: Problem, x: Array, objective: Objective, noise_m: float) -> tuple[Array, Array]:
    """Return the prior's deviations and means [6 + 3N] that make the joints from 2 on most probable.

    A joint's angles, less the design's, follow Student's distribution about what all joints bend alike: a normal
    one, whose variances are those of the axes, s_a^2, times a factor that the joint draws for itself. By expectation
    maximisation on the Gaussian model of the last step (Liu and Rubin 1995; s as Kent, Tyler and Vardi 1994, which
    takes a tenth of the rounds), with theta and S a joint's mean and variance under the prior so far,
    ``m_ia = (theta_ia - u_a)^2 + S_ii`` and ``w_i = (nu + d) / (nu + sum_a m_ia / s_a^2)`` of d axes:
    ``u_a = sum_i w_i theta_ia / sum_i w_i``, ``s_a^2 = sum_i w_i m_ia / sum_i w_i``, and the joint's variances are
    ``s_a^2 / w_i``. A straight member earns a stiff prior, and so does an arc, about its bend; one sharp kink loosens
    its own joint, about all axes, and leaves the others stiff.

    Args:
        problem: with the prior that ``objective`` contains.
        x: [6 + 3N] where the fit is.
        objective: sum of all terms but the damping, at x.
        noise_m: standard deviation of a point.
    """
    sd, mean = problem.prior_sd.copy(), problem.prior_mean.copy()
    if problem.element.segments < 3:
        return sd, mean
    moving = problem.variables
    now = 1.0 / sd[moving] ** 2
    information = objective.H[np.ix_(moving, moving)] / noise_m**2 - np.diag(now)
    # Right-hand side of the normal equations of the points alone, in the departure from the design instead of dx.
    off = (x - problem.designed)[moving]
    pull = information @ off - (objective.c[moving] / noise_m**2 - now * (x - mean)[moving])
    rows = [
        (joints, np.searchsorted(moving, joints)) for joints in joints_by_axis(len(sd)) if np.isin(joints, moving).all()
    ]
    scale = np.array([[np.mean(sd[joints] ** 2)] for joints, _ in rows])
    alike = (mean - problem.designed)[moving]
    diagonal = np.diag_indices(len(moving))
    for _ in range(EVIDENCE_ROUNDS if len(moving) <= 200 else 3):
        before, expected = sd.copy(), alike.copy()
        posterior = information.copy()
        posterior[diagonal] += 1.0 / sd[moving] ** 2
        S = np.linalg.inv(posterior)
        theta, variance = S @ (pull + alike / sd[moving] ** 2), np.diag(S)
        moment = np.array([(theta[at] - alike[at]) ** 2 + variance[at] for _, at in rows])  # [axes][joints]
        weight = (FREEDOM + len(rows)) / (FREEDOM + (moment / scale).sum(axis=0))
        scale = (moment @ weight / weight.sum())[:, None]
        for (joints, at), own in zip(rows, scale / weight, strict=True):
            alike[at] = weight @ theta[at] / weight.sum()
            sd[joints] = np.clip(np.sqrt(own), STIFFEST_RAD, LOOSEST_RAD)
        if (np.abs(sd - before) <= 0.02 * before).all() and (np.abs(alike - expected) <= 0.02 * sd[moving]).all():
            break
    mean[moving] = problem.designed[moving] + alike
    return sd, mean


def alike_unknown(problem: Problem, noise_m: float) -> Array:
    """Return what [6 + 3N][6 + 3N] the prior's part of an objective's H is too large by, as nobody was told its mean.

    What all joints bend alike, u_a, was told by the points themselves. With P the joints' prior precisions and u_a
    itself normal about the design, as loose as the prior was at first, ``P - P 1 1' P / (1' P 1 + 1 / sd^2)`` is left.

    Args:
        problem: with the prior that the objective contains.
        noise_m: standard deviation of a point.
    """
    out = np.zeros((len(problem.prior_sd),) * 2)
    if problem.element.segments < 3:
        return out
    for joints, sd in zip(joints_by_axis(len(out)), (TWIST_SD_RAD, BEND_SD_RAD, BEND_SD_RAD), strict=True):
        p = (noise_m / problem.prior_sd[joints]) ** 2
        out[np.ix_(joints, joints)] = np.outer(p, p) / (p.sum() + (noise_m / sd) ** 2)
    return out


def unlikelihood(problem: Problem, x: Array, objective: Objective, noise_m: float) -> float:
    """Return what a fit's joints cost, in units of the log likelihood: the negative of the evidence's lower bound.

    The Gaussian model of the last step, with its mean and covariance S under the problem's prior, against Student's
    distribution, with ``m_ia`` as in `evidence`: ``tr(S H) / 2 - log |S| / 2 + sum_i (nu + d) / 2 log(1 + sum_a
    m_ia / (nu s_a^2)) + n sum_a log s_a``, the scales s_a as they are most probable. What the points cost is not in it.

    Args:
        problem: with the prior that ``objective`` contains.
        x: [6 + 3N] where the fit is.
        objective: sum of all terms but the damping, at x.
        noise_m: standard deviation of a point.
    """
    moving = problem.variables
    H = objective.H[np.ix_(moving, moving)] / noise_m**2
    S = np.linalg.inv(H)
    points = H - np.diag(1.0 / problem.prior_sd[moving] ** 2)
    off = (x - problem.prior_mean) ** 2
    variance = np.zeros(len(x))
    variance[moving] = np.diag(S)
    moment = np.array([(off + variance)[joints] for joints in joints_by_axis(len(x)) if np.isin(joints, moving).all()])
    scale = moment.mean(axis=1, keepdims=True)
    for _ in range(3 * EVIDENCE_ROUNDS):
        weight = (FREEDOM + len(moment)) / (FREEDOM + (moment / scale).sum(axis=0))
        scale = np.maximum((moment @ weight / weight.sum())[:, None], STIFFEST_RAD**2)
    kinks = 0.5 * (FREEDOM + len(moment)) * np.log1p((moment / scale).sum(axis=0) / FREEDOM).sum()
    spread = 0.5 * moment.shape[1] * np.log(scale).sum()
    return float(0.5 * np.einsum("ij,ji->", S, points) - 0.5 * np.linalg.slogdet(S)[1] + kinks + spread)


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
