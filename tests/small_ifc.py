"""A small design file: a beam with an opening, two columns that share one mapped body, a wall."""

from __future__ import annotations

from pathlib import Path

import ifcopenshell
import ifcopenshell.guid
import numpy as np

BEAM, COLUMN, TWIN, WALL = (ifcopenshell.guid.compress(f"{i:032x}") for i in (1, 2, 3, 4))


def write_small_ifc(path: Path, schema: str, millimetres: bool = True) -> Path:
    """A beam HEB 300 of 6 m along Y at (1, 2, 3), columns of 4 m at (0, 0, 0) and (5, 0, 0); metres here."""
    model = ifcopenshell.file(schema=schema)
    make, new, u = model.create_entity, ifcopenshell.guid.new, 1000.0 if millimetres else 1.0

    def point(*metres: float):
        return make("IfcCartesianPoint", [u * v for v in metres])

    def frame(at=(0.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), x=(1.0, 0.0, 0.0)):
        return make("IfcAxis2Placement3D", point(*at), make("IfcDirection", z), make("IfcDirection", x))

    person = make("IfcPersonAndOrganization", make("IfcPerson", FamilyName="A"), make("IfcOrganization", Name="B"))
    program = make("IfcApplication", person.TheOrganization, "1", "Designer", "designer")
    owner = make("IfcOwnerHistory", person, program, ChangeAction="ADDED", LastModifiedDate=1, CreationDate=1)
    unit = make("IfcSIUnit", UnitType="LENGTHUNIT", Prefix="MILLI" if millimetres else None, Name="METRE")
    angle = make("IfcSIUnit", UnitType="PLANEANGLEUNIT", Name="RADIAN")
    context = make("IfcGeometricRepresentationContext", None, "Model", 3, 1e-5, frame())
    body = make(
        "IfcGeometricRepresentationSubContext",
        ContextIdentifier="Body",
        ContextType="Model",
        ParentContext=context,
        TargetView="MODEL_VIEW",
    )
    units = make("IfcUnitAssignment", [unit, angle])
    project = make("IfcProject", new(), owner, "P", RepresentationContexts=[context], UnitsInContext=units)
    storey_place = make("IfcLocalPlacement", None, frame((0.5, 0.0, 0.0)))
    storey = make("IfcBuildingStorey", new(), owner, "S", ObjectPlacement=storey_place, CompositionType="ELEMENT")
    building = make("IfcBuilding", new(), owner, "B", CompositionType="ELEMENT")
    make("IfcRelAggregates", new(), owner, RelatingObject=project, RelatedObjects=[building])
    make("IfcRelAggregates", new(), owner, RelatingObject=building, RelatedObjects=[storey])

    def solid(profile, length: float, position):
        return make("IfcExtrudedAreaSolid", profile, position, make("IfcDirection", (0.0, 0.0, 1.0)), u * length)

    def shape(kind: str, items: list):
        return make("IfcShapeRepresentation", body, "Body", kind, items)

    def product(ifc_class: str, guid: str, at, representation):
        place = make("IfcLocalPlacement", storey_place, frame(at))
        whole = make("IfcProductDefinitionShape", Representations=[representation])
        return make(ifc_class, guid, owner, ifc_class, ObjectPlacement=place, Representation=whole)

    centre = make("IfcAxis2Placement2D", point(0.0, 0.0))
    h = make("IfcIShapeProfileDef", "AREA", "HEB300", centre, *(u * v for v in (0.3, 0.3, 0.011, 0.019, 0.027)))
    beam_solid = solid(h, 6.0, frame(z=(0.0, 1.0, 0.0), x=(0.0, 0.0, 1.0)))
    beam = product("IfcBeam", BEAM, (0.5, 2.0, 3.0), shape("SweptSolid", [beam_solid]))
    colour = make("IfcSurfaceStyleRendering", make("IfcColourRgb", None, 0.8, 0.2, 0.1), ReflectanceMethod="FLAT")
    style = make("IfcSurfaceStyle", "red", "BOTH", [colour])
    styles = [make("IfcPresentationStyleAssignment", [style])] if schema == "IFC2X3" else [style]
    make("IfcStyledItem", beam_solid, styles)
    make("IfcPresentationLayerAssignment", "steel", None, [beam.Representation.Representations[0]])

    tube = make("IfcRectangleHollowProfileDef", "AREA", "SHS200", centre, u * 0.2, u * 0.2, u * 0.01)
    source = make("IfcRepresentationMap", frame(), shape("SweptSolid", [solid(tube, 4.0, frame())]))
    columns = []
    for guid, at in ((COLUMN, (-0.5, 0.0, 0.0)), (TWIN, (4.5, 0.0, 0.0))):
        target = make("IfcCartesianTransformationOperator3D", LocalOrigin=point(0.0, 0.0, 0.0))
        columns.append(
            product("IfcColumn", guid, at, shape("MappedRepresentation", [make("IfcMappedItem", source, target)]))
        )
    plate = make("IfcRectangleProfileDef", "AREA", None, centre, u * 3.0, u * 0.2)
    wall = product("IfcWall", WALL, (10.0, 0.0, 0.0), shape("SweptSolid", [solid(plate, 3.0, frame())]))
    hole = product("IfcOpeningElement", new(), (0.5, 4.0, 2.9), shape("SweptSolid", [solid(plate, 0.2, frame())]))
    make("IfcRelVoidsElement", new(), owner, RelatingBuildingElement=beam, RelatedOpeningElement=hole)
    inside = [beam, *columns, wall]
    make("IfcRelContainedInSpatialStructure", new(), owner, RelatedElements=inside, RelatingStructure=storey)
    model.write(str(path))
    return path


def tessellated(model: ifcopenshell.file, guid: str) -> tuple[np.ndarray, np.ndarray]:
    """World vertices [V][3] in metres and triangles [T][3] of a product, openings left out."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    settings.set("disable-opening-subtractions", True)
    geometry = ifcopenshell.geom.create_shape(settings, model.by_guid(guid)).geometry
    return np.array(geometry.verts).reshape(-1, 3), np.array(geometry.faces).reshape(-1, 3)
