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
    "SolidModel",
    "SurfaceModel",
    "SweptSolid",
    "Tessellation",
}
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


def body_representation(product: Any) -> Any:
    """Return the representation with a product's body, or None."""
    shape = product.Representation
    if shape is None:
        return None
    found = [r for r in shape.Representations if r.RepresentationIdentifier == "Body" and r.Items]
    # Some writers leave the identifier out, or call a mesh by its own name.
    found += [
        r
        for r in shape.Representations
        if r.RepresentationIdentifier in (None, "", "Facetation", "Body-Fallback")
        and r.RepresentationType in SOLID_TYPES
        and r.Items
    ]
    return found[0] if found else None


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
    import ifcopenshell.util.placement as placements

    T = np.array(placements.get_axis2placement(placement), dtype=np.float64)
    T[:3, 3] *= unit_m
    return T


def _collect(item: Any, T: Array, unit_m: float, out: list[Solid], depth: int) -> None:
    if item.is_a("IfcMappedItem") and depth:
        import ifcopenshell.util.placement as placements

        M = np.array(placements.get_mappeditem_transformation(item), dtype=np.float64)
        M[:3, 3] *= unit_m
        for inner in item.MappingSource.MappedRepresentation.Items:
            _collect(inner, T @ M, unit_m, out, depth - 1)
        return
    base = item
    while base.is_a("IfcBooleanResult") and depth:
        # What is taken away or cut off shows in the tessellation; the section is that of the first operand.
        base, depth = base.FirstOperand, depth - 1
    out.append(Solid(base, item, T))
