"""Viewer shapes: an element's bodies as meshcat takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.section import extruded_mesh

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]


def segment_triangles(element: Element, k: int) -> tuple[Array, Triangles]:
    """Return vertices [V][3] and triangles [T][3] of segment k (from 0), in its own frame."""
    start, end = element.segment_profiles(k)
    mesh = extruded_mesh(start, element.segment_length_m, end)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def segment_bodies(element: Element) -> list[Any]:
    """Return meshcat's geometry of each segment [N]; one for all where nothing tapers."""
    if not element.is_tapered:
        return [_geometry(*segment_triangles(element, 0))] * element.segments
    return [_geometry(*segment_triangles(element, k)) for k in range(element.segments)]


def design_body(element: Element) -> Any:
    """Return meshcat's geometry of the whole element as designed, in its frame."""
    if element.axis_points is not None:
        parts, first = [segment_triangles(element, k) for k in range(element.segments)], 0
        vertices, triangles = [], []
        for (corners, faces), R, node in zip(parts, element.design.rotations, element.design.nodes_m[:-1], strict=True):
            vertices.append(corners @ R.T + node)
            triangles.append(faces + first)
            first += len(corners)
        return _geometry(np.concatenate(vertices), np.concatenate(triangles))
    mesh = extruded_mesh(element.profile, element.length_m, element.profile_at(1.0) if element.is_tapered else None)
    return _geometry(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def reach_m(element: Element) -> float:
    """Return how far from its axis the element's section reaches, at either end."""
    return max(float(np.linalg.norm(element.profile_at(share).outline(), axis=1).max()) for share in (0.0, 1.0))


def designed_nodes_m(element: Element) -> Array:
    """Return the corners of the design axis in the scan's coordinates, start and end of a straight one."""
    nodes, T = element.design.nodes_m, element.placement.T_world_element
    nodes = nodes[[0, -1]] if element.axis_points is None else nodes
    return np.asarray(nodes @ T[:3, :3].T + T[:3, 3])


def axis_distances_m(element: Element, points: Array) -> Array:
    """Return the distance of points [P][3] to the design axis, in the scan's coordinates [P]."""
    nodes, best = designed_nodes_m(element), np.full(len(points), np.inf)
    for start, end in zip(nodes[:-1], nodes[1:], strict=True):
        leg = end - start
        share = np.clip((points - start) @ leg / (leg @ leg), 0.0, 1.0)
        np.minimum(best, np.linalg.norm(points - start - share[:, None] * leg, axis=1), out=best)
    return best


def material(colour: int, opacity: float) -> Any:
    """Return a translucent material."""
    from meshcat.geometry import MeshLambertMaterial

    # Neither the design nor the fit hides the points inside it.
    return MeshLambertMaterial(color=colour, opacity=opacity, depthWrite=False)


def transform(rotation: Array, translation: Array) -> Array:
    """Return a transform [4][4]."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def _geometry(vertices: Array, triangles: Triangles) -> Any:
    from meshcat.geometry import TriangularMeshGeometry

    # Corners of their own for each triangle: shared ones would be shaded as if the edges were rounded.
    vertices = vertices[triangles].reshape(-1, 3)
    return TriangularMeshGeometry(vertices, np.arange(len(vertices)).reshape(-1, 3))
