"""Bodies: a bent shape as the items of an IfcShapeRepresentation, in a product's own coordinates.

Extrusions, one a segment, show the section as a profile that other programs can read. They are
cut square: at a kink of angle a neighbouring ones overlap inside and gap outside, by tan(a / 2)
times the section's half depth on either side (1.3 mm at 0.5 degrees and 300 mm). The triangulated
body is mitred and closed.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.asbuilt.draft import Draft
from linear_ik.asbuilt.profiles import profile_entity
from linear_ik.asbuilt.shape import BentShape, skin
from linear_ik.asbuilt.swept_disk import swept_disk
from linear_ik.profile import Circle, CircleHollow

Array = npt.NDArray[np.float64]
Body = Literal["extrusions", "triangles"]

# Between a tube's segments of extrusions, from the tube to the middle of the gap.
MOST_GAP_M = 1e-3


class Items(NamedTuple):
    """Content of a shape representation: its RepresentationType and its items."""

    kind: str
    items: list[Any]


def body_items(draft: Draft, shape: BentShape, T_product_model: Array, body: Body, designed: Any) -> Items:  # noqa: N803
    """Return the body.

    Args:
        draft: the file.
        shape: in the model's coordinates.
        T_product_model: [4][4] from the model's coordinates to the product's, metres.
        body: "extrusions": one a segment; of a round section one swept disk, in IFC2X3 only where the extrusions
            would gape by more than 1 mm on either side of a kink; of a tapered element triangles. "triangles": an
            IfcTriangulatedFaceSet, in IFC2X3 an IfcFacetedBrep.
        designed: IfcProfileDef of the designed body, or None.
    """
    if body == "triangles" or shape.element.is_tapered:
        return _triangles(draft, shape, T_product_model)
    section = shape.element.profile
    if isinstance(section, (Circle, CircleHollow)) and (draft.schema != "IFC2X3" or _gapes(shape, section.radius)):
        return Items("AdvancedSweptSolid", [swept_disk(draft, _moved(shape.nodes_m, T_product_model), section)])
    return _extrusions(draft, shape, T_product_model, designed)


def axis_items(draft: Draft, shape: BentShape, T_product_model: Array) -> Items:  # noqa: N803
    """Return the chain's nodes as a polyline."""
    points = [draft.point(p) for p in _moved(shape.nodes_m, T_product_model)]
    return Items("Curve3D", [draft.make("IfcPolyline", Points=points)])


def _extrusions(draft: Draft, shape: BentShape, T: Array, designed: Any) -> Items:  # noqa: N803
    profile = profile_entity(draft, shape.element.profile, designed)
    nodes, rotations = _moved(shape.nodes_m[:-1], T), T[:3, :3] @ shape.rotations
    depth, up = draft.length(shape.element.segment_length_m), draft.up()
    items = []
    for node, R in zip(nodes, rotations, strict=True):
        position = draft.make(
            "IfcAxis2Placement3D",
            Location=draft.point(node),
            Axis=draft.direction(R[:, 2]),
            RefDirection=draft.direction(R[:, 0]),
        )
        items.append(
            draft.make("IfcExtrudedAreaSolid", SweptArea=profile, Position=position, ExtrudedDirection=up, Depth=depth)
        )
    return Items("SweptSolid", items)


def _triangles(draft: Draft, shape: BentShape, T: Array) -> Items:  # noqa: N803
    vertices, triangles = skin(shape)
    vertices = _moved(vertices, T)
    if draft.schema != "IFC2X3":
        points = draft.make("IfcCartesianPointList3D", CoordList=[draft.lengths(p) for p in vertices])
        faces = draft.make(
            "IfcTriangulatedFaceSet", Coordinates=points, Closed=True, CoordIndex=(triangles + 1).tolist()
        )
        return Items("Tessellation", [faces])
    corners = [draft.point(p) for p in vertices]
    faces = []
    for triangle in triangles:
        loop = draft.make("IfcPolyLoop", Polygon=[corners[i] for i in triangle])
        bound = draft.make("IfcFaceOuterBound", Bound=loop, Orientation=True)
        faces.append(draft.make("IfcFace", Bounds=[bound]))
    return Items("Brep", [draft.make("IfcFacetedBrep", Outer=draft.make("IfcClosedShell", CfsFaces=faces))])


def _gapes(shape: BentShape, radius_m: float) -> bool:
    """Say whether square cuts leave a gap anywhere that is seen."""
    along = shape.rotations[:, :, 2]
    turn = np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1.0, 1.0))
    return bool((radius_m * np.tan(turn / 2) > MOST_GAP_M).any())


def _moved(points: Array, T: Array) -> Array:  # noqa: N803
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])
