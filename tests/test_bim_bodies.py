"""Bodies of every kind that IFC has for linear elements, against the numbers that were written."""

import math

import ifcopenshell.geom
import numpy as np
import pytest
from ifc_files import UNITS, IfcFile, prism, turned

import linear_ik
from linear_ik.bim.body_check import stood
from linear_ik.bim.sweep import Sweep
from linear_ik.profile import Circle, CircleHollow, IShape, LShape, Polygon, Rectangle, TShape, UShape


def read_one(file, tmp_path, **settings):
    model = linear_ik.read_design(file.write(tmp_path / "model.ifc"), threads=1, **settings)
    assert not model.left_out, model.left_out
    assert len(model.members) == 1
    return model.members[0].element


def check_axis(element, start, end, tolerance_m=1e-6):
    T = element.placement.T_world_element
    np.testing.assert_allclose(T[:3, 3], start, atol=tolerance_m)
    np.testing.assert_allclose(T[:3, 3] + element.length_m * T[:3, 2], end, atol=tolerance_m)


def rectangle(file, x=0.2, y=0.4, position=None):
    return file.new("IfcRectangleProfileDef", "AREA", "R", position or file.frame2d(), x, y)


def ipe(file, position=None):
    return file.new(
        "IfcIShapeProfileDef", "AREA", "IPE300", position or file.frame2d(), 0.15, 0.3, 0.0071, 0.0107, 0.015
    )


def angle(file, position=None):
    return file.new("IfcLShapeProfileDef", "AREA", "L", position or file.frame2d(), 0.15, 0.1, 0.012)


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
@pytest.mark.parametrize("unit", UNITS)
def test_an_extrusion_in_any_unit(schema, unit, tmp_path):
    file, m = IfcFile(schema, unit), 1 / UNITS[unit]
    profile = file.new("IfcRectangleProfileDef", "AREA", "R", file.frame2d(), 0.2 * m, 0.4 * m)
    file.beam(
        file.extrusion(profile, 3 * m, file.frame((0, 0, 1 * m))),
        placement=file.frame((10 * m, 20 * m, 5 * m), (1, 0, 0), (0, 1, 0)),
        extra=() if schema == "IFC2X3" else (None,),
    )
    element = read_one(file, tmp_path)
    # Local Z is the world's X, local X its Y, so local Y is its Z.
    check_axis(element, (11, 20, 5), (14, 20, 5))
    np.testing.assert_allclose(element.placement.T_world_element[:3, 0], [0, 1, 0], atol=1e-9)
    assert isinstance(element.profile, Rectangle)
    assert (element.profile.x_dim, element.profile.y_dim) == pytest.approx((0.2, 0.4))
    assert (element.start, element.end) == ("free", "free")
    assert (element.placement_tolerance.translation_m, element.placement_tolerance.rotation_deg) == (0.05, 2.0)


def test_far_from_the_origin_digits_are_kept(tmp_path):
    file = IfcFile()
    file.beam(file.extrusion(ipe(file), 6), placement=file.frame((512345.678, 5402345.123, 98.765)))
    check_axis(read_one(file, tmp_path), (512345.678, 5402345.123, 98.765), (512345.678, 5402345.123, 104.765), 1e-8)


