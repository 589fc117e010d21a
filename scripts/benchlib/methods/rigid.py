"""Rigid registration: what a scan-to-BIM pipeline does today. It cannot bend the element."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np

from benchlib.methods.common import Array, Found, Solve, Task, Template, tubes
from linear_ik import Element

THRESHOLD_M = 0.3
NEIGHBOURS = 20
SPACING_M = 0.02


def open3d_icp() -> Solve:
    """Return `rigid_icp` of the design's cloud to the scan."""

    def solve(task: Task) -> Found:
        T_scan_model, core_s = rigid_icp(model_cloud(task.element, len(task.points)), task.points)
        return replace(moved(task, np.linalg.inv(T_scan_model)), core_s=core_s)

    return solve


def rigid_icp(model: Array, scan: Array) -> tuple[Array, float]:
    """Register a model's cloud [M][3] to a scan [P][3]: what all benchmarks here mean by rigid ICP.

    Open3D's point-to-plane ICP, matches to 0.3 m, otherwise its defaults. The planes are
    the scan's, its normals estimated from 20 neighbours: a scan brings none.

    Returns:
        T_scan_model [4][4], and the seconds that the registration took without the normals.
    """
    import open3d as o3d

    target = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan))
    target.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    started = time.perf_counter()
    source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(model))
    registration = o3d.pipelines.registration
    estimation = registration.TransformationEstimationPointToPlane()
    found = registration.registration_icp(source, target, THRESHOLD_M, np.eye(4), estimation)
    return np.asarray(found.transformation), time.perf_counter() - started


def small_gicp() -> Solve:
    """Return small_gicp's point-to-point ICP, the most accurate of its kinds here."""
    return with_small_gicp("ICP")


def small_gicp_gicp() -> Solve:
    """Return small_gicp's GICP, its default."""
    return with_small_gicp("GICP")


def with_small_gicp(kind: str) -> Solve:
    """Return small_gicp's registration of the scan to the design's cloud."""
    import small_gicp

    def solve(task: Task) -> Found:
        result = small_gicp.align(
            model_cloud(task.element, len(task.points)),
            task.points,
            registration_type=kind,
            downsampling_resolution=SPACING_M,
            max_correspondence_distance=THRESHOLD_M,
            num_threads=os.cpu_count() or 1,
        )
        return moved(task, np.asarray(result.T_target_source), int(result.iterations))

    return solve


def model_cloud(element: Element, count: int) -> Array:
    """Return a cloud of the design, of about ``count`` points."""
    return Template.of(element, count).vertices


def moved(task: Task, T_model_scan: Array, iterations: int | None = None) -> Found:
    """Return the straight element, moved to where the scan came from."""
    element = task.element
    R = T_model_scan[:3, :3].T
    t = -R @ T_model_scan[:3, 3]
    z = np.linspace(0.0, element.length_m, element.segments + 1)
    nodes = np.column_stack([np.zeros((len(z), 2)), z]) @ R.T + t
    return Found(nodes, lambda: tubes(element, np.tile(R, (element.segments, 1, 1)), nodes), iterations)
