"""Obstacles: points that lie on a plate, a slab or another body of the design, and so are not the element's.

An obstacle may have moved as well as the element, so only points are taken away that lie on
it as designed and are clearly farther from the element as designed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.site.body import Body
from linear_ik.site.box_tree import BoxTree
from linear_ik.site.neighbourhood import Boxes

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

ON_IT_M = 0.012  # from an obstacle's designed surface
CLEARLY_M = 0.012  # farther from the element's


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles near one element.

    Attributes:
        vertices_m: [V][3] in the model's coordinates.
        triangles: [T][3] rows of ``vertices_m``.
    """

    vertices_m: Array
    triangles: Triangles


class ObstacleField:
    """All obstacles' triangles, to be cut out for one element after the other."""

    def __init__(self, meshes: Sequence[tuple[Array, Triangles]]) -> None:
        """Take (vertices [V][3], triangles [T][3]) of each obstacle, in the model's coordinates."""
        corners = [np.asarray(v, dtype=np.float64)[t] for v, t in meshes if len(t)]
        self._corners = np.concatenate(corners) if corners else np.empty((0, 3, 3))
        self._tree = BoxTree(self._corners.min(axis=1), self._corners.max(axis=1))

    def near(self, boxes: Boxes) -> Mesh:
        """Return the triangles that may reach into an element's neighbourhood."""
        middle, half = (boxes.low_m + boxes.high_m) / 2, (boxes.high_m - boxes.low_m) / 2 + ON_IT_M
        chosen = [np.empty(0, dtype=np.intp)]
        for R, origin, m, h in zip(boxes.R, boxes.origin_m, middle, half, strict=True):
            centre, extent = origin + R @ m, np.abs(R) @ h
            rows = self._tree.meeting(centre - extent, centre + extent)
            local = (self._corners[rows] - centre) @ R
            chosen.append(rows[((local.min(axis=1) <= h) & (local.max(axis=1) >= -h)).all(axis=1)])
        corners = self._corners[np.unique(np.concatenate(chosen))].reshape(-1, 3)
        return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def masked(points: Array, element: Element, obstacles: Mesh) -> Mask:
    """Return which points [P][3] lie on an obstacle rather than on the element, both as designed."""
    if not len(obstacles.triangles) or not len(points):
        return np.zeros(len(points), dtype=bool)
    import open3d as o3d

    origin = element.placement.T_world_element[:3, 3]
    scene, tensor = o3d.t.geometry.RaycastingScene(), o3d.core.Tensor
    scene.add_triangles(
        tensor((obstacles.vertices_m - origin).astype(np.float32)), tensor(obstacles.triangles.astype(np.uint32))
    )
    distance = scene.compute_distance(tensor((points - origin).astype(np.float32))).numpy()
    out = distance < ON_IT_M
    on_it = np.flatnonzero(out)
    _, own, _ = Body.designed(element).distances(points[on_it])
    out[on_it[own < distance[on_it] + CLEARLY_M]] = False
    return np.asarray(out)
