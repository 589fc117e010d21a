"""Search: where a scan might lie in a design, from nowhere.

Scanners are levelled, so that a heading and a translation are sought. For each heading the
occupied voxels of the design are correlated with those of the scan, over all translations at
once (a product of Fourier transforms): the peaks are the hypotheses, a symmetric building's
other positions among them. A scan that is not levelled goes through Open3D's features (FPFH)
and RANSAC instead, whose hypotheses are some of many.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

CELLS = 56  # along the longest side of what is searched
LEAST_CELL_M = 0.1
PEAKS_A_HEADING = 3
MOST = 16
RANSAC_RUNS = 8
RANSAC_SEED = 1


def levelled_candidates(
    target: Array, scan: Array, on_step: Callable[[float], None] = lambda share: None
) -> list[Array]:
    """Return transforms T_target_scan [4][4], the best correlation first.

    Args:
        target: [M][3] points on the design.
        scan: [P][3] points, z up.
        on_step: called with the share that is done.
    """
    from scipy.fft import irfftn, next_fast_len, rfftn

    centre = (scan.min(axis=0) + scan.max(axis=0)) / 2
    middle = (target.min(axis=0) + target.max(axis=0)) / 2
    reach = float(np.linalg.norm(np.ptp(target[:, :2], axis=0))) / 2
    longest = max(float(np.ptp(scan, axis=0).max()), 2 * reach, float(np.ptp(target[:, 2])))
    cell = max(longest / CELLS, LEAST_CELL_M)
    # Room for both side by side: circular correlation then wraps into nothing.
    extents = np.ptp(scan, axis=0) + np.array([2 * reach, 2 * reach, float(np.ptp(target[:, 2]))])
    shape = tuple(int(next_fast_len(int(np.ceil(e / cell)) + 4, real=True)) for e in extents)
    field = _occupied(scan - scan.min(axis=0), cell, shape)
    transform = rfftn(_blurred(field))
    steps = int(np.ceil(np.pi * max(reach, cell) / cell))
    found: list[tuple[float, float, Array]] = []
    corner = np.array([-reach, -reach, float(target[:, 2].min() - middle[2])])
    for i in range(steps):
        heading = 2 * np.pi * i / steps
        # The design turned into the scan's heading.
        turned = (target - middle) @ _about_z(heading).T
        model = _occupied(turned - corner, cell, shape)
        overlap = irfftn(transform * np.conj(rfftn(model)), s=shape) / np.sqrt(model.sum())
        for _ in range(PEAKS_A_HEADING):
            place = np.array(np.unravel_index(int(overlap.argmax()), shape))
            value = float(overlap[tuple(place)])
            shift = np.where(
                place > np.array(shape) - np.ceil((np.ptp(turned, axis=0)) / cell) - 2, place - shape, place
            )
            # turned - corner + shift cells = scan - scan.min
            found.append((value, heading, scan.min(axis=0) + shift * cell - corner))
            _wipe(overlap, place, 2)
        on_step((i + 1) / steps)
    found.sort(key=lambda f: -f[0])
    kept: list[tuple[float, Array]] = []
    for _, heading, offset in found:
        near = any(
            abs((heading - h + np.pi) % (2 * np.pi) - np.pi) < 3.5 * np.pi / steps * 2
            and np.abs(offset - o).max() < 2.5 * cell
            for h, o in kept
        )
        if not near:
            kept.append((heading, offset))
        if len(kept) == MOST:
            break
    del centre
    return [_inverse(_about_z(h), o - _about_z(h) @ middle) for h, o in kept]


def any_candidates(target: Array, scan: Array, voxel_m: float) -> list[Array]:
    """Return transforms T_target_scan [4][4] of any rotation, by features and RANSAC, the best first."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    clouds, features = [], []
    for points in (scan, target):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)).voxel_down_sample(voxel_m)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.5 * voxel_m, 30))
        clouds.append(cloud)
        features.append(
            registration.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(6.0 * voxel_m, 150))
        )
    found = []
    for run in range(RANSAC_RUNS):
        o3d.utility.random.seed(RANSAC_SEED + run)
        result = registration.registration_ransac_based_on_feature_matching(
            *clouds,
            *features,
            True,
            1.5 * voxel_m,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel_m),
            ],
            registration.RANSACConvergenceCriteria(200_000, 0.999),
        )
        found.append((float(result.fitness), np.array(result.transformation)))
    found.sort(key=lambda f: -f[0])
    return [T for _, T in found]


def _occupied(points: Array, cell: float, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    grid = np.zeros(shape, dtype=np.float32)
    cells = np.minimum(np.floor(points / cell).astype(int), np.array(shape) - 1)
    grid[tuple(np.maximum(cells, 0).T)] = 1.0
    return grid


def _blurred(grid: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(grid, 0.8, mode="constant"), dtype=np.float32)


def _wipe(grid: Array, place: npt.NDArray[np.intp], around: int) -> None:
    grid[tuple(slice(max(0, p - around), p + around + 1) for p in place)] = -np.inf


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _inverse(R: Array, t: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.T, -R.T @ t
    return T
