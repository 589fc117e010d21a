"""Profiles, their outlines and their section properties."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from samples import SAMPLES

from linear_ik.errors import ElementError
from linear_ik.profile import (
    PROFILES,
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Polygon,
    Profile,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)
from linear_ik.section import extruded_mesh, section_properties

ALL = pytest.mark.parametrize("profile", SAMPLES.values(), ids=SAMPLES.keys())
QUARTER = 1 - math.pi / 4  # of r^2: what a fillet adds to a corner


def section(profile: Profile) -> shapely.Polygon:
    hole = profile.hole()
    return shapely.Polygon(profile.outline(), [] if hole is None else [hole])


def test_every_named_profile_has_a_sample() -> None:
    assert {p.type for p in SAMPLES.values()} == set(PROFILES)


@ALL
def test_outline_is_a_simple_counter_clockwise_polygon(profile: Profile) -> None:
    outline = profile.outline()
    assert outline.shape[1] == 2 and not np.array_equal(outline[0], outline[-1])
    for ring in (outline, profile.hole()):
        if ring is not None:
            assert shapely.Polygon(ring).is_valid and shapely.LinearRing(ring).is_ccw
    edges = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    assert edges.min() > 1e-6


@ALL
def test_hole_lies_inside(profile: Profile) -> None:
    hole = profile.hole()
    assert (hole is not None) == profile.type.endswith("_hollow")
    if hole is not None:
        assert shapely.Polygon(profile.outline()).contains_properly(shapely.Polygon(hole))


@pytest.mark.parametrize(
    ("profile", "width", "depth"),
    [
        (Rectangle(0.1, 0.3), 0.1, 0.3),
        (RectangleHollow(0.1, 0.3, 0.01), 0.1, 0.3),
        (Circle(0.2), 0.4, 0.4),
        (CircleHollow(0.2, 0.1), 0.4, 0.4),
        (IShape(0.2, 0.3, 0.01, 0.02), 0.2, 0.3),
        (LShape(0.3, 0.2, 0.01), 0.2, 0.3),
        (UShape(0.3, 0.2, 0.01, 0.02), 0.2, 0.3),
        (TShape(0.3, 0.2, 0.01, 0.02), 0.2, 0.3),
    ],
    ids=lambda v: v.type if isinstance(v, Profile) else "",
)
def test_named_profiles_are_centred_with_width_along_x(profile: Profile, width: float, depth: float) -> None:
    outline = profile.outline()
    np.testing.assert_allclose(outline.max(axis=0), [width / 2, depth / 2], atol=1e-15)
    np.testing.assert_allclose(outline.min(axis=0), [-width / 2, -depth / 2], atol=1e-15)


@pytest.mark.parametrize(
    ("profile", "solid", "empty"),
    [
        (IShape(0.2, 0.3, 0.01, 0.02), [(0, 0), (0.09, 0.14), (-0.09, -0.14)], [(0.09, 0), (-0.09, 0)]),
        (LShape(0.3, 0.2, 0.02), [(-0.09, -0.14), (-0.09, 0.14), (0.09, -0.14)], [(0, 0), (0.09, 0.14)]),
        (UShape(0.3, 0.2, 0.02, 0.02), [(-0.09, 0), (0.09, 0.14), (0.09, -0.14)], [(0, 0), (0.09, 0)]),
        (TShape(0.3, 0.2, 0.02, 0.02), [(0, -0.14), (0.09, 0.14), (-0.09, 0.14)], [(0.09, -0.14), (-0.09, 0)]),
        (RectangleHollow(0.2, 0.3, 0.02), [(-0.09, 0), (0, 0.14)], [(0, 0), (0.07, 0.12)]),
        (CircleHollow(0.2, 0.02), [(-0.19, 0), (0, 0.19)], [(0, 0), (0.17, 0)]),
    ],
    ids=lambda v: v.type if isinstance(v, Profile) else "",
)
def test_material_is_where_ifc_has_it(profile: Profile, solid: list, empty: list) -> None:
    shape = section(profile)
    assert [shape.contains(shapely.Point(p)) for p in solid] == [True] * len(solid)
    assert [shape.contains(shapely.Point(p)) for p in empty] == [False] * len(empty)


@pytest.mark.parametrize(
    ("profile", "area"),
    [
        (Rectangle(0.1, 0.3), 0.03),
        (RectangleHollow(0.1, 0.3, 0.01), 0.03 - 0.08 * 0.28),
        (Circle(0.2), math.pi * 0.04),
        (CircleHollow(0.2, 0.05), math.pi * (0.04 - 0.0225)),
        (IShape(0.2, 0.3, 0.01, 0.02), 2 * 0.2 * 0.02 + 0.26 * 0.01),
        (LShape(0.3, 0.2, 0.02), 0.3 * 0.02 + 0.18 * 0.02),
        (UShape(0.3, 0.2, 0.01, 0.02), 2 * 0.2 * 0.02 + 0.26 * 0.01),
        (TShape(0.3, 0.2, 0.01, 0.02), 0.2 * 0.02 + 0.28 * 0.01),
        (Polygon([[0, 0], [4, 0], [0, 3]]), 6.0),
    ],
    ids=lambda v: v.type if isinstance(v, Profile) else "",
)
def test_area_by_hand(profile: Profile, area: float) -> None:
    assert section_properties(profile).area_m2 == pytest.approx(area, rel=1e-13)


@pytest.mark.parametrize(
    ("sharp", "rounded", "fillets"),
    [
        (IShape(0.2, 0.3, 0.01, 0.02), IShape(0.2, 0.3, 0.01, 0.02, 0.02), 4),
        (LShape(0.3, 0.2, 0.02), LShape(0.3, 0.2, 0.02, 0.02), 1),
        (UShape(0.3, 0.2, 0.01, 0.02), UShape(0.3, 0.2, 0.01, 0.02, 0.02), 2),
        (TShape(0.3, 0.2, 0.01, 0.02), TShape(0.3, 0.2, 0.01, 0.02, 0.02), 2),
    ],
    ids=lambda v: v.type if isinstance(v, Profile) else "",
)
def test_fillets_add_material_in_the_inner_corners(sharp: Profile, rounded: Profile, fillets: int) -> None:
    added = section_properties(rounded).area_m2 - section_properties(sharp).area_m2
    # Six chords to a quarter circle stand 2 to 5 % of the fillet's area outside of it.
    assert 1.0 <= added / (fillets * QUARTER * 0.02**2) < 1.06
    assert section(rounded).contains(section(sharp).buffer(-1e-9))


@pytest.mark.parametrize(
    ("profile", "area_cm2", "strong_cm4", "weak_cm4"),
    [
        # As printed in the manufacturers' tables of European sections (EN 10365).
        (IShape(0.300, 0.300, 0.011, 0.019, 0.027), 149.1, 25170, 8563),
        (IShape(0.150, 0.300, 0.0071, 0.0107, 0.015), 53.81, 8356, 603.8),
        (IShape(0.140, 0.133, 0.0055, 0.0085, 0.012), 31.42, 1033, 389.3),
    ],
    ids=["HE 300 B", "IPE 300", "HE 140 A"],
)
def test_section_properties_are_those_of_the_tables(
    profile: Profile, area_cm2: float, strong_cm4: float, weak_cm4: float
) -> None:
    s = section_properties(profile)
    got = (1e4 * s.area_m2, 1e8 * s.ixx_m4, 1e8 * s.iyy_m4)
    assert got == pytest.approx((area_cm2, strong_cm4, weak_cm4), rel=2e-3)


def test_properties_of_a_triangle_by_hand() -> None:
    s = section_properties(Polygon([[10, 20], [13, 20], [10, 26]]))  # base 3, height 6
    assert s.centroid_m == pytest.approx((11, 22), rel=1e-14)
    assert (s.ixx_m4, s.iyy_m4, s.ixy_m4) == pytest.approx(
        (3 * 6**3 / 36, 6 * 3**3 / 36, -(3**2) * 6**2 / 72), rel=1e-12
    )


def test_thin_ring_keeps_its_digits() -> None:
    s = section_properties(CircleHollow(10.0, 1e-5))
    mean = 10.0 - 0.5e-5
    assert s.area_m2 == pytest.approx(2 * math.pi * mean * 1e-5, rel=1e-9)
    assert s.ixx_m4 == s.iyy_m4 == pytest.approx(math.pi * mean**3 * 1e-5, rel=1e-9)


@ALL
def test_mesh_is_closed_and_spans_the_length(profile: Profile) -> None:
    mesh = extruded_mesh(profile, 0.25)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    outline = profile.outline()
    np.testing.assert_allclose(mesh.bounds, [[*outline.min(axis=0), 0], [*outline.max(axis=0), 0.25]], atol=1e-12)


@pytest.mark.parametrize(
    ("cls", "values", "named"),
    [
        (Rectangle, (0.1, 0.0), "y_dim"),
        (Rectangle, (-0.1, 0.3), "x_dim"),
        (Rectangle, (math.nan, 0.3), "x_dim"),
        (Rectangle, (math.inf, 0.3), "x_dim"),
        (Rectangle, (1e9, 0.3), "x_dim"),
        (Rectangle, (10**400, 0.3), "x_dim"),
        (Rectangle, ("0.1", 0.3), "x_dim"),
        (Rectangle, (True, 0.3), "x_dim"),
        (Rectangle, (None, 0.3), "x_dim"),
        (RectangleHollow, (0.1, 0.3, 0.05), "wall_thickness"),
        (Circle, (0.0,), "radius"),
        (CircleHollow, (0.1, 0.1), "wall_thickness"),
        (IShape, (0.2, 0.3, 0.2, 0.02), "web_thickness"),
        (IShape, (0.2, 0.3, 0.01, 0.15), "flange_thickness"),
        (IShape, (0.2, 0.3, 0.01, 0.02, 0.095), "fillet_radius"),
        (IShape, (0.2, 0.3, 0.01, 0.02, -0.01), "fillet_radius"),
        (LShape, (0.3, 0.2, 0.2), "thickness"),
        (LShape, (0.3, 0.2, 0.02, 0.18), "fillet_radius"),
        (UShape, (0.3, 0.2, 0.2, 0.02), "web_thickness"),
        (UShape, (0.3, 0.2, 0.01, 0.15), "flange_thickness"),
        (UShape, (0.3, 0.2, 0.01, 0.02, 0.13), "fillet_radius"),
        (TShape, (0.3, 0.2, 0.2, 0.02), "web_thickness"),
        (TShape, (0.3, 0.2, 0.01, 0.3), "flange_thickness"),
        (TShape, (0.3, 0.2, 0.01, 0.02, 0.095), "fillet_radius"),
        (Rectangle, (0.1, 1e-6), "y_dim"),
        (Polygon, (3,), "outline"),
        (Polygon, ("abc",), "outline"),
        (Polygon, ({"a": 1},), "outline"),
        (Polygon, ([],), "outline"),
        (Polygon, ([[0, 0], [1, 0]],), "outline"),
        (Polygon, ([[0, 0], [1, 0], [0, 0], [1, 0]],), "outline"),
        (Polygon, ([[0, 0], [1, 0], [2, 0]],), "outline"),
        (Polygon, ([[0, 0], [1, 1], [0, 1], [1, 0]],), "outline"),
        (Polygon, ([[0, 0], [1, 0], [0, 1, 2]],), "outline[2]"),
        (Polygon, ([[0, 0], ["1", 0], [0, 1]],), "outline[1]"),
        (Polygon, ([[0, 0], [True, 0], [0, 1]],), "outline[1]"),
        (Polygon, ([[0, 0], [math.nan, 0], [0, 1]],), "outline[1]"),
        (Polygon, ([[0, 0], [1e9, 0], [0, 1]],), "outline[1]"),
        (Polygon, ([[0, 0], [10**400, 0], [0, 1]],), "outline[1]"),
        (Polygon, ([[0.001 * i, (0.001 * i) ** 2] for i in range(1001)],), "outline"),
    ],
)
def test_impossible_dimensions_are_refused_by_name(cls: type[Profile], values: tuple, named: str) -> None:
    with pytest.raises(ElementError) as caught:
        cls(*values)
    assert caught.value.subject == named and caught.value.expected
    assert len(str(caught.value)) < 300


def test_polygon_takes_either_sense_and_a_repeated_corner() -> None:
    corners = [[0, 0], [1, 0], [1, 1], [0, 2]]
    wanted = Polygon(corners)
    assert wanted.corners == ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 2.0))
    assert Polygon([*corners, corners[0]]) == wanted
    assert Polygon([corners[0], corners[0], *corners[1:]]) == wanted
    assert Polygon(np.array(corners)) == wanted
    assert {tuple(c) for c in Polygon(corners[::-1]).outline()} == set(wanted.corners)
    assert shapely.LinearRing(Polygon(corners[::-1]).outline()).is_ccw


def test_profiles_are_values() -> None:
    assert Rectangle(1, 2) == Rectangle(1.0, 2.0) and hash(Rectangle(1, 2)) == hash(Rectangle(1.0, 2.0))
    assert Circle(0.15).radius_m == CircleHollow(0.15, 0.01).radius_m == 0.15
    assert Rectangle(1, 2).radius_m is None
    with pytest.raises(AttributeError):
        Rectangle(1, 2).x_dim = 3  # type: ignore[misc]


@given(
    depth=st.floats(0.05, 2),
    width=st.floats(0.05, 2),
    web=st.floats(0.02, 0.9),
    flange=st.floats(0.02, 0.45),
    fillet=st.floats(0, 0.9),
)
def test_sections_of_any_proportion_are_sound(
    depth: float, width: float, web: float, flange: float, fillet: float
) -> None:
    w, f, fillet = web * width, flange * depth, max(fillet, 0.01) if fillet else 0.0
    room = min((width - w) / 2, depth / 2 - f)
    for profile in (IShape(width, depth, w, f, fillet * room), UShape(depth, width, w, f, fillet * room)):
        shape, s = section(profile), section_properties(profile)
        assert shape.is_valid and s.area_m2 == pytest.approx(shape.area, rel=1e-9)
        assert s.centroid_m == pytest.approx((shape.centroid.x, shape.centroid.y), abs=1e-9)
        assert s.ixx_m4 > 0 and s.iyy_m4 > 0 and s.ixy_m4 == pytest.approx(0, abs=1e-9)
