"""Cramer-Rao bound: how well any unbiased method could know the nodes from one very scan.

A point on segment k with outward normal n measures the shift of its face, n'(v + w x p),
with the noise s of the scan across the face and nothing along it. So with a = [n, p x n]

    H = 1/s^2 sum_k J_k' (sum a a') J_k,    C = H^-1,    cov(node) = A C A'

with J_k and A the chain's Jacobians at the true angles. The kinematics are the fit's own
(`linear_ik.chain`, whose Jacobians tests/test_chain.py checks by finite differences); the
information is added up here from the simulator's points, normals and segments, without
the fit's matches, terms or weights. Those are the truth's: the bound is for a method that
makes no wrong match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik import Chain, Element, SimulatedScan

Array = npt.NDArray[np.float64]

BASE = 6
UNSEEN_M = 0.010


@dataclass(frozen=True, eq=False)
class Bound:
    """Standard deviations that no unbiased method can be better than.

    Attributes:
        node_m: [N] of each node but the first: root of the covariance's trace.
        observable: whether the scan shows every bend, that is: no node's deviation
            is above 10 mm.
    """

    node_m: Array
    observable: bool

    @property
    def rms_m(self) -> float:
        """Over the nodes."""
        return float(np.sqrt(np.mean(self.node_m**2)))

    @property
    def tip_m(self) -> float:
        """Of the last node."""
        return float(self.node_m[-1])


def cramer_rao(element: Element, scan: SimulatedScan, noise_m: float) -> Bound:
    """Return the bound for a scan whose truth is known; a held base is taken as known.

    Angles that no point shows are uniform within their limits: that is all that is known
    of them.
    """
    covariance = node_covariance(element, scan, noise_m)[1:]
    deviation = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    return Bound(deviation, bool(deviation.max() <= UNSEEN_M))


def node_covariance(element: Element, scan: SimulatedScan, noise_m: float) -> Array:
    """Return the least covariance [N+1][3][3] of the nodes, scan's coordinates, m^2.

    A base that may move is uniform within its tolerance. Faces count, end caps do not:
    no method that knows the lateral surface alone can use them.
    """
    chain = Chain.of(element)
    pose = chain.pose(chain.with_q(scan.q))
    R, t = scan.base_pose[:3, :3], scan.base_pose[:3, 3]
    on = scan.on_element
    points, normals, segment = (scan.points[on] - t) @ R, scan.surface_normals[on] @ R, scan.segment[on]
    reach = np.concatenate([chain.upper[:BASE], np.tile(element.joint_limit_rad[::-1], element.segments)])
    free = np.flatnonzero(reach > 0)
    information = np.diag(3.0 / reach[free] ** 2)
    a = np.column_stack([normals, np.cross(points, normals)])
    for k in range(1, element.segments + 1):
        along = pose.rotations[k - 1, :, 2]
        lateral = np.abs(normals @ along) < 0.5
        rows = a[(segment == k) & lateral] @ pose.segment_jacobian(k)[:, free]
        information += rows.T @ rows / max(noise_m, 1e-9) ** 2
    scale = 1.0 / np.sqrt(np.diag(information))
    C = np.linalg.inv(information * scale * scale[:, None]) * scale * scale[:, None]
    A = R @ pose.node_jacobians()[:, :, free]
    return np.asarray(np.einsum("kai,ij,kbj->kab", A, C, A, optimize=True))
