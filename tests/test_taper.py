"""Tapered elements: faces, residuals, bodies and fits, against geometry written out here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import linear_ik
from linear_ik.chain import BASE, Chain
from linear_ik.correspondence import Matcher
from linear_ik.element import Element
from linear_ik.element_file import element_from_mapping, element_to_mapping
from linear_ik.errors import ElementError
from linear_ik.exports.glb import write_glb
from linear_ik.profile import Circle, CircleHollow, IShape, LShape, Polygon, Rectangle, RectangleHollow
from linear_ik.scene import element_mesh
from linear_ik.section import body_inertia, extruded_mesh
from linear_ik.simulate import simulate
from linear_ik.tapered_surface import TaperedSurface, surface_of
from linear_ik.terms.point_residual import point_residual
from linear_ik.urdf import generate_urdf, write_urdf
from linear_ik.virtual_scanner import scan_virtually

POLE = Element("pole", Circle(0.09), 4.0, 10, profile_end=Circle(0.04))
HAUNCHED = Element("haunched", IShape(0.2, 0.5, 0.012, 0.02), 4.0, 10, profile_end=IShape(0.2, 0.25, 0.012, 0.02))
OCTAGON = [(0.12 * np.cos(a), 0.12 * np.sin(a)) for a in np.arange(8) * np.pi / 4]
TAPERS = {
    "circle": (Circle(0.09), Circle(0.04)),
    "pipe": (CircleHollow(0.09, 0.006), CircleHollow(0.05, 0.004)),
    "rectangle": (Rectangle(0.3, 0.2), Rectangle(0.1, 0.2)),
    "box": (RectangleHollow(0.3, 0.2, 0.01), RectangleHollow(0.1, 0.15, 0.005)),
    "i_shape": (HAUNCHED.profile, HAUNCHED.profile_end),
    "i_shape_fillet": (IShape(0.2, 0.5, 0.012, 0.02, 0.02), IShape(0.2, 0.25, 0.01, 0.02, 0.01)),
    "l_shape": (LShape(0.2, 0.15, 0.02), LShape(0.1, 0.1, 0.01)),
    "octagon": (Polygon(OCTAGON), Polygon(0.4 * np.array(OCTAGON))),
}
EACH = pytest.mark.parametrize("taper", TAPERS.values(), ids=TAPERS.keys())


def tapered(taper, segments: int = 4, **more) -> Element:
    return Element("tapered", taper[0], 1.0, segments, profile_end=taper[1], **more)


# the element and its file -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "end", "says"),
    [
        (Circle(0.1), Rectangle(0.1, 0.1), "circle, the type of profile"),
        (IShape(0.2, 0.3, 0.01, 0.02, 0.01), IShape(0.2, 0.2, 0.01, 0.02), "as many as profile has"),
        (Polygon(OCTAGON), Polygon(OCTAGON[:-1]), "8, as many"),
        (Polygon(OCTAGON), Polygon(OCTAGON[1:] + OCTAGON[:1]), "turned by 45.0 degrees"),
        (Circle(0.1), 0.05, "type of profile"),
    ],
)
def test_what_cannot_taper_is_refused(profile, end, says):
    with pytest.raises(ElementError, match=says) as refused:
        Element("e", profile, 1.0, profile_end=end)
    assert refused.value.subject == "profile_end"


def test_the_element_file_knows_the_end():
    keys = {
        "name": "pole",
        "length": 4.0,
        "profile": {"type": "circle", "radius": 0.09},
        "profile_end": {"type": "circle", "radius": 0.04},
    }
    assert element_from_mapping(keys) == POLE
    assert element_from_mapping(element_to_mapping(HAUNCHED)) == HAUNCHED
    assert "profile_end" not in element_to_mapping(Element("e", Circle(0.1), 1.0))
    with pytest.raises(ElementError) as refused:
        element_from_mapping({**keys, "profile_end": {"type": "circle", "radius": -1}})
    assert refused.value.subject == "profile_end.radius"


def test_an_end_like_the_start_is_no_taper():
    same = replace(POLE, profile_end=Circle(0.09))
    assert not same.is_tapered
    assert not isinstance(surface_of(same), TaperedSurface)
    assert generate_urdf(same) == generate_urdf(replace(POLE, profile_end=None))


# geometry ---------------------------------------------------------------------------------


def frustum_distance_m(taper, points: np.ndarray) -> np.ndarray:
    """[P] distance to the lateral faces of the taper over a length of 1 m, by triangles."""
    start, end = taper[0].outline(), taper[1].outline()
    n = len(start)
    vertices = np.column_stack([np.concatenate([start, end]), np.repeat([0.0, 1.0], n)])
    a, b = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return trimesh.proximity.closest_point_naive(mesh, points)[1]


@EACH
def test_residuals_are_distances_to_the_leaning_faces(taper):
    element = tapered(taper)
    chain = Chain.of(element)
    pairs = Matcher(surface_of(element), chain.segment_length_m).match(chain.pose(np.zeros(chain.nv)), around(taper))
    points = around(taper)[pairs.order]
    expected = frustum_distance_m(taper, points)
    if taper[0].radius_m is None:
        np.testing.assert_allclose(np.abs(pairs.residual_m), expected, rtol=0, atol=2e-6)
    else:
        slope = taper[1].radius_m - taper[0].radius_m
        radius = taper[0].radius_m + slope * points[:, 2]
        exact = (np.hypot(*points[:, :2].T) - radius) / np.hypot(1.0, slope)
        np.testing.assert_allclose(pairs.residual_m, exact, rtol=0, atol=1e-12)
    lengths = np.hypot(np.linalg.norm(pairs.gradient, axis=1), pairs.axial)
    np.testing.assert_allclose(lengths, 1.0, rtol=0, atol=1e-12)


def around(taper, count: int = 400) -> np.ndarray:
    """Points about the middle of the taper, no farther than 30 mm from its box."""
    rng = np.random.default_rng(3)
    outline = np.concatenate([taper[0].outline(), taper[1].outline()])
    low, high = outline.min(axis=0) - 0.03, outline.max(axis=0) + 0.03
    return np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(0.2, 0.8, count)])


@EACH
def test_the_gradient_is_the_derivative_of_the_residual(taper):
    surface = surface_of(tapered(taper))
    points = around(taper)
    begin = np.full(len(points), 0.0)
    face = np.random.default_rng(0).integers(len(surface.corners), size=len(points))
    feet, step = surface.residuals(points, face, begin), 1e-6
    gradient = np.column_stack([feet.gradient, feet.axial])
    for i in range(3):
        ends = [surface.residuals(points + s * step * np.eye(3)[i], face, begin).residual_m for s in (-1, 1)]
        numeric = (ends[1] - ends[0]) / (2 * step)
        close = np.abs(gradient[:, i] - numeric) < 1e-6
        # A few points lie within a step of where the face ends and its edge begins.
        assert close.mean() > 0.98


@EACH
def test_the_points_term_is_the_derivative_of_its_cost(taper):
    """H and c against central differences of 1/2 sum w r^2, the base and all joints moving."""
    element = tapered(taper, start="free")
    chain, surface = Chain.of(element), surface_of(element)
    points = simulate(element, bends=["2:y:4", "3:x:-3"], points=300, noise_m=0.002).points
    x = np.concatenate([np.random.default_rng(1).uniform(-0.01, 0.01, BASE), np.zeros(12)])
    pose = chain.pose(x)
    pairs = Matcher(surface, chain.segment_length_m).match(pose, points)
    weights, begin = np.random.default_rng(2).uniform(0, 4, len(points)), 0.25 * pairs.segment
    term = point_residual(pose, pairs, weights)

    def residuals(x: np.ndarray) -> np.ndarray:
        moved, k = chain.pose(x), pairs.segment
        local = np.einsum("pij,pi->pj", moved.rotations[k], points[pairs.order] - moved.nodes_m[k])
        return np.sqrt(weights) * surface.residuals(local, pairs.face, begin).residual_m

    step, D = 1e-6, np.empty((len(points), chain.nv))
    for i in range(chain.nv):
        dx = step * (np.arange(chain.nv) == i)
        D[:, i] = (residuals(x + dx) - residuals(x - dx)) / (2 * step)
    np.testing.assert_allclose(term.c, D.T @ residuals(x), rtol=0, atol=1e-5 * np.abs(term.c).max())
    np.testing.assert_allclose(term.H, D.T @ D, rtol=0, atol=1e-5 * np.abs(term.H).max())


@EACH
def test_simulated_points_lie_on_the_faces_and_their_normals_point_out(taper):
    element = tapered(taper)
    scan = simulate(element, points=600, noise_m=0.0)
    if taper[0].radius_m is None:
        np.testing.assert_allclose(frustum_distance_m(taper, scan.points), 0.0, atol=1e-10)
    else:
        radius = np.interp(scan.points[:, 2], [0, 1], [taper[0].radius_m, taper[1].radius_m])
        np.testing.assert_allclose(np.hypot(*scan.points[:, :2].T), radius, rtol=0, atol=1e-12)
    surface = surface_of(element)
    chain = Chain.of(element)
    pairs = Matcher(surface, chain.segment_length_m).match(
        chain.pose(np.zeros(chain.nv)), scan.points + 1e-4 * scan.surface_normals
    )
    assert np.mean(np.abs(pairs.residual_m - 1e-4) < 1e-9) > 0.99


def test_points_are_as_dense_everywhere():
    scan = simulate(tapered(TAPERS["circle"], 2), points=200_000, noise_m=0.0)
    count, _ = np.histogram(scan.points[:, 2], np.linspace(0, 1, 11))
    radius = 0.09 - 0.05 * (np.arange(10) + 0.5) / 10
    np.testing.assert_allclose(count / count.sum(), radius / radius.sum(), rtol=0.03)


@EACH
def test_the_body_is_closed_and_its_inertia_that_of_its_mesh(taper):
    mesh = extruded_mesh(taper[0], 1.0, taper[1])
    assert mesh.is_watertight and mesh.is_winding_consistent
    body = body_inertia(taper[0], 1.0, 7850.0, taper[1])
    # Of a circle the mesh has chords: 0.04 % less area.
    loose = 1e-3 if taper[0].radius_m is not None else 1e-9
    mesh.density = 7850.0
    assert body.mass_kg == pytest.approx(mesh.mass, rel=loose)
    np.testing.assert_allclose(body.centre_m, mesh.center_mass, rtol=loose, atol=1e-9)
    ours = [[body.ixx, body.ixy, body.ixz], [body.ixy, body.iyy, body.iyz], [body.ixz, body.iyz, body.izz]]
    np.testing.assert_allclose(ours, mesh.moment_inertia, rtol=2 * loose, atol=1e-9 * body.ixx)


def test_urdf_has_a_mesh_a_segment_and_the_same_kinematics(tmp_path):
    paths = write_urdf(POLE, tmp_path / "pole.urdf")
    assert len(paths) == 11 and len(set(paths)) == 11
    assert {p.name for p in paths[1:]} == {p.name for p in (tmp_path / "pole_meshes").iterdir()}
    last = trimesh.load(paths[-1])
    assert np.hypot(*last.vertices[:, :2].T).max() == pytest.approx(0.045, abs=1e-6)
    plain, chain = Chain.of(replace(POLE, profile_end=None)), Chain.of(POLE)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, 30)
    np.testing.assert_array_equal(chain.nodes(q), plain.nodes(q))


def test_glb_and_scene_have_the_true_bodies(tmp_path):
    q = np.zeros(30)
    path = write_glb(POLE, q, np.eye(4), tmp_path / "pole.glb")
    scene = trimesh.load(path)
    assert len(scene.geometry) == 10
    volume = np.pi * 4.0 / 3 * (0.09**2 + 0.09 * 0.04 + 0.04**2)
    assert sum(g.volume for g in scene.geometry.values()) == pytest.approx(volume, rel=1e-3)
    mesh = element_mesh(POLE, ["5:y:3"])
    body = trimesh.Trimesh(mesh.vertices, mesh.triangles)
    assert body.volume == pytest.approx(volume, rel=2e-3)


# fits -------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", [POLE, HAUNCHED], ids=["pole", "haunched"])
@pytest.mark.parametrize("missing", [[], ["+x"]], ids=["whole", "a side missing"])
def test_the_truth_is_recovered(element, missing):
    scan = simulate(element, bends=["3:y:6", "7:x:-9"], missing=missing, seed=4)
    result = linear_ik.fit(element, scan.without_truth())
    assert result.status == "converged", result.reasons
    error = np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)
    assert error.max() < 0.001
    assert result.surface_rmse_m == pytest.approx(0.001, abs=1e-4)
    assert all(s.status == "measured" for s in result.segments)


def test_a_pole_that_a_scanner_saw_is_recovered():
    scan = scan_virtually(POLE, stations=[(3.0, -3.0, 1.5), (-4.0, 2.0, 1.0)], bends=["4:y:7", "8:x:5"])
    result = linear_ik.fit(POLE, scan.without_truth())
    assert result.status == "converged", result.reasons
    assert np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1).max() < 0.001


@pytest.mark.parametrize("element", [POLE, HAUNCHED], ids=["pole", "haunched"])
def test_a_taper_shows_the_slide_along_the_axis(element):
    """A free start moved along: found to some millimetres, within its own deviation."""
    free = replace(element, start="free")
    straight = replace(free, profile_end=None)
    motion = np.eye(4)
    motion[:3, 3] = 0.01, -0.008, 0.03
    deviations = []
    for seed in range(10):
        scan = simulate(free, displacement=motion, seed=seed)
        result = linear_ik.fit(free, scan.without_truth())
        sd_m = np.sqrt(result.nodes_covariance_m2[:, 2, 2])
        # Slope 0.0125 a metre and 10,000 points of 1 mm: 0.8 mm; half the I's faces lean 0.03.
        assert 0.0002 < sd_m[0] < 0.002
        deviations.append((result.nodes_m - scan.nodes_m)[0, 2] / sd_m[0])
    assert np.sqrt(np.mean(np.square(deviations))) < 2.0
    # Without the taper only the two ends of the cloud tell, and not as well.
    prism = linear_ik.fit(straight, simulate(straight).without_truth(), linear_ik.FitSettings(search="never"))
    assert np.sqrt(prism.nodes_covariance_m2[0, 2, 2]) > 2 * sd_m[0]


def test_icpik_takes_a_taper_too():
    scan = simulate(POLE, bends=["5:y:5"], points=4000)
    result = linear_ik.fit(POLE, scan.without_truth(), linear_ik.FitSettings(method="icpik"))
    assert np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1).max() < 0.05


def test_a_pole_of_another_radius_is_said_to_be():
    scan = simulate(replace(POLE, profile=Circle(0.0918), profile_end=Circle(0.0408)))
    result = linear_ik.fit(POLE, scan.without_truth())
    assert any("radius in the middle measures 66.3 mm where 65.0 mm" in reason for reason in result.reasons)


def test_the_viewer_shows_true_bodies():
    from linear_ik.viewer import Viewer

    scan = simulate(POLE, points=2000)
    viewer = Viewer()
    viewer.show_result(linear_ik.fit(POLE, scan.without_truth()), scan)
    assert "pole" in viewer.scene.captions[0][1]
