"""Refinement: a rough alignment made exact on the part of the design that is as designed.

Point to plane on the design's own faces, with weights (s^2 / (s^2 + d^2))^2 whose scale s shrinks
to the noise: members that bent, and whatever else stands there, count nothing in the end.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.quality import TIGHT_M, distances, moved
from linear_ik.alignment.target import Target
from linear_ik.side_noise import MAD_TO_SD

Array = npt.NDArray[np.float64]

LEAST_SCALE_M = 0.003
ROUNDS_A_SCALE = 6
LAST_ROUNDS = 15
FEWEST = 20


def refine(
    target: Target,
    scan: Array,
    T_target_scan: Array,
    start_m: float,
    end_m: float,
    levelled: bool,  # noqa: N803
) -> Array:
    """Return the alignment [4][4] after robust steps from scale ``start_m`` down to ``end_m``.

    Args:
        target: the design.
        scan: [P][3].
        T_target_scan: [4][4] to start from.
        start_m: scale of the first steps.
        end_m: scale of the last.
        levelled: turn about z only.
    """
    T, scale = T_target_scan.copy(), start_m
    while True:
        last = scale <= end_m * 1.001
        for _ in range(LAST_ROUNDS if last else ROUNDS_A_SCALE):
            step = _step(target, scan, T, scale, levelled)
            T = np.asarray(_twist(step) @ T)
            if np.abs(step).max() < (1e-3 if last else 1e-2) * scale:
                break
        if last:
            return np.asarray(T)
        scale = max(scale / 2.0, end_m)


def noise_m(target: Target, scan: Array, T_target_scan: Array) -> float:  # noqa: N803
    """Return the standard deviation of the explained points about the design's faces."""
    distance = distances(target, scan, T_target_scan)
    near = distance[distance < TIGHT_M]
    return MAD_TO_SD * float(np.median(near)) if len(near) else LEAST_SCALE_M


def _step(target: Target, scan: Array, T: Array, scale: float, levelled: bool) -> Array:  # noqa: N803
    """Return the Gauss-Newton step [6]: rotation about the target's origin, then translation."""
    J, r, w = _equations(target, scan, T, scale)
    if len(r) < FEWEST:
        return np.zeros(6)
    free = np.array([2, 3, 4, 5]) if levelled else np.arange(6)
    J = J[:, free]
    H = (J * w[:, None]).T @ J
    # What the faces don't show stays as it is.
    H += 1e-9 * np.diag(np.diag(H)) + 1e-9 * float(w.sum()) * np.eye(len(free))
    step = np.zeros(6)
    step[free] = -np.linalg.solve(H, J.T @ (w * r))
    return step


def freedom(target: Target, scan: Array, T_target_scan: Array) -> tuple[float, Array]:  # noqa: N803
    """Return how weakly the explained points hold the least held translation, and its direction [3].

    The share of the points' information that is about that direction: a third where faces look all ways, 0 where
    the scan slides along it unseen.
    """
    J, r, w = _equations(target, scan, T_target_scan, TIGHT_M / 3)
    if len(r) < FEWEST:
        return 0.0, np.array([1.0, 0.0, 0.0])
    values, vectors = np.linalg.eigh((J[:, 3:] * w[:, None]).T @ J[:, 3:])
    return float(values[0] / values.sum()), np.asarray(vectors[:, 0])


def _equations(target: Target, scan: Array, T: Array, scale: float) -> tuple[Array, Array, Array]:  # noqa: N803
    """Return slopes [K][6], residuals [K] and weights [K] of the points within three times the scale."""
    points = moved(scan, T)
    closest, normals, _ = target.closest(points)
    offset = points - closest
    distance = np.linalg.norm(offset, axis=1)
    # Beside an edge the face's own normal would let the point slide past it.
    beside = np.abs(np.einsum("ij,ij->i", offset, normals)) < 0.9 * distance
    normals[beside] = offset[beside] / np.maximum(distance[beside], 1e-12)[:, None]
    near = distance < 3 * scale
    n, p = normals[near], points[near]
    w = (scale**2 / (scale**2 + distance[near] ** 2)) ** 2
    return np.column_stack([np.cross(p, n), n]), np.einsum("ij,ij->i", offset[near], n), w


def _twist(step: Array) -> Array:
    """Return the motion [4][4] of a rotation vector and a translation [6]."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]
    return T
