"""Point residual: scan points pull the face they lie on (paper eq. 4, J'J and J'e)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]


def point_residual(pose: Pose, pairs: Correspondences, weights: Array) -> Objective:
    """Return the Gauss-Newton model of ``1/2 sum w r^2``, r the distance to the face.

    A face of segment k that moves with the twist (v, w) moves the residual of a point
    p by ``-n.v - (p x n).w``. So with a = [n, p x n] the points of a segment enter only
    as the 6 x 6 matrix ``M = sum w a a'`` and as ``m = sum w r a``, and with J the
    spatial Jacobian ``H = sum_k J_k' M_k J_k``, ``c = - sum_k J_k' m_k`` exactly.

    Args:
        pose: the chain the points were matched to.
        pairs: matches, possibly of the first segments only.
        weights: [P] weight of each match.
    """
    n = pose.n_segments
    M = np.zeros((n, 6, 6))
    m = np.zeros((n, 6))
    for k, (moment, pull) in enumerate(zip(*segment_moments(pairs, weights), strict=True)):
        X = _to_origin(pose.rotations[k], pose.nodes_m[k])
        M[k], m[k] = X @ moment @ X.T, X @ pull
    return assemble(pose.J, M, m)


def segment_moments(pairs: Correspondences, weights: Array) -> tuple[Array, Array]:
    """Return M [N][6][6] and m [N][6] of each segment, in its own frame and about its start."""
    n = len(pairs.starts) - 1
    x, y, z = pairs.local.T
    nx, ny = pairs.gradient.T
    # A normal of a lateral face has no axial part: row 2 of a = [n, p x n] stays zero.
    A = np.empty((6, len(x)))
    A[0], A[1], A[2], A[3], A[4], A[5] = nx, ny, -z * ny, z * nx, x * ny - y * nx, pairs.residual_m
    WA = A * weights
    rows = np.array([0, 1, 3, 4, 5])
    M = np.zeros((n, 6, 6))
    m = np.zeros((n, 6))
    for k in range(n):
        part = slice(pairs.starts[k], pairs.starts[k + 1])
        product = A[:, part] @ WA[:, part].T
        M[k][np.ix_(rows, rows)] = product[:5, :5]
        m[k, rows] = product[:5, 5]
    return M, m


def assemble(J: Array, M: Array, m: Array) -> Objective:
    """Return ``H = sum_k J_k' M_k J_k`` and ``c = -sum_k J_k' m_k``.

    J_k is J up to segment k's columns, so a column meets the sum of the matrices from
    its own segment to the tip (as in the composite rigid body algorithm).
    """
    owner = np.maximum((np.arange(J.shape[1]) - BASE) // 3, 0)
    tail_M = np.cumsum(M[::-1], axis=0)[::-1]
    tail_m = np.cumsum(m[::-1], axis=0)[::-1]
    Y = np.einsum("jab,bj->aj", tail_M[owner], J)
    H = np.triu(J.T @ Y)
    H += np.triu(H, 1).T
    return Objective(H, -np.einsum("ja,aj->j", tail_m[owner], J))


def _to_origin(R: Array, p: Array) -> Array:
    """Return X with [n, q x n] in the element's frame = X [n, q x n] in the segment's."""
    X = np.zeros((6, 6))
    X[:3, :3] = X[3:, 3:] = R
    X[3:, :3] = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]]) @ R
    return X
