"""What a fit is judged by, written out in plain numpy: none of it is the package's own code."""

from __future__ import annotations

from typing import get_args

import numpy as np

from linear_ik.element import Element
from linear_ik.profile import Profile
from linear_ik.reason import ReasonCode
from linear_ik.result import FitResult, status_of
from linear_ik.simulate import SimulatedScan


def turn(x: float, y: float, z: float) -> np.ndarray:
    """R = Rz Ry Rx of one joint."""
    Rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    Ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    Rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return Rz @ Ry @ Rx


def kinematics(base_pose: np.ndarray, angles_rad: np.ndarray, length_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotations [N][3][3] and nodes [N+1][3] of a chain with joint angles [N][3] about x, y, z."""
    R, p = base_pose[:3, :3], base_pose[:3, 3]
    rotations, nodes = [], [p]
    for angles in angles_rad:
        R = R @ turn(*angles)
        p = p + length_m * R[:, 2]
        rotations.append(R)
        nodes.append(p)
    return np.array(rotations), np.array(nodes)


def node_errors_m(result: FitResult, scan: SimulatedScan) -> np.ndarray:
    """[N+1] distance of each node from the truth."""
    return np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)


def across_errors_m(result: FitResult, scan: SimulatedScan) -> np.ndarray:
    """[N+1] the same without what lies along the member, which a prismatic surface does not show."""
    error = result.nodes_m - scan.nodes_m
    axis = np.diff(scan.nodes_m, axis=0)
    axis = np.concatenate([axis, axis[-1:]])
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return np.linalg.norm(error - (error * axis).sum(axis=1)[:, None] * axis, axis=1)


def check_consistent(result: FitResult) -> None:
    """Assert what must hold of any result, right or wrong."""
    element, n = result.element, result.element.segments
    assert result.joint_angles_rad.shape == (n, 3) and result.joint_limits_rad.shape == (n, 3, 2)
    designed = element.design.angles_rad
    np.testing.assert_array_equal(result.joint_limits_rad[..., 1], designed + element.joint_limit_rad)
    np.testing.assert_array_equal(result.joint_limits_rad[..., 0], designed - element.joint_limit_rad)
    assert (result.joint_angles_rad >= result.joint_limits_rad[..., 0]).all()
    assert (result.joint_angles_rad <= result.joint_limits_rad[..., 1]).all()
    np.testing.assert_array_equal(result.q, result.joint_angles_rad[:, ::-1].ravel())
    _, nodes = kinematics(result.base_pose, result.joint_angles_rad, element.segment_length_m)
    far = np.abs(nodes).max()
    np.testing.assert_allclose(result.nodes_m, nodes, rtol=0, atol=1e-12 * max(far, element.length_m) + 4e-16 * far)
    assert result.nodes_covariance_m2.shape == (n + 1, 3, 3)
    np.testing.assert_allclose(
        result.nodes_covariance_m2, result.nodes_covariance_m2.transpose(0, 2, 1), rtol=0, atol=1e-12
    )
    smallest = np.linalg.eigvalsh(result.nodes_covariance_m2)
    assert (smallest[:, 0] >= -1e-9 * np.maximum(smallest[:, -1], 1e-9)).all()
    assert len(result.segments) == n
    assert len(result.reason_codes) == len(result.reasons) and set(result.reason_codes) <= set(get_args(ReasonCode))
    assert result.status == status_of(result.reason_codes), (result.status, result.reason_codes)
    assert all(0.0 <= s.coverage <= 1.0 for s in result.segments)


def surface_distances_m(result: FitResult, points: np.ndarray, profile: Profile) -> np.ndarray:
    """[P] distance of points to the lateral surface of the fitted chain, with a section of our choice."""
    length = result.element.segment_length_m
    rotations, nodes = kinematics(result.base_pose, result.joint_angles_rad, length)
    best = np.full(len(points), np.inf)
    for R, node in zip(rotations, nodes, strict=False):
        local = (points - node) @ R
        if profile.radius_m is not None:
            across = np.abs(np.hypot(local[:, 0], local[:, 1]) - profile.radius_m)
        else:
            across = np.full(len(points), np.inf)
            corners = profile.outline()
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                t = np.clip((local[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
                across = np.minimum(across, np.linalg.norm(local[:, :2] - a - t[:, None] * (b - a), axis=1))
        beyond = local[:, 2] - np.clip(local[:, 2], 0, length)
        best = np.minimum(best, np.hypot(across, beyond))
    return best


def cramer_rao(element: Element, scan: SimulatedScan, noise_m: float) -> np.ndarray:
    """[N+1][3][3] covariance of the nodes that no unbiased estimate can beat; the base is known.

    From the truth: each point's own segment and outward normal, and the motion of both
    points and nodes by central differences of the kinematics.
    """
    n, length, step = element.segments, element.segment_length_m, 1e-6
    angles = scan.joint_angles_rad.ravel()
    rotations, nodes = kinematics(scan.base_pose, scan.joint_angles_rad, length)
    owner = scan.segment.astype(int) - 1
    body = np.einsum("pji,pj->pi", rotations[owner], scan.points - nodes[owner])
    J, A = np.empty((len(owner), 3 * n)), np.empty((n + 1, 3, 3 * n))
    for i in range(3 * n):
        moved, motion = [], []
        for h in (step, -step):
            R, p = kinematics(scan.base_pose, (angles + h * (np.arange(3 * n) == i)).reshape(n, 3), length)
            moved.append(p)
            motion.append(np.einsum("pij,pj->pi", R[owner], body) + p[owner])
        A[:, :, i] = (moved[0] - moved[1]) / (2 * step)
        J[:, i] = np.einsum("pi,pi->p", motion[0] - motion[1], scan.surface_normals) / (2 * step)
    information = J.T @ J / noise_m**2
    # What no point shows (the torsion of a round section) moves no node either, at a straight joint.
    C = np.linalg.inv(information + 1e-9 * np.trace(information) / (3 * n) * np.eye(3 * n))
    return np.einsum("kai,ij,kbj->kab", A, C, A, optimize=True)
