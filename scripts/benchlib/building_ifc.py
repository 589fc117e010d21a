"""Building as IFC4: extruded solids of parameterised profiles, as authoring tools write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.building import Building, global_id
from linear_ik.design_model import Member, Obstacle
from linear_ik.profile import CircleHollow, IShape, Profile

Array = npt.NDArray[np.float64]


def write_ifc(plan: Building, path: Path) -> None:
    """Write the design, metres."""
    import ifcopenshell

    f = ifcopenshell.file(schema="IFC4")
    make = f.create_entity
    axes = make("IfcAxis2Placement3D", make("IfcCartesianPoint", (0.0, 0.0, 0.0)))
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, axes)
    units = make("IfcUnitAssignment", [make("IfcSIUnit", None, "LENGTHUNIT", None, "METRE")])
    project = make("IfcProject", global_id("project"), None, "frame", RepresentationContexts=[context])
    project.UnitsInContext = units
    ground = make("IfcLocalPlacement", None, axes)
    levels = {
        kind: make(kind, global_id(kind), None, kind, ObjectPlacement=ground)
        for kind in ("IfcSite", "IfcBuilding", "IfcBuildingStorey")
    }
    for above, below in zip([project, *levels.values()], levels.values(), strict=False):
        make("IfcRelAggregates", global_id(f"in {above}"), None, None, None, above, [below])
    profiles = {m.element.profile: _profile(f, m.element.profile) for m in plan.design.members}
    products = [_member(f, context, ground, m, profiles[m.element.profile]) for m in plan.design.members]
    products += [_box(f, context, ground, o) for o in plan.design.obstacles]
    make(
        "IfcRelContainedInSpatialStructure",
        global_id("contained"),
        RelatedElements=products,
        RelatingStructure=levels["IfcBuildingStorey"],
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    f.write(str(path))


def _profile(f: Any, profile: Profile) -> Any:
    at = f.create_entity("IfcAxis2Placement2D", f.create_entity("IfcCartesianPoint", (0.0, 0.0)))
    if isinstance(profile, IShape):
        sizes = profile.overall_width, profile.overall_depth, profile.web_thickness, profile.flange_thickness
        return f.create_entity("IfcIShapeProfileDef", "AREA", None, at, *sizes)
    assert isinstance(profile, CircleHollow)
    return f.create_entity("IfcCircleHollowProfileDef", "AREA", None, at, profile.radius, profile.wall_thickness)


def _member(f: Any, context: Any, ground: Any, member: Member, profile: Any) -> Any:
    element = member.element
    placed = _placement(f, ground, element.placement.T_world_element)
    kind = {"IfcColumn": "COLUMN", "IfcBeam": "BEAM", "IfcPipeSegment": "RIGIDSEGMENT"}[member.ifc_class]
    return f.create_entity(
        member.ifc_class,
        member.guid,
        Name=member.name,
        Tag=member.tag,
        ObjectPlacement=placed,
        Representation=_solid(f, context, profile, element.length_m),
        PredefinedType=kind,
    )


def _box(f: Any, context: Any, ground: Any, obstacle: Obstacle) -> Any:
    low, high = obstacle.vertices_m.min(axis=0), obstacle.vertices_m.max(axis=0)
    T = np.eye(4)
    T[:3, 3] = [*(low + high)[:2] / 2, low[2]]
    at = f.create_entity("IfcAxis2Placement2D", f.create_entity("IfcCartesianPoint", (0.0, 0.0)))
    width, depth, height = (high - low).tolist()
    profile = f.create_entity("IfcRectangleProfileDef", "AREA", None, at, width, depth)
    return f.create_entity(
        obstacle.ifc_class,
        obstacle.guid,
        ObjectPlacement=_placement(f, ground, T),
        Representation=_solid(f, context, profile, height),
    )


def _solid(f: Any, context: Any, profile: Any, length_m: float) -> Any:
    make = f.create_entity
    axes = make("IfcAxis2Placement3D", make("IfcCartesianPoint", (0.0, 0.0, 0.0)))
    solid = make("IfcExtrudedAreaSolid", profile, axes, make("IfcDirection", (0.0, 0.0, 1.0)), float(length_m))
    return make(
        "IfcProductDefinitionShape",
        None,
        None,
        [make("IfcShapeRepresentation", context, "Body", "SweptSolid", [solid])],
    )


def _placement(f: Any, ground: Any, T: Array) -> Any:
    make = f.create_entity
    at = make("IfcCartesianPoint", tuple(T[:3, 3].tolist()))
    z, x = (make("IfcDirection", tuple(T[:3, i].tolist())) for i in (2, 0))
    return make("IfcLocalPlacement", ground, make("IfcAxis2Placement3D", at, z, x))
