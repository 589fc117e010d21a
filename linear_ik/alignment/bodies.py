"""Bodies: which side of an obstacle's faces is its outside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

SAME_PLACE_M = 1e-5  # vertices of neighbouring faces, as written to files


def turned_outward(vertices: Array, triangles: Triangles) -> tuple[Triangles, float]:
    """Return the triangles of a body counter-clockwise from outside, and how thick it is in metres.

    The thickness is twice the volume over the surface: a plate's own. A mesh with a hole, or whose triangles
    disagree about the outside, has none: then it is 0 and the triangles come back as they are.

    Args:
        vertices: [V][3] metres.
        triangles: [T][3] rows of ``vertices``.
    """
    _, place = np.unique(np.round(vertices / SAME_PLACE_M), axis=0, return_inverse=True)
    corners = place.reshape(-1)[triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    _, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    # Each edge is gone along both ways.
    if np.bincount(which.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0)).any():
        return triangles, 0.0
    a, b, c = (vertices[triangles[:, i]] - vertices.mean(axis=0) for i in range(3))
    cross = np.cross(b - a, c - a)
    volume, area = float(np.einsum("ij,ij->", a, cross)) / 6, float(np.linalg.norm(cross, axis=1).sum()) / 2
    if area == 0:
        return triangles, 0.0
    return triangles if volume > 0 else triangles[:, ::-1], 2 * abs(volume) / area
