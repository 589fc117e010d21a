"""Target: the design's surface, as a scan is laid on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.bodies import turned_outward
from linear_ik.design_model import DesignModel
from linear_ik.element import Element
from linear_ik.section import side_triangles

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

SPACING_M = 0.03
MOST_SAMPLES = 200_000
THICK_M = 0.05  # of a thinner body's two sides, the nearer one need not be the one that was measured


class Target:
    """The outer faces of members and obstacles, about a local origin.

    Members have neither end caps nor insides: those are built against, or never seen.

    Attributes:
        origin_m: [3] in the model's coordinates; everything else is about it.
        samples: [M][3] points spread evenly over the faces.
        normals: [M][3] of their faces.
        sample_faces: [M] the triangle that each is on.
        of_member: [T] whether a triangle is a member's.
        one_sided: [T] whether a triangle's normal is known to look outwards, from a body of some thickness.
    """

    def __init__(self, design: DesignModel) -> None:
        """Take a design with at least one member or obstacle."""
        meshes = [_outer_faces(member.element) for member in design.members]
        one_sided = [False] * len(meshes)
        for o in design.obstacles:
            if len(o.triangles):
                triangles, thick_m = turned_outward(o.vertices_m, o.triangles)
                meshes.append((o.vertices_m, triangles))
                one_sided.append(thick_m >= THICK_M)
        counts = [len(triangles) for _, triangles in meshes]
        self.of_member: Flags = np.repeat(np.arange(len(meshes)) < len(design.members), counts)
        self.one_sided: Flags = np.repeat(np.array(one_sided), counts)
        every = np.concatenate([vertices for vertices, _ in meshes])
        self.origin_m: Array = np.round((every.min(axis=0) + every.max(axis=0)) / 2)
        self._scene: Any = None
        starts = np.cumsum([0] + [len(v) for v, _ in meshes])
        self._vertices = every - self.origin_m
        self._triangles = np.concatenate([t + s for (_, t), s in zip(meshes, starts[:-1], strict=True)])
        self.samples, self.normals, self.sample_faces = self._sample()

    def closest(self, points: Array) -> tuple[Array, Array, Triangles]:
        """Return the nearest points of the faces [P][3] to points [P][3], the faces' normals [P][3], and which [P]."""
        import open3d as o3d

        if self._scene is None:
            self._scene = o3d.t.geometry.RaycastingScene()
            self._scene.add_triangles(
                o3d.core.Tensor(self._vertices.astype(np.float32)), o3d.core.Tensor(self._triangles.astype(np.uint32))
            )
        found = self._scene.compute_closest_points(o3d.core.Tensor(points.astype(np.float32)))
        places, normals = (found[name].numpy().astype(np.float64) for name in ("points", "primitive_normals"))
        return places, normals, found["primitive_ids"].numpy().astype(np.int64)

    def _sample(self) -> tuple[Array, Array, Triangles]:
        a, b, c = (self._vertices[self._triangles[:, i]] for i in range(3))
        cross = np.cross(b - a, c - a)
        twice = np.linalg.norm(cross, axis=1)
        total = float(twice.sum()) / 2
        count = int(np.clip(total / SPACING_M**2, 1000, MOST_SAMPLES))
        rng = np.random.default_rng(0)
        # Equal areas in a row, each giving one sample.
        places = (np.arange(count) + rng.random(count)) / count * twice.sum()
        k = np.minimum(np.searchsorted(np.cumsum(twice), places), len(twice) - 1)
        u, v = rng.random((2, count))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        points = a[k] + u[:, None] * (b - a)[k] + v[:, None] * (c - a)[k]
        return points, cross[k] / np.maximum(twice[k], 1e-300)[:, None], k


def _outer_faces(element: Element) -> tuple[Array, Triangles]:
    """Return the lateral faces of an element as designed, in the model's coordinates."""
    T, axis = element.placement.T_world_element, element.design
    n = element.segments if element.axis_points is not None else 1
    length_m = element.length_m if n == 1 else axis.segment_length_m
    vertices, triangles = [], []
    for k in range(n):
        first, last = element.profile_at(k / n).outline(), element.profile_at((k + 1) / n).outline()
        m = len(first)
        local = np.column_stack([np.concatenate([first, last]), np.repeat([0.0, length_m], m)])
        R = axis.rotations[k]
        vertices.append(local @ R.T + axis.nodes_m[k])
        triangles.append(side_triangles([first]) + 2 * m * k)
    return np.concatenate(vertices) @ T[:3, :3].T + T[:3, 3], np.concatenate(triangles)