# IFC's cardinal points 1 to 9: where of the section the axis runs, as (x, y) of its bounding box, -1 to 1.
# Left is +X: the section is seen along the axis.
CARDINALS = {i + 1: (1 - i % 3, i // 3 - 1) for i in range(9)}


@pytest.mark.parametrize("cardinal", CARDINALS)
@pytest.mark.parametrize("by", ["profile", "solid"])
def test_the_axis_is_the_middle_of_the_section_whatever_point_it_was_drawn_from(cardinal, by, tmp_path):
    file = IfcFile()
    # Drawn from a corner: the section is shifted the other way.
    x, y = -CARDINALS[cardinal][0] * 0.075, -CARDINALS[cardinal][1] * 0.15
    if by == "profile":
        solid = file.extrusion(ipe(file, file.frame2d((x, y))), 5)
    else:
        solid = file.extrusion(ipe(file), 5, file.frame((x, y, 0)))
    file.beam(solid)
    element = read_one(file, tmp_path)
    check_axis(element, (x, y, 0), (x, y, 5))
    assert element.profile == IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)


def line_with_profile(file, point, profile, length=5.0, kind="IfcBeam", ends=None):
    """A member of an axis and a material profile alone."""
    curve = file.polyline(ends or [(0, 0, 0), (0, 0, length)])
    axis = file.new("IfcShapeRepresentation", file.context, "Axis", "Curve3D", [curve])
    made = file.product(kind, placement=file.frame((1, 2, 3), (1, 0, 0), (0, 1, 0)), extra=(None,))
    made.Representation = file.new("IfcProductDefinitionShape", None, None, [axis])
    material = file.new("IfcMaterial", "S355", None, None)
    one = file.new("IfcMaterialProfile", "P", None, material, profile, None, None)
    usage = file.new(
        "IfcMaterialProfileSetUsage", file.new("IfcMaterialProfileSet", "S", None, [one], None), point, None
    )
    file.rooted("IfcRelAssociatesMaterial", None, None, [made], usage)


@pytest.mark.parametrize("cardinal", CARDINALS)
def test_a_line_and_a_profile_make_a_member_without_a_body(cardinal, tmp_path):
    file = IfcFile()
    line_with_profile(file, cardinal, ipe(file))
    (member,) = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).members
    x, y = -CARDINALS[cardinal][0] * 0.075, -CARDINALS[cardinal][1] * 0.15
    # Local X is the world's Y, local Y its Z.
    check_axis(member.element, (1, 2 + x, 3 + y), (6, 2 + x, 3 + y))
    assert member.element.profile == IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)
    assert (member.profile_name, "no body" in member.remark) == ("IPE300", True)


def test_a_line_that_leaves_its_section_open_is_left_out(tmp_path):
    file = IfcFile()
    line_with_profile(file, 15, ipe(file))
    line_with_profile(file, 5, ipe(file), ends=[(0, 0, 0), (5, 0, 0)])
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert not model.members
    assert "cardinal point 15" in model.left_out[0].reason
    assert "not straight along its own Z" in model.left_out[1].reason


def test_the_position_may_be_in_the_solid_alone(tmp_path):
    file = IfcFile()
    file.beam(file.extrusion(rectangle(file), 4, file.frame((7, 8, 9), (0, 1, 0), (0, 0, 1))))
    element = read_one(file, tmp_path)
    check_axis(element, (7, 8, 9), (7, 12, 9))
    np.testing.assert_allclose(element.placement.T_world_element[:3, 0], [0, 0, 1], atol=1e-9)


def test_an_extrusion_backwards(tmp_path):
    file = IfcFile()
    file.product("IfcPile", file.extrusion(angle(file), 4, direction=(0, 0, -1)), extra=(None, None))
    element = read_one(file, tmp_path)
    check_axis(element, (0, 0, 0), (0, 0, -4))
    assert_section(element, angle_outline())


def test_an_extrusion_at_a_slant_shows_its_right_section(tmp_path):
    file = IfcFile()
    # A square 0.2 wide, pushed 30 degrees to the side: across the push it is 0.2 cos(30) wide.
    file.beam(file.extrusion(rectangle(file, 0.2, 0.2), 5, direction=(math.sin(math.pi / 6), 0, math.cos(math.pi / 6))))
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, Rectangle)
    assert sorted((element.profile.x_dim, element.profile.y_dim)) == pytest.approx([0.2 * math.cos(math.pi / 6), 0.2])
    # Both ends are cut at a slant; the length is from the first corner to the last.
    assert element.length_m == pytest.approx(5 + 0.2 * math.sin(math.pi / 6))
    np.testing.assert_allclose(element.placement.T_world_element[:3, 2], [0.5, 0, math.cos(math.pi / 6)], atol=1e-9)


