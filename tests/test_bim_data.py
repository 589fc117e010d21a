"""The files of the data folder, whole: nothing lost, everything where the kernel puts it.

The figures are derived from the files' own text and attributes, not with the reader.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import fields
from functools import cache
from pathlib import Path

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.element
import ifcopenshell.util.unit
import numpy as np
import pytest
import shapely

import linear_ik
from linear_ik.profile import CircleHollow, IShape, LShape, Polygon, Rectangle, RectangleHollow, TShape

DATA = Path(os.environ.get("LINEAR_IK_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "ifc"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the design models are not in {DATA} (LINEAR_IK_DATA)")

TEKLA, REVIT, HVAC = "01_tekla_mini_project", "05_revit_example", "07_hvac_heating"
GIRDERS, INCH, PILES = "14_pgsuper_girders_4x3", "15_inch_mirrored_profiles", "16_foot_piles_typed"
LINEAR = "IFC(BEAM|COLUMN|MEMBER|PILE|PIPESEGMENT|DUCTSEGMENT|CABLECARRIERSEGMENT|RAIL|REINFORCINGBAR)"
# As the file lies there: its schema, its unit, and how many products of the linear classes its text has.
FILES = {
    TEKLA: ("IFC2X3", 0.001, {"IFCBEAM": 1949, "IFCCOLUMN": 26, "IFCMEMBER": 228}),
    REVIT: ("IFC2X3", 0.001, {"IFCBEAM": 43, "IFCCOLUMN": 42}),
    HVAC: ("IFC4", 0.001, {"IFCPIPESEGMENT": 100}),
    GIRDERS: ("IFC4X3_ADD2", 1.0, {"IFCBEAM": 5}),
    INCH: ("IFC4", 0.0254, {"IFCMEMBER": 6}),
    PILES: ("IFC4X3_ADD2", 0.3048, {"IFCPILE": 4}),
}
MM = 1e-3


@cache
def design(name, **settings):
    return linear_ik.read_design(DATA / f"{name}.ifc", threads=1, obstacles=False, **settings)


@cache
def model(name):
    return ifcopenshell.open(str(DATA / f"{name}.ifc"))


@cache
def world_bodies(name):
    """The vertices of every member in world coordinates, straight from the library."""
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    settings.set("circle-segments", 48)
    settings.set("function-step-param", 5.0)
    file = model(name)
    products = [file.by_guid(member.guid) for member in design(name).members]
    iterator = ifcopenshell.geom.iterator(
        settings, file, 1, include=products, geometry_library="hybrid-cgal-simple-opencascade"
    )
    return {shape.guid: np.array(shape.geometry.verts).reshape(-1, 3) for shape in iterator}


@pytest.mark.parametrize("name", FILES)
def test_every_product_of_a_linear_class_is_a_member_or_left_out(name, capfd):
    schema, unit, counts = FILES[name]
    text = (DATA / f"{name}.ifc").read_text(errors="replace")
    found = re.findall(rf"^#\d+\s*=\s*({LINEAR})\('([^']*)'", text, re.MULTILINE)
    assert Counter(kind for kind, *_ in found) == counts
    read = design(name)
    assert (read.schema, read.source) == (schema, f"{name}.ifc")
    assert read.length_unit_m == pytest.approx(unit)
    assert Counter([*(m.guid for m in read.members), *(one.guid for one in read.left_out)]) == Counter(
        guid for *_, guid in found
    )
    assert all(one.reason for one in read.left_out)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("name", FILES)
def test_axis_and_section_agree_with_the_tessellation_within_1_mm(name):
    bodies = world_bodies(name)
    cut = 0
    for member in design(name).members:
        if member.remark:
            continue
        element = member.element
        T = element.placement.T_world_element
        local = (bodies[member.guid] - T[:3, 3]) @ T[:3, :3]
        if element.axis_points is not None:
            # The two cambered beams: their ends, and their rise.
            axis = np.array(element.axis_points)
            assert abs(local[:, 2].max() - axis[-1, 2]) < MM and abs(local[:, 2].min()) < MM, member
            continue
        assert abs(local[:, 2].min()) < MM and abs(local[:, 2].max() - element.length_m) < MM, member
        outline = element.profile.outline()
        assert shapely.distance(shapely.Polygon(outline).buffer(1e-6), shapely.points(local[:, :2])).max() < MM, member
        # A body that was cut lies inside; any other one fills its section from side to side.
        size = np.ptp(local[:, :2], axis=0) - np.ptp(outline, axis=0)
        representation = model(name).by_guid(member.guid).Representation.Representations
        if any(r.RepresentationType in ("CSG", "Clipping") for r in representation):
            cut += 1
        else:
            # The kernel's circles have 48 corners.
            assert np.abs(size).max() < (MM if element.profile.radius_m is None else 3e-3 * outline.max()), member
    assert (cut > 0) == (name == TEKLA)


def swept(product):
    """The one extrusion of a body, maps and booleans opened, or None."""
    body = next(r for r in product.Representation.Representations if r.RepresentationIdentifier == "Body")
    if len(body.Items) != 1:
        return None
    item = body.Items[0]
    while not item.is_a("IfcExtrudedAreaSolid"):
        if item.is_a("IfcMappedItem"):
            item = item.MappingSource.MappedRepresentation.Items[0]
        elif item.is_a("IfcBooleanResult"):
            item = item.FirstOperand
        else:
            return None
    return item


def test_the_pipes_of_the_heating_are_those_longer_than_three_diameters():
    expected = Counter()
    for product in model(HVAC).by_type("IfcPipeSegment"):
        solid = swept(product)
        kind = solid.SweptArea.is_a()
        expected[kind if solid.Depth >= 6 * solid.SweptArea.Radius else "stub"] += 1
    found = Counter(
        "IfcCircleHollowProfileDef" if isinstance(m.element.profile, CircleHollow) else "IfcCircleProfileDef"
        for m in design(HVAC).members
    )
    found["stub"] = len(design(HVAC).left_out)
    assert found == expected == Counter(IfcCircleProfileDef=59, IfcCircleHollowProfileDef=1, stub=40)
    lengths = {m.guid: m.element.length_m for m in design(HVAC).members}
    for product in model(HVAC).by_type("IfcPipeSegment"):
        if product.GlobalId in lengths:
            assert lengths[product.GlobalId] == pytest.approx(swept(product).Depth / 1000, abs=1e-6)


def test_the_parameterised_sections_of_tekla():
    kinds = {
        "IfcCircleHollowProfileDef": lambda p: 2 * p.Radius,
        "IfcCircleProfileDef": lambda p: 2 * p.Radius,
        "IfcIShapeProfileDef": lambda p: max(p.OverallDepth, p.OverallWidth),
        "IfcLShapeProfileDef": lambda p: max(p.Depth, p.Width),
    }
    expected, left = Counter(), Counter()
    for product in model(TEKLA).by_type("IfcBeam") + model(TEKLA).by_type("IfcColumn"):
        solid = swept(product)
        if solid is None or solid.SweptArea.is_a() not in kinds:
            continue
        body = product.Representation.Representations[0].RepresentationType
        kind = solid.SweptArea.is_a()
        if body == "SweptSolid":
            (expected if solid.Depth >= 3 * kinds[kind](solid.SweptArea) else left)[kind] += 1
    plain = Counter()
    for member in design(TEKLA).members:
        solid = swept(model(TEKLA).by_guid(member.guid))
        body = model(TEKLA).by_guid(member.guid).Representation.Representations[0].RepresentationType
        if solid is not None and body == "SweptSolid" and solid.SweptArea.is_a() in kinds:
            plain[solid.SweptArea.is_a()] += 1
            assert type(member.element.profile).__name__ == kinds_of(solid.SweptArea.is_a())
    assert plain == expected
    assert sum(expected.values()) + sum(left.values()) == 200 + 48 + 83 + 2


def kinds_of(ifc_name):
    return ifc_name.removeprefix("Ifc").removesuffix("ProfileDef")


def dimensions(profile):
    return tuple(getattr(profile, f.name) for f in fields(profile))


def test_steel_of_tekla_by_name():
    named = {m.profile_name: m.element.profile for m in design(TEKLA).members}
    assert isinstance(named["IPE300"], IShape) and isinstance(named["L120/12"], LShape)
    assert dimensions(named["IPE300"]) == pytest.approx((0.15, 0.3, 0.0071, 0.0107, 0.015), abs=1e-6)
    assert dimensions(named["L120/12"]) == pytest.approx((0.12, 0.12, 0.012, 0.013), abs=1e-9)
    # Clipped beams keep the length that the clips leave.
    ipe = [m for m in design(TEKLA).members if m.profile_name == "IPE240"]
    assert ipe and all(m.element.length_m < swept(model(TEKLA).by_guid(m.guid)).Depth / 1000 + 1e-6 for m in ipe)


def test_cambered_beams_of_tekla_are_curved():
    curved = [m for m in design(TEKLA).members if m.element.axis_points]
    assert {ifcopenshell.util.element.get_type(model(TEKLA).by_guid(m.guid)).Name for m in curved} == {
        "HEA360",
        "HEB360",
    }
    for member in curved:
        axis = np.array(member.element.axis_points)
        rise = np.linalg.norm(axis[:, :2] - np.outer(axis[:, 2] / axis[-1, 2], axis[-1, :2]), axis=1).max()
        assert 0.01 < rise < 0.015
        assert isinstance(member.element.profile, IShape)


def test_the_polygons_of_revit_are_the_sections_that_their_names_say():
    by_name = {}
    for member in design(REVIT).members:
        by_name.setdefault(member.profile_name, []).append(member.element.profile)
    channels = by_name["300PFC40.1"]
    # 300PFC: 300 x 90 mm, web 8, flanges 16.
    assert len(channels) == 18
    for profile in channels:
        dimensions = (profile.depth, profile.flange_width, profile.web_thickness, profile.flange_thickness)
        assert dimensions == pytest.approx((0.3, 0.09, 0.008, 0.016), abs=1e-5)
    boxes = by_name["100x6.0SHS"]
    assert len(boxes) == 17 and all(isinstance(p, RectangleHollow) for p in boxes)
    assert all((p.x_dim, p.y_dim, p.wall_thickness) == pytest.approx((0.1, 0.1, 0.006), abs=1e-5) for p in boxes)
    # 310UC96.8: 308 x 305 mm, web 9.9, flanges 15.4.
    for profile in by_name["310UC96.8"]:
        dimensions = (profile.overall_depth, profile.overall_width, profile.web_thickness, profile.flange_thickness)
        assert dimensions == pytest.approx((0.308, 0.305, 0.0099, 0.0154), abs=1e-5)
    # L 3 1/2 x 3 x 3/8 inch.
    for profile in by_name["L3-1/2X3X3/8"]:
        assert isinstance(profile, LShape)
        assert sorted((profile.depth, profile.width)) == pytest.approx([0.0762, 0.0889], abs=1e-5)
        assert profile.thickness == pytest.approx(0.009525, abs=1e-5)
    # Stubs of 430 mm under the 300 mm deep columns.
    assert {one.reason for one in design(REVIT).left_out} == {"it is a stub, not linear: 430 x 300 x 90 mm"}
    assert len(design(REVIT).left_out) == 5


def test_the_girders():
    for member in design(GIRDERS).members:
        assert isinstance(member.element.profile, Polygon)
        # The file's own figures: WF66G, 66 inches deep, 49 wide, and the distance between its two sections.
        np.testing.assert_allclose(
            sorted(np.ptp(member.element.profile.outline(), axis=0)), [1.2446, 1.6764], atol=1e-6
        )
        solid = model(GIRDERS).by_guid(member.guid).Representation.Representations[0].Items[0]
        ends = [position.Location.DistanceAlong.wrappedValue for position in solid.CrossSectionPositions]
        assert member.element.length_m == pytest.approx(ends[1] - ends[0], abs=1e-6)
        # The cross slope of 5 %: the axis climbs as the roadway does.
        assert member.element.placement.T_world_element[2, 2] == pytest.approx(0.0499376, abs=1e-6)


def test_the_mirrored_profiles_in_inches():
    read = design(INCH, slenderness=0.5)
    profiles = {m.profile_name: m.element for m in read.members}
    assert not read.left_out
    inch = 0.0254
    assert isinstance(profiles["WT8x25"].profile, TShape)
    assert profiles["WT8x25"].profile.depth == pytest.approx(8.125 * inch)
    assert isinstance(profiles["HSS6x6x.375"].profile, RectangleHollow)
    assert dimensions(profiles["HSS6x6x.375"].profile) == pytest.approx((6 * inch, 6 * inch, 0.375 * inch))
    assert isinstance(profiles['FB1/4"x1"'].profile, Rectangle)
    assert dimensions(profiles['FB1/4"x1"'].profile) == pytest.approx((0.25 * inch, inch))
    assert profiles["W8x18"].profile.overall_depth == pytest.approx(8.125 * inch)
    # The solid's X and Y are the product's Y and Z; the L's heel, at x = -2 and y = -3 inches, is mirrored to x = 2.
    corner = l_corner(profiles["L6x4x1/2"])
    drawn = placed(model(INCH).by_guid("0ymXLmGUz4WPyHYyZL4hYc"), (0, 2, -3)) * inch
    assert np.linalg.norm(corner - drawn) < 1e-6


def placed(product, point):
    """A point of the product's coordinates in the world, in inches."""
    import ifcopenshell.util.placement as placement

    return (placement.get_local_placement(product.ObjectPlacement) @ [*point, 1])[:3]


