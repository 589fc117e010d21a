"""Correspondences: which face of which segment each scan point lies on.

Scan point to model surface, by Open3D's closest-point query on the bent chain: the
other direction (the paper's 3.2) invents a match wherever the scan has a hole.
Neither normals nor stations are needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches of P points, sorted by segment; all geometry in the segments' own frames.

    Attributes:
        order: [P] row of the point in the array that was matched.
        starts: [N+1] first match of each segment, and P.
        face: [P] edge of the outline; without meaning on a round section.
        local: [P][3] point in its segment's frame.
        residual_m: [P] signed distance to the face, positive outside.
        gradient: [P][2] direction of that distance in the section's plane.
        distance_m: [P] distance to the nearest point of the (finite) surface.
    """

    order: Index
    starts: Index
    face: Index
    local: Array
    residual_m: Array
    gradient: Array
    distance_m: Array

    @property
    def segment(self) -> Index:
        """[P] segment of each match, counted from 0."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))


class Matcher:
    """Finds the nearest lateral face of a bent chain for each point.

    Single precision inside Open3D decides only which face is meant; residuals are
    computed on the exact faces in double precision.
    """

    def __init__(self, surface: Surface, segment_length_m: Array) -> None:
        """Prepare the meshes of the segments; their poses come with each query."""
        import open3d as o3d

        self._core = o3d.core
        self._scene = o3d.t.geometry.RaycastingScene
        self.surface = surface
        self.segment_length_m = segment_length_m
        # A round section has one face, whose residual needs no chords: a few will do to tell segments apart.
        outline = surface if surface.radius_m is None else surface.of_outline(surface.corners[::4], surface.radius_m)
        vertices, triangles = outline.mesh(1.0)
        self._unit = vertices
        self._triangles = o3d.core.Tensor(triangles)

    def match(self, pose: Pose, points: Array, segments: int | None = None, first: int = 0) -> Correspondences:
        """Match ``points`` [P][3] (element's frame) to segments ``first`` to ``segments`` - 1 of the chain."""
        n = pose.n_segments if segments is None else segments
        lengths = self.segment_length_m[first:n]
        scene = self._scene(nthreads=0)
        vertices = np.repeat(self._unit[None], n - first, axis=0)
        vertices[:, :, 2] *= lengths[:, None]
        vertices = vertices @ pose.rotations[first:n].transpose(0, 2, 1) + pose.nodes_m[first:n, None]
        for mesh in vertices.astype(np.float32):
            scene.add_triangles(self._core.Tensor(mesh), self._triangles)
        hit = scene.compute_closest_points(self._core.Tensor(np.ascontiguousarray(points, dtype=np.float32)))
        segment = hit["geometry_ids"].numpy() + np.uint32(first)
        order = np.argsort(segment.astype(np.uint8 if n < 256 else np.uint16), kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(segment, minlength=n))])
        face = hit["primitive_ids"].numpy()[order].astype(np.intp) // 2
        local = points[order].astype(np.float64, copy=False)
        for k in range(first, n):
            rows = slice(starts[k], starts[k + 1])
            local[rows] = (local[rows] - pose.nodes_m[k]) @ pose.rotations[k]
        residual, gradient = self.surface.offsets(local[:, :2], face)
        length = np.repeat(self.segment_length_m[:n], np.diff(starts))
        beyond = local[:, 2] - np.clip(local[:, 2], 0.0, length)
        return Correspondences(order, starts, face, local, residual, gradient, np.hypot(residual, beyond))
