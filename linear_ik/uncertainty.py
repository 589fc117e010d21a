"""Uncertainty: the noise of the scan as the fit sees it, and the covariance of the nodes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.problem import Problem
from linear_ik.side_noise import MAD_TO_SD
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]

SMALLEST_NOISE_M, LARGEST_NOISE_M = 2e-5, 0.010
LEAST_FREEDOM = 0.3  # of the patches
PRESSED, STRAINED = 3.0, 4 / 3


def noise_of(pairs: Correspondences, weights: Array | None = None) -> float:
    """Return the standard deviation of the matched points about the surface, robustly.

    The median of the absolute residuals of the points with weight, times 1.4826 (exact
    for a normal distribution). At most 10 mm: what scatters more is no surface.
    """
    residual = np.abs(pairs.residual_m if weights is None else pairs.residual_m[weights > 0])
    if not len(residual):
        return LARGEST_NOISE_M
    return min(max(MAD_TO_SD * float(np.median(residual)), SMALLEST_NOISE_M), LARGEST_NOISE_M)


def point_noise(points: Array, cloud: Array, rng: np.random.Generator) -> float:
    """Return the noise of a cloud before anything is fitted: the roughness of small patches.

    Lower quartile over patches of the smallest principal deviation of a dozen neighbours,
    which for neighbours on a plane is the noise across it. Not the median: around thin
    plates most patches take points of both sides.

    Args:
        points: [P][3] candidates for the patches' centres.
        cloud: [C][3] the cloud the neighbours are taken from.
        rng: chooses up to 200 patches.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(cloud, balanced_tree=False, compact_nodes=False)
    centres = points if len(points) <= 200 else rng.choice(points, 200, replace=False)
    _, rows = tree.query(centres, k=min(12, len(cloud)))
    patches = cloud[rows] - cloud[rows].mean(axis=1, keepdims=True)
    smallest = np.linalg.svd(patches, compute_uv=False)[:, -1]
    return float(np.quantile(smallest, 0.25) / np.sqrt(max(rows.shape[1] - 3, 1)))


def covariance(problem: Problem, pose: Pose, objective: Objective, noise_m: float) -> tuple[Array, Array]:
    """Return the covariance of the variables and of the nodes.

    The inverse of the information of all terms (points, priors, supports), the
    Cramer-Rao bound where the points are normal and rightly matched, carried to the
    nodes by their Jacobian: ``S = s^2 H^-1``, ``C_k = A_k S A_k'``.

    Args:
        problem: for the variables that may move; the others have no variance. A slide
            along the axis counts as free even where the fit held it.
        pose: the fitted chain.
        objective: sum of all terms but the damping, over all variables.
        noise_m: s, standard deviation of a point.

    Returns:
        [6 + 3N][6 + 3N] of the variables; [N+1][3][3] of the nodes, element's frame, m^2.
    """
    if problem.may_slide:
        problem = problem.released()
    rows = np.ix_(problem.variables, problem.variables)
    S = np.zeros_like(objective.H)
    H = objective.H[rows]
    scale = 1.0 / np.sqrt(np.diag(H))
    S[rows] = noise_m**2 * np.linalg.inv(H * scale * scale[:, None]) * scale * scale[:, None]
    A = pose.node_jacobians()
    return S, np.einsum("kai,ij,kbj->kab", A, S, A, optimize=True)


def birge_ratio(problem: Problem, scores: Array, points: Objective, whole: Objective) -> float:
    """Return by how much more the patches of a surface are off than independent errors of the points explain.

    Scanners err by the patch: points share what registration, slanted faces, mixed
    pixels and a section that is not quite as designed do to them, so that covariances
    of independent points are too small. ``chi^2 / (patches - fitted variables)`` is the
    factor on them that makes the patches' scatter its own (Birge, 1932); 1 where chance
    explains it.

    Args:
        problem: for the variables that may move.
        scores: [N][sides][halves] of the patches, standard normal were the points independent; NaN where too few.
        points: what the points ask of the step, over all variables.
        whole: the same with all terms.
    """
    rows, scores = np.ix_(problem.variables, problem.variables), scores[np.isfinite(scores)]
    # A variable that the prior holds is not fitted to the patches.
    fitted = float(np.trace(np.linalg.solve(whole.H[rows], points.H[rows])))
    freedom = max(len(scores) - fitted, LEAST_FREEDOM * len(scores), 1.0)
    chi2 = float(scores @ scores)
    # Chance alone takes chi^2 a deviation, sqrt(2 freedom), above its mean now and then.
    return chi2 / freedom if chi2 > freedom + float(np.sqrt(2.0 * freedom)) else 1.0


def pressed_limits(
    problem: Problem, x: Array, objective: Objective, S: Array, scatter_m: Array
) -> npt.NDArray[np.bool_]:
    """Return which variables [6 + 3N] the data push against their limit.

    By 3 deviations or more: a member that was bent to exactly its limit rests on it by chance of the noise. Or where
    the points of a segment beside scatter a third more than others do: what its limit keeps from its points has lost
    their weight, and with it most of the push.

    Args:
        problem: for the limits.
        x: [6 + 3N] where the fit is.
        objective: what all terms still ask for there.
        S: [6 + 3N][6 + 3N] covariance.
        scatter_m: [N] rms of the matched points of each segment; NaN without any.
    """
    rows = problem.variables
    push = np.zeros(len(x))
    push[rows] = -np.linalg.solve(objective.H[np.ix_(rows, rows)], objective.c[rows])
    lower, upper = problem.chain.lower, problem.chain.upper
    at = ((x <= lower) & (push < 0)) | ((x >= upper) & (push > 0))
    far = np.abs(push) > PRESSED * np.sqrt(np.diag(S))
    seen = np.isfinite(scatter_m)
    usual_m = np.median(scatter_m[seen]) if seen.any() else np.inf
    worse = np.where(seen, scatter_m, 0.0) > STRAINED * usual_m
    worse[1:] |= worse[:-1].copy()  # a joint is the start of its segment and the end of the one before
    far[BASE:] |= np.repeat(worse, 3)
    return np.asarray(at & far & (upper > lower))