def l_corner(element):
    """The heel of an L at the start of its axis, in the world."""
    T = element.placement.T_world_element
    return T[:3, 3] - T[:3, 0] * element.profile.width / 2 - T[:3, 1] * element.profile.depth / 2


def test_the_piles_in_feet():
    foot = 0.3048
    members = design(PILES).members
    assert [m.name for m in members] == ["P1", "P2", "P3", "P4"]
    for member, y in zip(members, (9, 3, -3, -9), strict=True):
        T = member.element.placement.T_world_element
        np.testing.assert_allclose(T[:3, 3], [0, y * foot, 0], atol=1e-9)
        np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-9)
        assert member.element.length_m == pytest.approx(40 * foot)
        assert isinstance(member.element.profile, CircleHollow)
        assert dimensions(member.element.profile) == pytest.approx((0.75 * foot, 0.03125 * foot))
        assert member.profile_name == "18 in. x 0.375 in."


def test_the_other_bodies_stand_in_the_way_and_the_kernel_keeps_quiet(capfd):
    # The deck and the railings follow a gradient curve, whose sections the kernel prints.
    read = linear_ik.read_design(DATA / f"{GIRDERS}.ifc", threads=2)
    assert Counter(o.ifc_class for o in read.obstacles) == {"IfcRailing": 2, "IfcSlab": 1}
    assert capfd.readouterr().out == ""
    revit = linear_ik.read_design(DATA / f"{REVIT}.ifc", threads=2)
    text = (DATA / f"{REVIT}.ifc").read_text(errors="replace")
    others = len(re.findall(r"^#\d+\s*=\s*IFC(SLAB|WALLSTANDARDCASE|BUILDINGELEMENTPROXY)\(", text, re.M))
    assert len(revit.obstacles) == others + len(revit.left_out)
    # Two threads give what one does.
    assert [m.guid for m in revit.members] == [m.guid for m in design(REVIT).members]
    assert [m.element for m in revit.members] == [m.element for m in design(REVIT).members]
    for obstacle in revit.obstacles:
        assert obstacle.triangles.max() < len(obstacle.vertices_m)
        assert np.isfinite(obstacle.vertices_m).all()
