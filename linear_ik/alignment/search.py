"""Search: where a scan might lie in a design, from nowhere.

Scanners are levelled, so that a heading and a translation are sought. For each heading the
occupied voxels of the design are correlated with those of the scan, over all translations at
once (a product of Fourier transforms): the peaks are the hypotheses, a symmetric building's
other positions among them. A scan that is not levelled goes through Open3D's features (FPFH)
and RANSAC instead, whose hypotheses are some of many.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
OnStep = Callable[[float], None]

CELLS = 48  # along the longest side of the design
LEAST_CELL_M = 0.1
MOST_CELLS = 4_000_000  # of the whole grid: a large site makes its cells larger
STRAYS = 0.005  # share of a scan's points, each way on each axis, that may lie anywhere: sky and reflections
PEAKS_A_HEADING = 3
MOST = 12
RANSAC_RUNS = 5
FEATURE_CELLS = 100  # along the longest side of the design
LEAST_FEATURE_M = 0.05
RANSAC_SEED = 1


def _ignore(share: float) -> None:
    """Tell nobody."""


class Candidates(NamedTuple):
    """Hypotheses of an alignment.

    Attributes:
        transforms: T_target_scan [4][4], the likeliest first.
        near_m: how far off they may be.
    """

    transforms: list[Array]
    near_m: float


def levelled_candidates(target: Array, scan: Array, on_step: OnStep = _ignore) -> Candidates:
    """Return hypotheses of a levelled scan.

    Args:
        target: [M][3] points on the design.
        scan: [P][3] points, z up.
        on_step: called with the share that is done.
    """
    from scipy.fft import irfftn, next_fast_len, rfftn

    scan = _without_strays(scan)
    least, span = scan.min(axis=0), np.ptp(scan, axis=0)
    middle = (target.min(axis=0) + target.max(axis=0)) / 2
    reach = float(np.linalg.norm(np.ptp(target[:, :2], axis=0))) / 2
    box = np.array([2 * reach, 2 * reach, float(np.ptp(target[:, 2]))])
    cell = max(float(box.max()) / CELLS, LEAST_CELL_M)
    cell = max(cell, float(np.prod(span + box + 4 * cell) / MOST_CELLS) ** (1 / 3))
    # Room for both side by side: what leaves the grid on one side comes back on the other.
    shape = tuple(int(next_fast_len(int(np.ceil(e / cell)) + 4, real=True)) for e in span + box)
    transform = rfftn(_blurred(_occupied(scan - least, cell, shape)))
    steps = max(8, int(np.ceil(np.pi * reach / cell)))
    corner = -box / 2
    found: list[tuple[float, float, Array]] = []
    for i in range(steps):
        heading = 2 * np.pi * i / steps
        # The design, turned to the scan's heading.
        model = _occupied((target - middle) @ _about_z(heading).T - corner, cell, shape)
        overlap = irfftn(transform * np.conj(rfftn(model)), s=shape) / np.sqrt(model.sum())
        for _ in range(PEAKS_A_HEADING):
            place = np.array(np.unravel_index(int(overlap.argmax()), shape))
            cells = np.where(place * cell > span, place - shape, place)
            found.append((float(overlap[tuple(place)]), heading, least + cells * cell - corner))
            _wipe(overlap, place, 2)
        on_step((i + 1) / steps)
    found.sort(key=lambda f: -f[0])
    kept: list[tuple[float, Array]] = []
    for _, heading, offset in found:
        turned = [abs((heading - h + np.pi) % (2 * np.pi) - np.pi) for h, _ in kept]
        apart = [float(np.abs(offset - o).max()) for _, o in kept]
        if all(a > 7 * np.pi / steps or b > 2.5 * cell for a, b in zip(turned, apart, strict=True)):
            kept.append((heading, offset))
        if len(kept) == MOST:
            break
    return Candidates([_inverse(_about_z(h), o - _about_z(h) @ middle) for h, o in kept], cell)


def any_candidates(target: Array, scan: Array, on_step: OnStep = _ignore) -> Candidates:
    """Return hypotheses of any rotation, by features and RANSAC; arguments as `levelled_candidates`."""
    import open3d as o3d

    voxel_m = max(float(np.ptp(target, axis=0).max()) / FEATURE_CELLS, LEAST_FEATURE_M)

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
    checks = [
        registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
        registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel_m),
    ]
    criteria = registration.RANSACConvergenceCriteria(200_000, 0.999)
    # It warns of what it then deals with.
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        for run in range(RANSAC_RUNS):
            o3d.utility.random.seed(RANSAC_SEED + run)
            rigid = registration.TransformationEstimationPointToPoint(False)
            result = registration.registration_ransac_based_on_feature_matching(
                *clouds, *features, True, 1.5 * voxel_m, rigid, 3, checks, criteria
            )
            found.append((float(result.fitness), np.array(result.transformation)))
            on_step((run + 1) / RANSAC_RUNS)
    found.sort(key=lambda f: -f[0])
    return Candidates([T for _, T in found], 2 * voxel_m)


def _without_strays(points: Array) -> Array:
    """Return the points within the box of nearly all of them, made a tenth larger."""
    low, high = np.quantile(points, [STRAYS, 1.0 - STRAYS], axis=0)
    more = 0.1 * (high - low) + 0.1
    return np.asarray(points[((points >= low - more) & (points <= high + more)).all(axis=1)])


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
