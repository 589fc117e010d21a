"""The solids that a product's body is made of, with what maps and cuts them taken apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SOLID_TYPES = {
    "AdvancedBrep",
    "AdvancedSweptSolid",
    "Brep",
    "CSG",
    "Clipping",
    "MappedRepresentation",
    "SectionedSpine",
    "SolidModel",
    "SurfaceModel",
    "SweptSolid",
    "Tessellation",
}
# Some writers leave the identifier out, or call a mesh by its own name.
OTHER_NAMES = (None, "", "Facetation", "Mesh", "Body-Fallback", "Body-FallBack")
DEEPEST = 200  # of booleans and maps inside each other


@dataclass(frozen=True, eq=False)
class Solid:
    """One solid of a body.

    Attributes:
        item: what it is made from; of booleans, what the first one starts from.
        top: the whole item, booleans included, before it is mapped.
        T_product_item: [4][4] affine, metres: the map's scale and mirror included.
    """

    item: Any
    top: Any
    T_product_item: Array


def body_representations(product: Any) -> list[Any]:
    """Return the representations of a product's body, the one that is read first.

    That is one called Body before one of another name, of a model view before one of another
    view, such as a sketch.
    """
    shape = product.Representation
    if shape is None:
        return []
    every = [r for r in shape.Representations if r.is_a("IfcShapeRepresentation") and r.Items]
    bodies = [r for r in every if r.RepresentationIdentifier == "Body"]
    others = [r for r in every if r.RepresentationIdentifier in OTHER_NAMES and r.RepresentationType in SOLID_TYPES]
    return sorted(bodies, key=_is_of_another_view) + sorted(others, key=_is_of_another_view)


def _is_of_another_view(representation: Any) -> bool:
    context = representation.ContextOfItems
    parent = getattr(context, "ParentContext", None) or context
    return getattr(context, "TargetView", "MODEL_VIEW") != "MODEL_VIEW" or parent.ContextType != "Model"


def solids_of(representation: Any, unit_m: float) -> list[Solid]:
    """Return the solids of a representation, maps and booleans resolved."""
    out: list[Solid] = []
    for item in representation.Items:
        _collect(item, np.eye(4), unit_m, out, DEEPEST)
    return out


def placement_m(placement: Any, unit_m: float) -> Array:
    """Return an IfcAxis2Placement3D (or None) as a frame [4][4] in metres."""
    if placement is None:
        return np.eye(4)
    axis, ref = placement.Axis, placement.RefDirection
    return frame_of(
        np.array(placement.Location.Coordinates, dtype=np.float64) * unit_m,
        np.array(axis.DirectionRatios if axis is not None else (0.0, 0.0, 1.0), dtype=np.float64),
        np.array(ref.DirectionRatios if ref is not None else (1.0, 0.0, 0.0), dtype=np.float64),
    )


def map_m(item: Any, unit_m: float) -> Array:
    """Return the map of an IfcMappedItem [4][4] in metres: from its source's coordinates to its own."""
    target = item.MappingTarget
    first, second, third = (
        None if axis is None else np.array(axis.DirectionRatios, dtype=np.float64)
        for axis in (target.Axis1, target.Axis2, target.Axis3)
    )
    z = np.array([0.0, 0.0, 1.0]) if third is None else third
    T = frame_of(
        np.array(target.LocalOrigin.Coordinates, dtype=np.float64) * unit_m,
        z,
        np.array([1.0, 0.0, 0.0]) if first is None else first,
    )
    if second is not None and T[:3, 1] @ second < 0:
        T[:3, 1] *= -1
    scale = target.Scale or 1.0
    T[:3, 0] *= scale
    T[:3, 1] *= getattr(target, "Scale2", None) or scale
    T[:3, 2] *= getattr(target, "Scale3", None) or scale
    return np.asarray(T @ placement_m(item.MappingSource.MappingOrigin, unit_m))


def frame_of(location: Array, z: Array, x: Array) -> Array:
    """Return the rigid frame [4][4] of IFC: Z along ``z``, X along ``x`` made orthogonal to it."""
    z = z / np.linalg.norm(z)
    across = x - (x @ z) * z
    if np.linalg.norm(across) < 1e-9 * np.linalg.norm(x):
        # IFC's own default where X runs along Z.
        across = np.array([0.0, 1.0, 0.0]) if abs(z[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
        across = across - (across @ z) * z
    T = np.eye(4)
    T[:3, 0], T[:3, 2], T[:3, 3] = across / np.linalg.norm(across), z, location
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    return T


def _collect(item: Any, T: Array, unit_m: float, out: list[Solid], depth: int) -> None:
    if item.is_a("IfcMappedItem") and depth:
        M = map_m(item, unit_m)
        for inner in item.MappingSource.MappedRepresentation.Items:
            _collect(inner, T @ M, unit_m, out, depth - 1)
        return
    base = item
    while base.is_a("IfcBooleanResult") and depth:
        # What is taken away or cut off shows in the tessellation; the section is that of the first operand.
        base, depth = base.FirstOperand, depth - 1
    out.append(Solid(base, item, T))
