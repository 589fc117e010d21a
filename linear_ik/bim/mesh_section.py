"""Sections of a mesh: where a plane cuts it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import shapely

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

LEAST_AREA_M2 = 1e-8


@dataclass(frozen=True, eq=False)
class Section:
    """One cut.

    Attributes:
        z_m: where.
        outline: [V][2] outer outline.
        holes: inner outlines; a mesh with gaps may show one where none is.
    """

    z_m: float
    outline: Array
    holes: tuple[Array, ...]


def cut(vertices: Array, triangles: Triangles, z_m: float) -> list[Section]:
    """Return the pieces of a mesh [V][3] in the plane z = ``z_m``, the largest first.

    No vertex may lie on the plane; a plane a hair beside one will do.
    """
    import shapely

    above = vertices[:, 2] > z_m
    count = above[triangles].sum(axis=1)
    crossing = triangles[(count == 1) | (count == 2)]
    if not len(crossing):
        return []
    # Of each crossing triangle the corner that is alone on its side; its two edges are cut.
    sides = above[crossing]
    odd = np.where(sides.sum(axis=1) == 1, sides.argmax(axis=1), (~sides).argmax(axis=1))
    rows = np.arange(len(crossing))
    alone = crossing[rows, odd]
    ends = [_crossing(vertices, alone, crossing[rows, (odd + k) % 3], z_m) for k in (1, 2)]
    lines = shapely.linestrings(np.stack(ends, axis=1))
    closed, *rest = shapely.polygonize_full(lines)
    if any(len(left.geoms) for left in rest):
        # Noding makes faces of meshes too whose triangles don't quite meet or lie on each other.
        closed = shapely.polygonize([shapely.unary_union(shapely.set_precision(lines, 1e-7))])
    faces = list(closed.geoms)
    whole = shapely.unary_union(faces)
    pieces = [whole] if whole.geom_type == "Polygon" else list(getattr(whole, "geoms", []))
    pieces = [shapely.Polygon(p.exterior) for p in pieces if p.geom_type == "Polygon" and p.area > LEAST_AREA_M2]
    pieces.sort(key=lambda piece: -piece.area)
    # With one face there is nothing inside another.
    empty = [f for f in faces if not _inside(vertices, triangles, f, z_m)] if len(faces) > len(pieces) else []
    return [_section(piece, empty, z_m) for piece in pieces]


def _section(piece: shapely.Polygon, empty: list[shapely.Polygon], z_m: float) -> Section:
    import shapely

    holes = shapely.unary_union([face for face in empty if piece.contains(shapely.point_on_surface(face))])
    rings = [holes] if holes.geom_type == "Polygon" else list(getattr(holes, "geoms", []))
    inner = tuple(np.array(ring.exterior.coords)[:-1] for ring in rings if ring.area > LEAST_AREA_M2)
    return Section(z_m, np.array(piece.exterior.coords)[:-1], inner)


def _crossing(vertices: Array, a: npt.NDArray[np.int64], b: npt.NDArray[np.int64], z_m: float) -> Array:
    """Return the points [E][2] where the edges between vertices a and b [E] cross the plane."""
    # From the smaller index, so that two triangles find the same point on their common edge.
    low, high = vertices[np.minimum(a, b)], vertices[np.maximum(a, b)]
    t = (z_m - low[:, 2]) / (high[:, 2] - low[:, 2])
    return np.asarray(low[:, :2] + t[:, None] * (high - low)[:, :2])


def _inside(vertices: Array, triangles: Triangles, face: shapely.Polygon, z_m: float) -> bool:
    """Say whether a face of a cut is material: a ray along z meets the surface an odd number of times above."""
    import shapely

    if face.area < 1e-10:
        return False
    point = shapely.point_on_surface(face)
    x, y = point.x, point.y
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    d = (b[:, 1] - c[:, 1]) * (a[:, 0] - c[:, 0]) + (c[:, 0] - b[:, 0]) * (a[:, 1] - c[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((b[:, 1] - c[:, 1]) * (x - c[:, 0]) + (c[:, 0] - b[:, 0]) * (y - c[:, 1])) / d
        v = ((c[:, 1] - a[:, 1]) * (x - c[:, 0]) + (a[:, 0] - c[:, 0]) * (y - c[:, 1])) / d
        z = u * a[:, 2] + v * b[:, 2] + (1 - u - v) * c[:, 2]
        hit = (np.abs(d) > 1e-14) & (u >= 0) & (v >= 0) & (u + v <= 1) & (z > z_m)
    return bool(hit.sum() % 2)
