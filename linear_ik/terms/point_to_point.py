"""Point to point: model points are pulled to the scan points they were matched with (paper eqs. 3 to 6)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.cloud_pairs import CloudPairs
from linear_ik.terms.objective import Objective
from linear_ik.terms.point_residual import assemble

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


def point_to_point(pose: Pose, pairs: CloudPairs, weights: Array, columns: Index) -> Objective:
    """Return the Gauss-Newton model of ``1/2 sum w |t - s|^2``.

    A model point s on segment k moves with the twist (v, w) by ``v + w x s`` (eq. 3), so
    with B = [I, -s x] its segment's points enter as ``M = sum w B' B`` and
    ``m = sum w B' (t - s)``, and ``H = sum_k J_k' M_k J_k``, ``c = - sum_k J_k' m_k`` are
    the J'J and J'e of eqs. 5 and 6.

    Args:
        pose: the chain the model points were taken from.
        pairs: matched points, sorted by segment.
        weights: [P] weight of each pair.
        columns: [n] the variables to say something about.
    """
    n = pose.n_segments
    M, m = np.zeros((n, 6, 6)), np.zeros((n, 6))
    pull = weights[:, None] * (pairs.target - pairs.source)
    torque = np.cross(pairs.source, pull)
    for k in np.flatnonzero(np.diff(pairs.starts)):
        rows = slice(pairs.starts[k], pairs.starts[k + 1])
        s, w = pairs.source[rows], weights[rows]
        first, second = w @ s, (s * w[:, None]).T @ s
        cross = np.array([[0.0, -first[2], first[1]], [first[2], 0.0, -first[0]], [-first[1], first[0], 0.0]])
        M[k, :3, :3] = w.sum() * np.eye(3)
        M[k, 3:, :3], M[k, :3, 3:] = cross, cross.T
        M[k, 3:, 3:] = np.trace(second) * np.eye(3) - second
        m[k] = np.concatenate([pull[rows].sum(axis=0), torque[rows].sum(axis=0)])
    return assemble(pose.J[:, columns], np.maximum((columns - BASE) // 3, 0), M, m)
