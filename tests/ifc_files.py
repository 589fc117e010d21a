"""IFC files for tests, written entity by entity, whose truth is in the numbers that were put in."""

from __future__ import annotations

import math
from pathlib import Path

import ifcopenshell
import ifcopenshell.guid
import numpy as np

UNITS = {"metre": 1.0, "millimetre": 1e-3, "foot": 0.3048, "inch": 0.0254}


class IfcFile:
    """A file with a project and a site; coordinates are taken in the file's own unit.

    Args:
        schema: IFC2X3, IFC4 or IFC4X3.
        unit: one of UNITS.
        north: IfcGeometricRepresentationContext's TrueNorth, or None.
        degrees: whether angles are in degrees.
    """

    def __init__(self, schema="IFC4", unit="metre", north=None, degrees=False):
        self.f = ifcopenshell.file(schema="IFC4X3_ADD2" if schema == "IFC4X3" else schema)
        self.schema = schema
        units = [self._length_unit(unit)]
        if degrees:
            radian = self.new("IfcSIUnit", None, "PLANEANGLEUNIT", None, "RADIAN")
            of = self.new("IfcMeasureWithUnit", self.f.create_entity("IfcPlaneAngleMeasure", math.pi / 180), radian)
            none = self.new("IfcDimensionalExponents", 0, 0, 0, 0, 0, 0, 0)
            units.append(self.new("IfcConversionBasedUnit", none, "PLANEANGLEUNIT", "DEGREE", of))
        self.context = self.new(
            "IfcGeometricRepresentationContext", None, "Model", 3, 1e-6, self.frame(),
            self.direction(*north) if north else None,
        )  # fmt: skip
        self.owner = self._owner() if schema == "IFC2X3" else None
        assignment = self.new("IfcUnitAssignment", units)
        self.project = self.rooted("IfcProject", "project", None, None, None, None, [self.context], assignment)
        self.products = []

    def new(self, kind, *values):
        return self.f.create_entity(kind, *values)

    def rooted(self, kind, name, *values):
        return self.new(kind, ifcopenshell.guid.new(), self.owner, name, *values)

    def point(self, *xyz):
        return self.new("IfcCartesianPoint", [float(v) for v in xyz])

    def direction(self, *xyz):
        return self.new("IfcDirection", [float(v) for v in xyz])

    def frame(self, location=(0, 0, 0), axis=(0, 0, 1), ref=(1, 0, 0)):
        return self.new("IfcAxis2Placement3D", self.point(*location), self.direction(*axis), self.direction(*ref))

    def frame2d(self, location=(0, 0), ref=(1, 0)):
        return self.new("IfcAxis2Placement2D", self.point(*location), self.direction(*ref))

    def polyline(self, points):
        return self.new("IfcPolyline", [self.point(*p) for p in points])

    def arbitrary(self, points, name="drawn", holes=()):
        closed = [self.polyline([*ring, ring[0]]) for ring in (points, *holes)]
        if holes:
            return self.new("IfcArbitraryProfileDefWithVoids", "AREA", name, closed[0], closed[1:])
        return self.new("IfcArbitraryClosedProfileDef", "AREA", name, closed[0])

    def extrusion(self, profile, depth, position=None, direction=(0, 0, 1)):
        return self.new(
            "IfcExtrudedAreaSolid", profile, position or self.frame(), self.direction(*direction), float(depth)
        )

    def operator(self, x=None, y=None, z=None, origin=(0, 0, 0), scale=None):
        axes = [self.direction(*a) if a else None for a in (x, y)]
        return self.new(
            "IfcCartesianTransformationOperator3D", *axes, self.point(*origin), scale,
            self.direction(*z) if z else None,
        )  # fmt: skip

    def mapped(self, items, operator, kind="SweptSolid"):
        inner = self.new("IfcShapeRepresentation", self.context, "Body", kind, items)
        source = self.new("IfcRepresentationMap", self.frame(), inner)
        return self.new("IfcMappedItem", source, operator)

    def product(self, kind, *items, name="member", placement=None, representation="SweptSolid", tag="T1", extra=()):
        """Place a product whose body is the items; ``placement`` is relative to the world."""
        body = None
        if items:
            shape = self.new("IfcShapeRepresentation", self.context, "Body", representation, list(items))
            body = self.new("IfcProductDefinitionShape", None, None, [shape])
        where = self.new("IfcLocalPlacement", None, placement or self.frame())
        made = self.rooted(kind, name, None, None, where, body, tag, *extra)
        self.products.append(made)
        return made

    def beam(self, *items, **options):
        return self.product("IfcBeam", *items, **options)

    def opening(self, host, solid):
        shape = self.new("IfcShapeRepresentation", self.context, "Body", "SweptSolid", [solid])
        where = self.new("IfcLocalPlacement", None, self.frame())
        hole = self.rooted(
            "IfcOpeningElement", "hole", None, None, where, self.new("IfcProductDefinitionShape", None, None, [shape]),
            None,
        )  # fmt: skip
        self.rooted("IfcRelVoidsElement", None, None, host, hole)

    def typed(self, product, kind, *values):
        made = self.rooted(kind, "type", None, None, None, None, None, None, *values)
        self.rooted("IfcRelDefinesByType", None, None, [product], made)

    def box_mesh(self, corners, faces, triangulated=False):
        """A Brep of polygons [[corner index, ...], ...], or a triangulated face set."""
        if triangulated:
            triangles = [[f[0] + 1, f[i] + 1, f[i + 1] + 1] for f in faces for i in range(1, len(f) - 1)]
            points = self.new("IfcCartesianPointList3D", [[float(v) for v in c] for c in corners])
            return self.new("IfcTriangulatedFaceSet", points, None, True, triangles)
        points = [self.point(*c) for c in corners]
        shell = []
        for face in faces:
            loop = self.new("IfcPolyLoop", [points[i] for i in face])
            shell.append(self.new("IfcFace", [self.new("IfcFaceOuterBound", loop, True)]))
        return self.new("IfcFacetedBrep", self.new("IfcClosedShell", shell))

    def write(self, path: Path, header=None, bom=False) -> Path:
        self.f.write(str(path))
        text = path.read_text()
        if header is not None:
            text = text.replace("IFC4X3_ADD2" if self.schema == "IFC4X3" else self.schema, header, 1)
        path.write_bytes((b"\xef\xbb\xbf" if bom else b"") + text.encode())
        return path

    def _length_unit(self, unit):
        if unit in ("metre", "millimetre"):
            return self.new("IfcSIUnit", None, "LENGTHUNIT", "MILLI" if unit == "millimetre" else None, "METRE")
        metre = self.new("IfcSIUnit", None, "LENGTHUNIT", None, "METRE")
        measure = self.new("IfcMeasureWithUnit", self.f.create_entity("IfcLengthMeasure", UNITS[unit]), metre)
        return self.new(
            "IfcConversionBasedUnit", self.new("IfcDimensionalExponents", 1, 0, 0, 0, 0, 0, 0), "LENGTHUNIT",
            unit.upper(), measure,
        )  # fmt: skip

    def _owner(self):
        person = self.new("IfcPerson", None, "x")
        organisation = self.new("IfcOrganization", None, "x")
        both = self.new("IfcPersonAndOrganization", person, organisation)
        application = self.new("IfcApplication", organisation, "1", "tests", "tests")
        return self.new("IfcOwnerHistory", both, application, None, "ADDED", None, None, None, 0)


def prism(outline, length, tip=None):
    """Corners and faces of a prism along z on an outline, or of a frustum that ends in the outline ``tip``."""
    n = len(outline)
    tip = outline if tip is None else tip
    corners = [(x, y, 0.0) for x, y in outline] + [(x, y, length) for x, y in tip]
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return corners, [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


def turned(corners, R, offset):
    return (np.asarray(corners) @ np.asarray(R).T + offset).tolist()
