"""Rigid registration: what a scan-to-BIM pipeline does today. It cannot bend the element."""

from __future__ import annotations

import os

import numpy as np

from benchlib.methods.common import Array, Found, Solve, Task, Template, tubes

THRESHOLD_M = 0.3
NEIGHBOURS = 20
SPACING_M = 0.02


def open3d_icp() -> Solve:
    """Return Open3D's point-to-plane ICP of the scan to the design's cloud, whose normals are estimated."""
    import open3d as o3d

    registration = o3d.pipelines.registration

    def solve(task: Task) -> Found:
        scan = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(task.points))
        model = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(model_cloud(task)))
        model.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
        estimation = registration.TransformationEstimationPointToPlane()
        result = registration.registration_icp(scan, model, THRESHOLD_M, np.eye(4), estimation)
        return moved(task, np.asarray(result.transformation))

    return solve


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
            model_cloud(task),
            task.points,
            registration_type=kind,
            downsampling_resolution=SPACING_M,
            max_correspondence_distance=THRESHOLD_M,
            num_threads=os.cpu_count() or 1,
        )
        return moved(task, np.asarray(result.T_target_source), int(result.iterations))

    return solve


def model_cloud(task: Task) -> Array:
    """Return a cloud of the design, about as dense as the scan."""
    return Template.of(task.element, len(task.points)).vertices


def moved(task: Task, T_model_scan: Array, iterations: int | None = None) -> Found:
    """Return the straight element, moved to where the scan came from."""
    element = task.element
    R = T_model_scan[:3, :3].T
    t = -R @ T_model_scan[:3, 3]
    z = np.linspace(0.0, element.length_m, element.segments + 1)
    nodes = np.column_stack([np.zeros((len(z), 2)), z]) @ R.T + t
    return Found(nodes, lambda: tubes(element, np.tile(R, (element.segments, 1, 1)), nodes), iterations)
