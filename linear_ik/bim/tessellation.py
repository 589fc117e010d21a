"""Tessellation: bodies as triangles, made by ifcopenshell's geometry kernel.

The kernel prints what it fails on to stdout; here that goes nowhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.broken import BROKEN
from linear_ik.bim.solids import body_representations
from linear_ik.quiet import silence

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

# Chords of curves are this near to them; a circle of 30 mm radius becomes 24 of them.
DEFLECTION_M = 2e-4
# Solids without curves go four times as fast with the first of the two.
KERNEL = "hybrid-cgal-simple-opencascade"
# Thirty times as fast with booleans.
BOOLEAN_KERNEL = "manifold"
CIRCLE_CHORDS = 32
# Of alignments and the like; 0.4 mm below a curve of 300 m radius, at half the time of the kernel's own step.
STEP_M = 1.0
ANGLE_RAD = 0.27


@dataclass(frozen=True, eq=False)
class Body:
    """A product's body.

    Attributes:
        vertices_m: [V][3] in the product's own coordinates.
        triangles: [T][3] rows of ``vertices_m``.
        T_world_product: [4][4].
    """

    vertices_m: Array
    triangles: Triangles
    T_world_product: Array

    def world_m(self) -> Array:
        """Return the vertices [V][3] in the model's coordinates."""
        return np.asarray(self.vertices_m @ self.T_world_product[:3, :3].T + self.T_world_product[:3, 3])


def bodies(
    model: Any, products: Sequence[Any], threads: int, on_progress: Callable[[int, int], None] | None = None
) -> dict[int, Body]:
    """Return the body of every product that has one, by its id, in no order.

    Args:
        model: ifcopenshell's file.
        products: of which.
        threads: how many at a time.
        on_progress: called with how many are done, and of how many.
    """
    import ifcopenshell.geom as geom

    cut = [product for product in products if _is_cut_by_solids(product)]
    other = {product.id() for product in cut}
    out: dict[int, Body] = {}
    done = 0
    for kernel, some in ((KERNEL, [p for p in products if p.id() not in other]), (BOOLEAN_KERNEL, cut)):
        if not some:
            continue
        library = kernel if geom.has_geometry_library(kernel) else "opencascade"
        # All along: its threads print between one body and the next.
        with silence():
            iterator = geom.iterator(_settings(), model, threads, include=some, geometry_library=library)
            more = iterator.initialize()
            while more:
                shape = iterator.get()
                body = _body(shape.geometry, shape.transformation)
                if len(body.triangles):
                    out[int(shape.id)] = body
                more = bool(iterator.next())
                done += 1
                if on_progress is not None:
                    on_progress(done, len(products))
    return out


def _is_cut_by_solids(product: Any) -> bool:
    """Say whether a body is made by booleans of solids alone; with half spaces the second kernel takes nothing off."""
    try:
        found = body_representations(product)
    except BROKEN:
        return False
    if not found or getattr(product, "HasOpenings", None):
        return False
    items = list(found[0].Items)
    booleans = False
    while items:
        item = items.pop()
        if item is not None and item.is_a("IfcBooleanResult"):
            booleans = True
            items += [item.FirstOperand, item.SecondOperand]
        elif item is None or not item.is_a("IfcSweptAreaSolid"):
            return False
    return booleans


def item_body(item: Any) -> Body | None:
    """Return one item of a representation in its own coordinates, or None where the kernel makes nothing of it."""
    import ifcopenshell.geom as geom

    try:
        with silence():
            shape = geom.create_shape(_settings(), item)
            body = _body(shape, None)
    except RuntimeError:
        return None
    return body if len(body.triangles) else None


def curve_points(curve: Any) -> Array | None:
    """Return a curve as a polyline [P][3] in metres, in the sense it runs, or None where it is not one run."""
    import ifcopenshell.geom as geom

    try:
        with silence():
            shape = geom.create_shape(_settings(curve=True), curve)
            vertices, edges = _rows(shape.verts), np.array(shape.edges, dtype=np.int64).reshape(-1, 2)
    except RuntimeError:
        return None
    if not len(edges) or (edges[1:, 0] != edges[:-1, 1]).any():
        return None
    points = vertices[[edges[0, 0], *edges[:, 1]]]
    return np.asarray(points[np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9)])


def profile_rings(definition: Any) -> list[Array]:
    """Return the boundary curves of a profile [V][2] in metres, outer and inner ones.

    Raises:
        RuntimeError: the kernel cannot draw it.
    """
    import ifcopenshell.geom as geom

    with silence():
        shape = geom.create_shape(_settings(), definition)
        vertices, triangles = _rows(shape.verts), np.array(shape.faces, dtype=np.int64).reshape(-1, 3)
        edges = np.array(shape.edges, dtype=np.int64).reshape(-1, 2)
    # Some profiles come as faces, some as wires.
    rings = boundary(vertices, triangles) if len(triangles) else loops(vertices, edges)
    return [ring[:, :2] for ring in rings]


def boundary(vertices: Array, triangles: Triangles) -> list[Array]:
    """Return the closed lines [V][D] of the edges that belong to one triangle only."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    directed = {(int(a), int(b)) for a, b in edges}
    return loops(vertices, np.array([e for e in directed if e[::-1] not in directed], dtype=np.int64).reshape(-1, 2))


def loops(vertices: Array, edges: Triangles) -> list[Array]:
    """Return the closed lines [V][D] that edges [E][2] make, each run one way; none where one stays open."""
    following = {int(a): int(b) for a, b in edges}
    rings = []
    while following:
        start, here = following.popitem()
        ring = [start]
        while here != start:
            ring.append(here)
            if here not in following:
                return []
            here = following.pop(here)
        rings.append(vertices[ring])
    return rings


def _settings(curve: bool = False) -> Any:
    import ifcopenshell.geom as geom

    settings = geom.settings()
    settings.set("weld-vertices", True)
    settings.set("no-normals", True)
    settings.set("apply-default-materials", False)
    settings.set("mesher-linear-deflection", DEFLECTION_M)
    settings.set("mesher-angular-deflection", ANGLE_RAD)
    settings.set("circle-segments", CIRCLE_CHORDS)
    settings.set("function-step-param", STEP_M)
    if curve:
        settings.set("dimensionality", 0)
    return settings


def _body(geometry: Any, transformation: Any) -> Body:
    T = np.eye(4) if transformation is None else np.array(transformation.matrix, dtype=np.float64).reshape(4, 4).T
    return Body(_rows(geometry.verts), np.array(geometry.faces, dtype=np.int64).reshape(-1, 3), T)


def _rows(flat: Any) -> Array:
    return np.array(flat, dtype=np.float64).reshape(-1, 3)