def angle_outline():
    """The L of `angle`: corner at (-X, -Y), depth along Y, width along X."""
    x, y, t = 0.05, 0.075, 0.012
    return np.array([(-x, -y), (x, -y), (x, t - y), (t - x, t - y), (t - x, y), (-x, y)])


def assert_section(element, outline, tolerance_m=1e-6):
    """The element's outline, in the world's XY of a member along Z, is the one that was drawn."""
    T = element.placement.T_world_element
    own = element.profile.outline()
    drawn = np.column_stack([own, np.zeros(len(own))]) @ T[:3, :3].T + T[:3, 3]
    gaps = np.linalg.norm(drawn[:, None, :2] - np.asarray(outline)[None], axis=2)
    assert max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) < tolerance_m


@pytest.mark.parametrize("flip", [(-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("how", ["derived", "mapped"])
def test_a_mirrored_angle_keeps_its_corner_where_it_was_drawn(flip, how, tmp_path):
    file = IfcFile()
    x, y = (flip[0], 0), (0, flip[1])
    if how == "derived":
        operator = file.new(
            "IfcCartesianTransformationOperator2D", file.direction(*x), file.direction(*y), file.point(0.5, 0.25), 1.0
        )
        profile = file.new("IfcDerivedProfileDef", "AREA", "mirrored", angle(file), operator, None)
        solid, representation, offset = file.extrusion(profile, 3), "SweptSolid", (0.5, 0.25)
    else:
        operator = file.operator((*x, 0), (*y, 0), (0, 0, 1), (0.5, 0.25, 0))
        solid, representation = file.mapped([file.extrusion(angle(file), 3)], operator), "MappedRepresentation"
        offset = (0.5, 0.25)
    file.beam(solid, representation=representation)
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, LShape)
    assert np.linalg.det(element.placement.T_world_element[:3, :3]) == pytest.approx(1)
    assert_section(element, angle_outline() * flip + offset)


def test_a_mirrored_profile(tmp_path):
    file = IfcFile()
    mirrored = file.new("IfcMirroredProfileDef", "AREA", "mirrored", angle(file), None)
    file.beam(file.extrusion(mirrored, 3))
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, LShape)
    assert_section(element, angle_outline() * [-1, 1])


def test_a_map_that_scales(tmp_path):
    file = IfcFile()
    operator = file.operator((0, 1, 0), (-1, 0, 0), (0, 0, 1), (1, 2, 3), 2.0)
    file.product(
        "IfcColumn", file.mapped([file.extrusion(rectangle(file), 2)], operator), extra=(None,),
        representation="MappedRepresentation",
    )  # fmt: skip
    element = read_one(file, tmp_path)
    check_axis(element, (1, 2, 3), (1, 2, 7))
    assert (element.profile.x_dim, element.profile.y_dim) == pytest.approx((0.4, 0.8))
    np.testing.assert_allclose(element.placement.T_world_element[:3, 0], [0, 1, 0], atol=1e-9)


def test_the_length_is_what_the_clips_leave(tmp_path):
    file = IfcFile()
    solid = file.extrusion(ipe(file), 6)
    # Everything above a plane at z = 5.7 is cut off, and everything below one at 0.2.
    for z, agreement in ((5.7, False), (0.2, True)):
        plane = file.new("IfcPlane", file.frame((0, 0, z)))
        half = file.new("IfcHalfSpaceSolid", plane, agreement)
        solid = file.new("IfcBooleanClippingResult", "DIFFERENCE", solid, half)
    file.beam(solid, representation="Clipping")
    element = read_one(file, tmp_path)
    check_axis(element, (0, 0, 0.2), (0, 0, 5.7))
    assert isinstance(element.profile, IShape)


def test_openings_and_notches_leave_the_profile_whole(tmp_path):
    file = IfcFile()
    notch = file.extrusion(rectangle(file, 0.2, 0.2, file.frame2d((0, 0.2))), 0.5)
    beam = file.beam(
        file.new("IfcBooleanResult", "DIFFERENCE", file.extrusion(ipe(file), 6), notch), representation="CSG"
    )
    hole = file.extrusion(
        file.new("IfcCircleProfileDef", "AREA", None, file.frame2d(), 0.05),
        1,
        file.frame((-0.5, 0, 3), (1, 0, 0), (0, 1, 0)),
    )
    file.opening(beam, hole)
    element = read_one(file, tmp_path)
    check_axis(element, (0, 0, 0), (0, 0, 6))
    assert element.profile == IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)


