"""Point residual: scan points pull the face they lie on (paper eq. 4, J'J and J'e)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

ROWS = np.array([0, 1, 3, 4, 5])  # of a = [n, p x n], where faces run along the axis


def point_residual(pose: Pose, pairs: Correspondences, weights: Array, columns: Index | None = None) -> Objective:
    """Return the Gauss-Newton model of ``1/2 sum w r^2``, r the distance to the face.

    A face of segment k that moves with the twist (v, w) moves the residual of a point
    p by ``-n.v - (p x n).w``. So with a = [n, p x n] the points of a segment enter only
    as the 6 x 6 matrix ``M = sum w a a'`` and as ``m = sum w r a``, and with J the
    spatial Jacobian ``H = sum_k J_k' M_k J_k``, ``c = - sum_k J_k' m_k`` exactly.

    Args:
        pose: the chain the points were matched to.
        pairs: matches, possibly of the first segments only.
        weights: [P] weight of each match.
        columns: [n] the variables to say something about; all [6 + 3N] when None.
    """
    n = len(pairs.starts) - 1
    M, m = segment_moments(pairs, weights)
    X = _to_origin(pose.rotations[:n], pose.nodes_m[:n])
    M, m = X @ M @ X.transpose(0, 2, 1), np.einsum("kij,kj->ki", X, m)
    columns = np.arange(pose.J.shape[1]) if columns is None else columns
    return assemble(pose.J[:, columns], np.maximum((columns - BASE) // 3, 0), M, m)


def segment_moments(pairs: Correspondences, weights: Array) -> tuple[Array, Array]:
    """Return M [N][6][6] and m [N][6] of each segment, in its own frame and about its start."""
    if pairs.axial is not None:
        return _tapered_moments(pairs, pairs.axial, weights)
    n = len(pairs.starts) - 1
    x, y, z = pairs.local.T
    nx, ny = pairs.gradient.T
    # A normal of a lateral face has no axial part: row 2 of a = [n, p x n] stays zero.
    A = np.empty((6, len(x)))
    A[0], A[1], A[2], A[3], A[4], A[5] = nx, ny, -z * ny, z * nx, x * ny - y * nx, pairs.residual_m
    WA = A * weights
    products = np.zeros((n, 6, 6))
    for k in np.flatnonzero(np.diff(pairs.starts)):
        part = slice(pairs.starts[k], pairs.starts[k + 1])
        np.matmul(A[:, part], WA[:, part].T, out=products[k])
    M, m = np.zeros((n, 6, 6)), np.zeros((n, 6))
    M[:, ROWS[:, None], ROWS] = products[:, :5, :5]
    m[:, ROWS] = products[:, :5, 5]
    return M, m


def _tapered_moments(pairs: Correspondences, nz: Array, weights: Array) -> tuple[Array, Array]:
    """Return the moments of faces that lean against the axis, all of a = [n, p x n]."""
    n = len(pairs.starts) - 1
    x, y, z = pairs.local.T
    nx, ny = pairs.gradient.T
    A = np.stack([nx, ny, nz, y * nz - z * ny, z * nx - x * nz, x * ny - y * nx, pairs.residual_m])
    WA = A * weights
    M, m = np.zeros((n, 6, 6)), np.zeros((n, 6))
    for k in np.flatnonzero(np.diff(pairs.starts)):
        part = slice(pairs.starts[k], pairs.starts[k + 1])
        product = A[:, part] @ WA[:, part].T
        M[k], m[k] = product[:6, :6], product[:6, 6]
    return M, m


def assemble(J: Array, owner: Index, M: Array, m: Array) -> Objective:
    """Return ``H = sum_k J_k' M_k J_k`` and ``c = -sum_k J_k' m_k``.

    J_k is J up to segment k's columns, so a column meets the sum of the matrices from
    its own segment to the tip (as in the composite rigid body algorithm).

    Args:
        J: [6][n] columns of the spatial Jacobian.
        owner: [n] segment that each column turns, ascending.
        M: [K][6][6] moments of the first K segments, about the element's origin.
        m: [K][6] pulls of the same.
    """
    # Segments that nothing was matched to, past the last one, move nothing.
    tail_M = np.concatenate([np.cumsum(M[::-1], axis=0)[::-1], np.zeros((1, 6, 6))])
    tail_m = np.concatenate([np.cumsum(m[::-1], axis=0)[::-1], np.zeros((1, 6))])
    owner = np.minimum(owner, len(M))
    Y = np.einsum("jab,bj->aj", tail_M[owner], J)
    H = np.triu(J.T @ Y)
    H += np.triu(H, 1).T
    return Objective(H, -np.einsum("ja,aj->j", tail_m[owner], J))


def _to_origin(R: Array, p: Array) -> Array:
    """Return X [K][6][6] with [n, q x n] in the element's frame = X [n, q x n] in the segment's."""
    X = np.zeros((len(R), 6, 6))
    X[:, :3, :3] = X[:, 3:, 3:] = R
    cross = np.zeros((len(R), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    X[:, 3:, :3] = (cross - cross.transpose(0, 2, 1)) @ R
    return X
