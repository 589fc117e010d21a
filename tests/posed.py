"""Results whose chain is bent by hand, and known as exactly as one likes."""

from __future__ import annotations

import numpy as np

from linear_ik.chain import Chain
from linear_ik.element import Element, Placement
from linear_ik.profile import Rectangle
from linear_ik.result import FitResult, SegmentResult
from linear_ik.settings import FitSettings

H = Rectangle(0.1, 0.2)
UTM = (512345.678, 5403210.123, 412.5)
BEAM = Placement(UTM, axis=(1.0, 0.0, 0.0), ref_direction=(0.0, 1.0, 0.0))  # local X = north, Y = up
COLUMN = Placement(UTM, axis=(0.0, 0.0, 1.0), ref_direction=(1.0, 0.0, 0.0))


def posed(element: Element, angles_rad: np.ndarray, sd_rad: float = 1e-4, status: str = "converged") -> FitResult:
    """A result whose chain has these angles [N][3], each with the same deviation."""
    n, T = element.segments, element.placement.T_world_element
    q = angles_rad[:, ::-1].ravel()
    chain = Chain.of(element)
    pose = chain.pose(chain.with_q(q))
    S = np.zeros((6 + 3 * n, 6 + 3 * n))
    S[6:, 6:] = sd_rad**2 * np.eye(3 * n)
    A, R = pose.node_jacobians(), T[:3, :3]
    return FitResult(
        element=element,
        status=status,  # type: ignore[arg-type]
        reasons=(),
        nodes_m=pose.nodes_m @ R.T + T[:3, 3],
        nodes_covariance_m2=R @ np.einsum("kai,ij,kbj->kab", A, S, A) @ R.T,
        q=q,
        joint_angles_rad=angles_rad,
        joint_limits_rad=element.joint_limits_rad,
        base_pose=T,
        rmse_m=0.005,
        surface_rmse_m=0.001,
        range_noise_m=0.001,
        segments=(SegmentResult("measured", 100, 1.0, 0.001),) * n,
        history=(),
        settings=FitSettings(),
        configuration_covariance=S,
    )


def bent(element: Element, axis: int, curvature_1_m: float) -> np.ndarray:
    """Angles [N][3] of a chain that starts along its design and turns equally at each joint after."""
    angles = np.zeros((element.segments, 3))
    angles[1:, axis] = curvature_1_m * element.segment_length_m
    return angles