def test_a_tapered_extrusion(tmp_path):
    file = IfcFile()
    circles = [file.new("IfcCircleProfileDef", "AREA", None, file.frame2d(), r) for r in (0.2, 0.1)]
    solid = file.new("IfcExtrudedAreaSolidTapered", circles[0], file.frame(), file.direction(0, 0, 1), 4.0, circles[1])
    file.product("IfcColumn", solid, extra=(None,), representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    check_axis(element, (0, 0, 0), (0, 0, 4))
    assert (element.profile, element.profile_end) == (Circle(0.2), Circle(0.1))


def test_a_taper_that_was_cut_keeps_its_slope():
    sweep = Sweep(np.eye(4), Rectangle(0.2, 0.6), 4.0, Rectangle(0.2, 0.2))
    cut = stood(sweep, np.array([[0, 0, 1.0], [0, 0, 3.0]]))
    np.testing.assert_allclose(cut.T_product_start[:3, 3], [0, 0, 1])
    assert (cut.length_m, cut.profile.y_dim, cut.profile_end.y_dim) == pytest.approx((2, 0.5, 0.3))


def test_a_haunch_with_one_flat_side(tmp_path):
    file = IfcFile()
    both = [rectangle(file, 0.2, y, file.frame2d((0, -y / 2))) for y in (0.6, 0.2)]
    solid = file.new("IfcExtrudedAreaSolidTapered", both[0], file.frame(), file.direction(0, 0, 1), 4.0, both[1])
    file.beam(solid, representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    T = element.placement.T_world_element
    for profile, depth in ((element.profile, 0.6), (element.profile_end, 0.2)):
        world_y = profile.outline() @ T[1, :2] + T[1, 3]
        assert (world_y.max(), world_y.min()) == pytest.approx((0, -depth))


@pytest.mark.parametrize("degrees", [True, False])
@pytest.mark.parametrize("angle_deg", [60, -60])
def test_a_revolved_body_has_a_curved_axis(degrees, angle_deg, tmp_path):
    file = IfcFile(degrees=degrees)
    # About an axis along Y, 2 m to the right of the section's middle: it turns in the plane XZ.
    hub = file.new("IfcAxis1Placement", file.point(2, 0, 0), file.direction(0, 1, 0))
    angle_in_file = angle_deg if degrees else math.radians(angle_deg)
    solid = file.new("IfcRevolvedAreaSolid", rectangle(file, 0.1, 0.2), file.frame(), hub, angle_in_file)
    file.beam(solid)
    element = read_one(file, tmp_path)
    T = element.placement.T_world_element
    points = np.array(element.axis_points) @ T[:3, :3].T + T[:3, 3]
    a = math.radians(angle_deg)
    # Right-handed about +Y: from (-2, 0) seen from the hub, x' = -2 cos a, z' = 2 sin a.
    np.testing.assert_allclose(points[0], [0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(points[-1], [2 - 2 * math.cos(a), 0, 2 * math.sin(a)], atol=1e-9)
    assert element.length_m == pytest.approx(2 * abs(a), abs=1e-3)
    np.testing.assert_allclose(np.linalg.norm(points - [2, 0, 0], axis=1), 2, atol=1e-9)
    assert sorted((element.profile.x_dim, element.profile.y_dim)) == pytest.approx([0.1, 0.2])
    assert abs(T[1, 0] if element.profile.x_dim > 0.15 else T[1, 1]) == pytest.approx(1)


def test_a_swept_disk_is_a_tube(tmp_path):
    file = IfcFile("IFC4", "millimetre")
    disk = file.new("IfcSweptDiskSolid", file.polyline([(0, 0, 0), (0, 3000, 0)]), 50.0, 45.0, None, None)
    file.product("IfcPipeSegment", disk, extra=(None,), representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    check_axis(element, (0, 0, 0), (0, 3, 0))
    assert (element.profile.radius, element.profile.wall_thickness) == pytest.approx((0.05, 0.005))


def bar(file, points, segments=None):
    if segments is None:
        return file.polyline(points)
    plist = file.new("IfcCartesianPointList3D", [[float(v) for v in p] for p in points])
    made = [file.new("IfcLineIndex" if len(s) == 2 else "IfcArcIndex", s) for s in segments]
    return file.new("IfcIndexedPolyCurve", plist, made, False)


def test_a_bent_bar_follows_its_arcs(tmp_path):
    file = IfcFile()
    h = 0.1 * (1 - math.sqrt(0.5))
    # Two metres along X, a quarter circle of 0.1 m, one metre along Z.
    curve = bar(
        file, [(0, 0, 0), (2, 0, 0), (2 + 0.1 * math.sqrt(0.5), 0, h), (2.1, 0, 0.1), (2.1, 0, 1.1)],
        [(1, 2), (2, 3, 4), (4, 5)],
    )  # fmt: skip
    disk = file.new("IfcSweptDiskSolid", curve, 0.01, None, None, None)
    file.product("IfcReinforcingBar", disk, extra=(None,) * 6, representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    assert element.length_m == pytest.approx(3 + 0.1 * math.pi / 2, abs=2e-4)
    T = element.placement.T_world_element
    np.testing.assert_allclose(T[:3, 3] + T[:3, :3] @ element.axis_points[-1], [2.1, 0, 1.1], atol=1e-9)
    assert element.profile == Circle(0.01)


def test_a_bar_with_rounded_corners(tmp_path):
    file = IfcFile()
    line = file.polyline([(0, 0, 0), (2, 0, 0), (2, 0, 1)])
    disk = file.new("IfcSweptDiskSolidPolygonal", line, 0.01, None, None, None, 0.1)
    file.product("IfcReinforcingBar", disk, extra=(None,) * 6, representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    assert element.length_m == pytest.approx(1.9 + 0.1 * math.pi / 2 + 0.9, abs=2e-4)


def test_a_pipe_along_a_composite_curve(tmp_path):
    file = IfcFile()
    circle = file.new("IfcCircle", file.frame((2, 0, 0.5), (0, -1, 0), (0, 0, -1)), 0.5)
    value = [file.f.create_entity("IfcParameterValue", v) for v in (0.0, math.pi / 2)]
    pieces = [
        file.polyline([(0, 0, 0), (2, 0, 0)]),
        file.new("IfcTrimmedCurve", circle, [value[0]], [value[1]], True, "PARAMETER"),
        file.polyline([(2.5, 0, 0.5), (2.5, 0, 2)]),
    ]
    segments = [file.new("IfcCompositeCurveSegment", "CONTINUOUS", True, piece) for piece in pieces]
    disk = file.new("IfcSweptDiskSolid", file.new("IfcCompositeCurve", segments, False), 0.05, 0.045, None, None)
    file.product("IfcPipeSegment", disk, extra=(None,), representation="AdvancedSweptSolid")
    element = read_one(file, tmp_path)
    assert element.length_m == pytest.approx(2 + 0.5 * math.pi / 2 + 1.5, abs=1e-3)
    T = element.placement.T_world_element
    np.testing.assert_allclose(T[:3, 3] + T[:3, :3] @ element.axis_points[-1], [2.5, 0, 2], atol=1e-6)


# Sections as an authoring tool draws them, corner by corner, in a frame that is turned and shifted.
I_DRAWN = IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)
U_DRAWN = UShape(0.2, 0.075, 0.0085, 0.0115, 0.0115)
T_DRAWN = TShape(0.1, 0.1, 0.011, 0.011, 0.011)
L_DRAWN = LShape(0.15, 0.1, 0.012, 0.012)
C, S = math.cos(0.3), math.sin(0.3)
R = np.array([[C, 0, S], [0, 1, 0], [-S, 0, C]]) @ np.array([[C, -S, 0], [S, C, 0], [0, 0, 1]])


@pytest.mark.parametrize("mirror", [(1, 1), (-1, 1)])
@pytest.mark.parametrize(
    "profile", [I_DRAWN, U_DRAWN, T_DRAWN, L_DRAWN, Rectangle(0.1, 0.2), Circle(0.1)], ids=lambda p: p.type
)
def test_outlines_are_recognised(profile, mirror, tmp_path):
    outline = profile.outline() * mirror + [3.0, 4.0]
    file = IfcFile()
    file.beam(file.extrusion(file.arbitrary(outline.tolist()), 4))
    element = read_one(file, tmp_path)
    assert type(element.profile) is type(profile)
    assert sorted(vars(element.profile).values()) == pytest.approx(sorted(vars(profile).values()), abs=2e-5)
    assert_section(element, outline, 1e-4)
    check_axis(element, (3, 4, 0), (3, 4, 4), 1e-4)


@pytest.mark.parametrize("triangulated", [True, False])
@pytest.mark.parametrize(
    "profile", [I_DRAWN, U_DRAWN, T_DRAWN, L_DRAWN, Rectangle(0.1, 0.2), Circle(0.1)], ids=lambda p: p.type
)
def test_meshes_are_cut(profile, triangulated, tmp_path):
    corners, faces = prism(profile.outline(), 4.0)
    file = IfcFile()
    kind = "Tessellation" if triangulated else "Brep"
    file.beam(file.box_mesh(turned(corners, R, [1, 2, 3]), faces, triangulated), representation=kind)
    element = read_one(file, tmp_path)
    assert type(element.profile) is type(profile)
    assert sorted(vars(element.profile).values()) == pytest.approx(sorted(vars(profile).values()), abs=2e-5)
    # A mesh has no start of its own: either end.
    T = element.placement.T_world_element
    ends = [T[:3, 3], T[:3, 3] + element.length_m * T[:3, 2]]
    np.testing.assert_allclose(sorted(ends, key=lambda p: p[2]), [[1, 2, 3], R[:, 2] * 4 + [1, 2, 3]], atol=1e-5)


def test_a_tapered_mesh(tmp_path):
    start, end = Rectangle(0.2, 0.5).outline(), Rectangle(0.2, 0.3).outline()
    corners, faces = prism(start, 4.0, end)
    file = IfcFile()
    file.beam(file.box_mesh(turned(corners, R, [1, 2, 3]), faces), representation="Brep")
    element = read_one(file, tmp_path)
    sides = [sorted((p.x_dim, p.y_dim)) for p in (element.profile, element.profile_end)]
    assert np.array(sorted(sides, key=max)) == pytest.approx(np.array([[0.2, 0.3], [0.2, 0.5]]), abs=1e-4)


def test_a_cambered_mesh(tmp_path):
    # Twelve straight pieces on a circle, 20 mm high over 12 m, as a detailing program writes a cambered beam.
    outline, n = Rectangle(0.1, 0.3).outline(), 12
    z = np.linspace(0, 12, n + 1)
    up = 0.02 * (1 - (z / 6 - 1) ** 2)
    corners = [(x, y + u, w) for w, u in zip(z, up, strict=True) for x, y in outline]
    sides = [
        [4 * k + i, 4 * k + (i + 1) % 4, 4 * k + 4 + (i + 1) % 4, 4 * k + 4 + i] for k in range(n) for i in range(4)
    ]
    faces = [[3, 2, 1, 0], [4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3], *sides]
    file = IfcFile()
    file.beam(file.box_mesh(corners, faces), representation="Brep")
    element = read_one(file, tmp_path)
    T = element.placement.T_world_element
    points = np.array(element.axis_points) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(points[:, 1], np.interp(points[:, 2], z, up), atol=1e-3)
    assert points[:, 1].max() == pytest.approx(0.02, abs=1e-3)


def test_a_section_that_is_none_of_the_named_ones_stays_as_drawn(tmp_path):
    z_shape = np.array([(0, 0), (0.05, 0), (0.05, 0.19), (0.1, 0.19), (0.1, 0.2), (0.04, 0.2), (0.04, 0.01), (0, 0.01)])
    file = IfcFile()
    file.beam(file.extrusion(file.arbitrary(z_shape.tolist()), 4))
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, Polygon)
    assert_section(element, z_shape)
    # The axis is in the middle of its bounding box.
    check_axis(element, (0.05, 0.1, 0), (0.05, 0.1, 4))


def test_a_hole_is_kept_where_it_makes_a_tube(tmp_path):
    file = IfcFile()
    outer, inner = Circle(0.1).outline(), Circle(0.092).outline()
    file.product("IfcColumn", file.extrusion(file.arbitrary(outer.tolist(), holes=[inner.tolist()]), 4), extra=(None,))
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, CircleHollow)
    assert (element.profile.radius, element.profile.wall_thickness) == pytest.approx((0.1, 0.008), abs=1e-6)


def test_pieces_one_behind_the_other_are_one_bent_member(tmp_path):
    # As an as-built member is written: straight pieces that lean against each other by 3 degrees.
    file, a = IfcFile(), math.radians(3)
    items, at, heading = [], np.zeros(3), 0.0
    nodes = [at]
    for _ in range(4):
        along = np.array([math.sin(heading), 0, math.cos(heading)])
        across = (math.cos(heading), 0, -math.sin(heading))
        items.append(file.extrusion(rectangle(file, 0.1, 0.2), 1.0, file.frame(at.tolist(), along.tolist(), across)))
        at, heading = at + along, heading + a
        nodes.append(at)
    file.beam(*items)
    element = read_one(file, tmp_path, tolerance_m=6e-3)
    T = element.placement.T_world_element
    np.testing.assert_allclose(np.array(element.axis_points) @ T[:3, :3].T + T[:3, 3], nodes, atol=1e-9)


OTHER_PROFILES = {
    "IfcCShapeProfileDef": (0.2, 0.08, 0.003, 0.02, None),
    "IfcZShapeProfileDef": (0.2, 0.08, 0.005, 0.005, None, None),
    "IfcAsymmetricIShapeProfileDef": (0.2, 0.3, 0.01, 0.015, None, 0.1, 0.012, None),
    "IfcTrapeziumProfileDef": (0.3, 0.2, 0.25, 0.05),
    "IfcEllipseProfileDef": (0.2, 0.1),
    "IfcRoundedRectangleProfileDef": (0.3, 0.2, 0.05),
}


@pytest.mark.parametrize("kind", OTHER_PROFILES)
def test_parameterised_sections_that_the_package_has_no_name_for_are_drawn(kind, tmp_path):
    file = IfcFile()
    profile = file.new(kind, "AREA", "P", file.frame2d((1, 2)), *OTHER_PROFILES[kind])
    file.beam(file.extrusion(profile, 4))
    element = read_one(file, tmp_path)
    assert isinstance(element.profile, Polygon)
    width, depth = np.ptp(element.profile.outline(), axis=0)
    # As the geometry kernel draws them.
    expected = {
        "IfcCShapeProfileDef": (0.08, 0.2),
        "IfcZShapeProfileDef": (0.16, 0.2),
        "IfcAsymmetricIShapeProfileDef": (0.2, 0.3),
        "IfcTrapeziumProfileDef": (0.3, 0.25),
        "IfcEllipseProfileDef": (0.4, 0.2),
        "IfcRoundedRectangleProfileDef": (0.3, 0.2),
    }[kind]
    assert (width, depth) == pytest.approx(expected, abs=2e-3)


def test_a_flange_that_slopes_is_drawn_and_one_that_hardly_does_is_not(tmp_path):
    for slope, kind in ((0.08, Polygon), (0.001, UShape)):
        file = IfcFile()
        profile = file.new(
            "IfcUShapeProfileDef", "AREA", "U", file.frame2d(), 0.2, 0.075, 0.0085, 0.0115, 0.0115, 0.006, slope
        )
        file.beam(file.extrusion(profile, 4))
        assert type(read_one(file, tmp_path).profile) is kind


def test_a_beam_with_an_end_plate_is_read_from_its_longest_solid(tmp_path):
    file = IfcFile()
    plate = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.25, 0.4)
    file.beam(file.extrusion(ipe(file), 6), file.extrusion(plate, 0.02, file.frame((0, 0, -0.02))))
    (member,) = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).members
    assert member.element.profile == IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)
    assert member.remark
    check_axis(member.element, (0, 0, -0.02), (0, 0, 6), 0.021)


def test_a_column_with_a_corbel_keeps_its_section_and_says_so(tmp_path):
    outline = [(0, 0), (0.3, 0), (0.3, 3.0), (0.5, 3.2), (0.5, 3.5), (0.3, 3.5), (0.3, 5), (0, 5)]
    corners, faces = prism(outline, 0.4)
    file = IfcFile()
    # Drawn lying: its length is y, its section x and z.
    file.product("IfcColumn", file.box_mesh(corners, faces), extra=(None,), representation="Brep")
    (member,) = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).members
    assert sorted(vars(member.element.profile).values()) == pytest.approx([0.3, 0.4])
    assert member.element.length_m == pytest.approx(5)
    assert member.remark == "its body sticks out of its section by 200.0 mm"


