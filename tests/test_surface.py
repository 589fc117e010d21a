"""Surface: distances, gradients and meshes of every section, against GEOS."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import SAMPLES

from linear_ik.profile import Circle, CircleHollow, Polygon, Profile, Rectangle, RectangleHollow
from linear_ik.surface import Surface

SHARP: dict[str, Profile] = {
    "spike": Polygon([[0, 0], [0.3, 0.02], [0.05, 0.05], [0.04, 0.3]]),
    "slit": Polygon([[0, 0], [0.3, 0], [0.3, 0.3], [0.155, 0.3], [0.15, 0.05], [0.145, 0.3], [0, 0.3]]),
}
EVERY = SAMPLES | SHARP
EDGED = {name: p for name, p in EVERY.items() if p.radius_m is None}
ROUND = {name: p for name, p in EVERY.items() if p.radius_m is not None}


def each(profiles: dict[str, Profile]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("profile", profiles.values(), ids=profiles.keys())


def points_around(surface: Surface, count: int, seed: int = 0) -> np.ndarray:
    """Points in and around the section, a share of them within 2 mm of a corner."""
    rng = np.random.default_rng(seed)
    wide = rng.uniform(surface.corners.min(axis=0) - 0.1, surface.corners.max(axis=0) + 0.1, (count, 2))
    near = rng.choice(surface.corners, count) + rng.normal(0, 0.002, (count, 2))
    return np.concatenate([wide, near])


def edge_distances(surface: Surface, xy: np.ndarray) -> np.ndarray:
    """Distance [P][E] of each point to each edge, by GEOS."""
    edges = shapely.linestrings(np.stack([surface.corners, np.roll(surface.corners, -1, axis=0)], axis=1))
    return shapely.distance(edges[None], shapely.points(xy)[:, None])


# edged sections -----------------------------------------------------------------------


@each(EDGED)
def test_normals_point_out_of_the_section(profile: Profile) -> None:
    surface, section = Surface.of(profile), shapely.Polygon(profile.outline())
    middle = surface.corners + surface.widths_m[:, None] / 2 * surface.tangents
    assert not shapely.contains(section, shapely.points(middle + 1e-6 * surface.normals)).any()
    assert shapely.contains(section, shapely.points(middle - 1e-6 * surface.normals)).all()
    assert surface.perimeter_m == pytest.approx(section.exterior.length, rel=1e-12)
    assert np.allclose(np.linalg.norm(surface.normals, axis=1), 1, rtol=0, atol=1e-15)


@each(EDGED)
def test_offsets_are_signed_distances_to_the_section(profile: Profile) -> None:
    surface, section = Surface.of(profile), shapely.Polygon(profile.outline())
    xy = points_around(surface, 3000)
    edge = edge_distances(surface, xy).argmin(axis=1)
    distance, gradient = surface.offsets(xy, edge)
    inside = shapely.contains(section, shapely.points(xy))
    brute = shapely.distance(section.exterior, shapely.points(xy)) * np.where(inside, -1, 1)
    np.testing.assert_allclose(distance, brute, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1, rtol=0, atol=1e-14)
    # The foot of the perpendicular lies on the outline.
    foot = xy - distance[:, None] * gradient
    assert shapely.distance(section.exterior, shapely.points(foot)).max() < 1e-14


@each(EDGED)
def test_gradients_are_those_of_the_distance(profile: Profile) -> None:
    surface = Surface.of(profile)
    xy = points_around(surface, 1000, seed=1)
    far = edge_distances(surface, xy)
    edge = far.argmin(axis=1)
    # At the surface the distance to a corner has a kink; on a bisector the nearest edge changes.
    xy, edge = xy[far.min(axis=1) > 1e-4], edge[far.min(axis=1) > 1e-4]
    _, gradient = surface.offsets(xy, edge)
    h = 1e-7
    for axis in np.eye(2):
        change = surface.offsets(xy + h * axis, edge)[0] - surface.offsets(xy - h * axis, edge)[0]
        np.testing.assert_allclose(gradient @ axis, change / (2 * h), rtol=0, atol=1e-5)


@each(EDGED)
def test_over_a_held_face_the_offset_is_to_that_face_not_the_nearest(profile: Profile) -> None:
    surface = Surface.of(profile)
    xy = points_around(surface, 300, seed=2)
    edge = np.random.default_rng(3).integers(len(surface.corners), size=len(xy))
    distance, gradient = surface.offsets(xy, edge)
    np.testing.assert_allclose(np.abs(distance), edge_distances(surface, xy)[np.arange(len(xy)), edge], atol=1e-14)
    over = np.abs(np.einsum("ij,ij->i", gradient, surface.normals[edge]) - 1) < 1e-12
    plane = np.einsum("ij,ij->i", surface.normals[edge], xy - surface.corners[edge])
    np.testing.assert_allclose(distance[over], plane[over], rtol=0, atol=1e-14)


def test_beyond_a_corner_the_gradient_is_the_offset_from_it() -> None:
    surface = Surface.of(Rectangle(0.1, 0.3))
    xy = np.array([[0.05 + 0.003, 0.15 + 0.004], [0.05, 0.15 + 0.004], [0.05 + 0.003, 0.15], [0.02, 0.15 - 0.001]])
    distance, gradient = surface.offsets(xy, np.array([1, 2, 1, 2]))
    np.testing.assert_allclose(distance, [0.005, 0.004, 0.003, -0.001], rtol=0, atol=1e-15)
    np.testing.assert_allclose(gradient, [[0.6, 0.8], [0, 1], [1, 0], [0, 1]], rtol=0, atol=1e-12)


@each(EDGED)
@settings(max_examples=30, deadline=None)
@given(x=st.floats(-2, 2), y=st.floats(-2, 2))
def test_distances_anywhere(profile: Profile, x: float, y: float) -> None:
    surface = Surface.of(profile)
    brute = shapely.distance(shapely.LinearRing(surface.corners), shapely.Point(x, y))
    assert surface.distances(np.array([[x, y]]))[0] == pytest.approx(brute, rel=1e-12, abs=1e-15)


# round sections -----------------------------------------------------------------------


@each(ROUND)
def test_round_sections_are_circles_and_not_their_chords(profile: Profile) -> None:
    surface, radius = Surface.of(profile), profile.radius_m
    rng = np.random.default_rng(4)
    angle, rho = rng.uniform(-np.pi, np.pi, 2000), rng.uniform(0.5, 1.5, 2000) * radius
    outward = np.column_stack([np.cos(angle), np.sin(angle)])
    any_edge = rng.integers(len(surface.corners), size=2000)
    distance, gradient = surface.offsets(rho[:, None] * outward, any_edge)
    np.testing.assert_allclose(distance, rho - radius, rtol=0, atol=1e-15)
    np.testing.assert_allclose(gradient, outward, rtol=0, atol=1e-15)
    np.testing.assert_allclose(surface.distances(rho[:, None] * outward), np.abs(rho - radius), rtol=0, atol=1e-15)
    assert surface.perimeter_m == pytest.approx(2 * np.pi * radius, rel=1e-15)


def test_a_point_on_the_axis_of_a_pipe_has_a_finite_gradient() -> None:
    surface = Surface.of(Circle(0.1))
    distance, gradient = surface.offsets(np.zeros((1, 2)), np.zeros(1, dtype=np.intp))
    assert distance[0] == -0.1 and np.isfinite(gradient).all()


# along the outline ----------------------------------------------------------------------


@each(EVERY)
def test_lengths_along_the_outline_lead_to_points_on_it_and_back(profile: Profile) -> None:
    surface = Surface.of(profile)
    s = np.random.default_rng(6).uniform(0, surface.perimeter_m, 1000)
    xy = surface.at(s)
    assert surface.distances(xy).max() < 1e-14
    edge = edge_distances(surface, xy).argmin(axis=1)
    # Points of a circle are counted by chords.
    allowed = 1e-13 if profile.radius_m is None else 1e-4 * profile.radius_m
    np.testing.assert_allclose(surface.length_along(xy, edge), s, rtol=0, atol=allowed)
    np.testing.assert_allclose(surface.at(np.zeros(1))[0], surface.corners[0], rtol=0, atol=1e-15)


@each(EDGED)
def test_lengths_are_those_of_geos(profile: Profile) -> None:
    surface = Surface.of(profile)
    xy = points_around(surface, 500, seed=7)
    edge = edge_distances(surface, xy).argmin(axis=1)
    closed = shapely.LineString([*surface.corners, surface.corners[0]])
    theirs = shapely.line_locate_point(closed, shapely.points(xy))
    around = np.abs(surface.length_along(xy, edge) - theirs)
    np.testing.assert_allclose(np.minimum(around, surface.perimeter_m - around), 0, rtol=0, atol=1e-12)


def test_a_point_beyond_a_corner_is_at_the_corner() -> None:
    surface = Surface.of(Rectangle(0.1, 0.3))
    assert surface.length_along(np.array([[0.2, -0.4]]), np.array([0])).tolist() == pytest.approx([0.1])
    assert surface.length_along(np.array([[-0.2, -0.4]]), np.array([0])).tolist() == [0.0]


# what others make of it -----------------------------------------------------------------


@each(EVERY)
def test_the_mesh_is_the_open_tube_of_the_faces(profile: Profile) -> None:
    surface = Surface.of(profile)
    vertices, triangles = surface.mesh(0.7)
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    outward = cross / (2 * area[:, None])
    face = np.arange(len(triangles)) // 2
    np.testing.assert_allclose(outward[:, :2], surface.normals[face], rtol=0, atol=1e-9)
    np.testing.assert_allclose(area.reshape(-1, 2).sum(axis=1), 0.7 * surface.widths_m, rtol=1e-12)
    assert set(vertices[:, 2]) == {0.0, 0.7}
    assert len(triangles) == 2 * len(surface.corners)


@each(EVERY)
def test_size_and_reach_are_the_outlines(profile: Profile) -> None:
    surface, outline = Surface.of(profile), profile.outline()
    assert surface.size_m.tolist() == [outline[:, 0].max() - outline[:, 0].min(), np.ptp(outline[:, 1])]
    assert surface.reach_m == pytest.approx(max(np.hypot(x, y) for x, y in outline), rel=1e-15)


@each(EDGED)
def test_a_stretched_section_has_stretched_corners_and_proper_normals(profile: Profile) -> None:
    surface = Surface.of(profile).scaled(np.array([1.02, 0.97]))
    np.testing.assert_allclose(surface.corners, profile.outline() * [1.02, 0.97], rtol=1e-15)
    np.testing.assert_allclose(np.einsum("ij,ij->i", surface.normals, surface.tangents), 0, atol=1e-15)
    fresh = Surface.of_outline(surface.corners, None)
    np.testing.assert_array_equal(surface.normals, fresh.normals)


def test_a_stretched_pipe_has_a_stretched_radius() -> None:
    surface = Surface.of(CircleHollow(0.1, 0.01)).scaled(np.array([1.05, 1.05]))
    assert surface.radius_m == pytest.approx(0.105)
    assert surface.perimeter_m == pytest.approx(2 * np.pi * 0.105)


def test_a_scanner_sees_the_outside_of_a_hollow_section() -> None:
    hollow, solid = Surface.of(RectangleHollow(0.1, 0.3, 0.01)), Surface.of(Rectangle(0.1, 0.3))
    np.testing.assert_array_equal(hollow.corners, solid.corners)
