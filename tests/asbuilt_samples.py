"""Results that are made by hand: an element bent at random, and what a fit would say of it."""

from __future__ import annotations

import numpy as np

from linear_ik.bending import bend_element, rigid_motion
from linear_ik.element import Element
from linear_ik.result import FitResult, SegmentResult
from linear_ik.settings import FitSettings


def result_of(
    element: Element,
    joint_angles_rad: np.ndarray | None = None,
    displacement: np.ndarray | None = None,
    sigma_m: float = 0.0005,
    status: str = "converged",
) -> FitResult:
    """The result of a fit that found the element in this shape, each node with the same standard deviation."""
    bent = bend_element(element, joint_angles_rad=joint_angles_rad, displacement=displacement)
    n = element.segments
    return FitResult(
        element=element,
        status=status,  # type: ignore[arg-type]
        reasons=() if status == "converged" else ("The element is not in the scan.",),
        nodes_m=bent.nodes_m,
        nodes_covariance_m2=np.tile(sigma_m**2 * np.eye(3), (n + 1, 1, 1)),
        q=bent.q,
        joint_angles_rad=bent.joint_angles_rad,
        joint_limits_rad=element.joint_limits_rad,
        base_pose=bent.base_pose,
        rmse_m=0.005,
        surface_rmse_m=0.001,
        range_noise_m=0.001,
        segments=(SegmentResult("measured", 100, 0.9, 0.001),) * n,
        history=(),
        settings=FitSettings(),
        timings_s={"total": 0.1},
    )


def random_result(element: Element, seed: int, largest_rad: float = 0.01, **more: object) -> FitResult:
    """The element bent and moved at random."""
    rng = np.random.default_rng(seed)
    angles = element.design.angles_rad + rng.uniform(-largest_rad, largest_rad, (element.segments, 3))
    angles[:, 2] = element.design.angles_rad[:, 2]
    moved = rigid_motion(rng.uniform(-0.01, 0.01, 3), rng.uniform(-0.3, 0.3, 3))
    return result_of(element, angles, moved, **more)