def elbow(file):
    """A pipe of 100 mm that turns off after 3 m, for another 0.82 m."""
    return file.new("IfcSweptDiskSolid", file.polyline([(0, 0, 0), (0, 0, 3), (0.8, 0, 3.2)]), 0.05, None, None, None)


def test_a_pipe_with_two_legs_that_is_only_a_mesh_is_no_straight_one(tmp_path):
    drawn, file = IfcFile(), IfcFile()
    geometry = ifcopenshell.geom.create_shape(ifcopenshell.geom.settings(), elbow(drawn))
    corners, faces = (np.array(flat).reshape(-1, 3).tolist() for flat in (geometry.verts, geometry.faces))
    file.product("IfcPipeSegment", file.box_mesh(corners, faces, True), extra=(None,), representation="Tessellation")
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert not model.members and len(model.obstacles) == 1
    assert "sticks out of its section by 76" in model.left_out[0].reason
    # As it was drawn it is read along both legs.
    file = IfcFile()
    file.product("IfcPipeSegment", elbow(file), extra=(None,), representation="AdvancedSweptSolid")
    assert read_one(file, tmp_path).axis_points


def test_a_bent_pipe_that_a_map_stretches_is_no_straight_one(tmp_path):
    file = IfcFile()
    disk = file.new("IfcSweptDiskSolid", file.polyline([(0, 0, 0), (0, 0, 2), (1, 0, 3)]), 0.05, None, None, None)
    operator = file.new(
        "IfcCartesianTransformationOperator3DnonUniform", None, None, file.point(0, 0, 0), 1.0, None, 1.0, 2.0
    )
    mapped = file.mapped([disk], operator)
    file.product("IfcPipeSegment", mapped, extra=(None,), representation="MappedRepresentation")
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert not model.members and model.left_out[0].reason
