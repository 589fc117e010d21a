"""The URDF: what it says, and that Pinocchio and yourdfpy read the same from it."""

from __future__ import annotations

import logging
import math
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET
from io import BytesIO
from pathlib import Path

import jinja2
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import SAMPLES

from linear_ik import urdf as urdf_module
from linear_ik.element import Element, Placement
from linear_ik.errors import OutputError
from linear_ik.profile import Circle, CircleHollow, LShape, Polygon, Rectangle
from linear_ik.section import body_inertia, extruded_mesh
from linear_ik.urdf import file_stem, generate_urdf, joint_names, segment_names, template_folder, write_urdf

ALL = pytest.mark.parametrize("profile", SAMPLES.values(), ids=SAMPLES.keys())


def element(segments: int = 3, profile: object = None, **changes: object) -> Element:
    fields = {"name": "beam", "profile": profile or Rectangle(0.1, 0.3), "length_m": 2.5, "segments": segments}
    return Element(**{**fields, **changes})  # type: ignore[arg-type]


def rotation(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def by_hand(q: np.ndarray, segment_length_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes [N+1][3] and orientations [N][3][3] straight from the contract: R = Rz Ry Rx, direction local Z."""
    R, nodes, orientations = np.eye(3), [np.zeros(3)], []
    for z, y, x in q.reshape(-1, 3):
        R = R @ rotation("z", z) @ rotation("y", y) @ rotation("x", x)
        orientations.append(R)
        nodes.append(nodes[-1] + segment_length_m * R[:, 2])
    return np.array(nodes), np.array(orientations)


# what it says ------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 2, 9, 10, 99, 100, 101, 500])
def test_names_count_up_in_sorted_order(segments: int) -> None:
    text = generate_urdf(element(segments))
    robot = ET.fromstring(text)
    links = [link.get("name") for link in robot.iter("link")]
    solid = [link.get("name") for link in robot.iter("link") if link.find("inertial") is not None]
    joints = [joint.get("name") for joint in robot.iter("joint") if joint.get("type") == "revolute"]
    width = 3 if segments >= 100 else 2
    assert solid == sorted(solid) == [f"segment_{k:0{width}d}" for k in range(1, segments + 1)]
    assert joints == [f"{name}_{axis}" for name in solid for axis in "zyx"]
    assert links[0] == "base" and links[-1] == "end" and len(links) == len(set(links)) == 3 * segments + 2
    assert segment_names(segments) == solid and joint_names(segments) == joints
    assert list(pin.buildModelFromXML(text).names)[1:] == joints


@given(limits=st.tuples(*[st.floats(1e-9, 180)] * 3), length=st.floats(0.01, 1e5), segments=st.integers(1, 7))
def test_limits_and_lengths_are_exact_to_the_last_bit(limits: tuple, length: float, segments: int) -> None:
    e = element(segments, joint_limit_deg=limits, length_m=length)
    model = pin.buildModelFromXML(generate_urdf(e))
    wanted = np.tile(np.radians(limits)[::-1], segments)
    assert model.upperPositionLimit.tolist() == wanted.tolist()
    assert model.lowerPositionLimit.tolist() == (-wanted).tolist()
    offsets = [model.jointPlacements[1 + 3 * k].translation.tolist() for k in range(1, segments)]
    assert offsets == [[0.0, 0.0, e.segment_length_m]] * (segments - 1)
    assert model.frames[model.getFrameId("end")].placement.translation.tolist() == [0.0, 0.0, e.segment_length_m]
    for k in range(segments):
        for j in (2, 3):
            assert not model.jointPlacements[3 * k + j].translation.any()


def test_effort_and_velocity_bounds_are_finite_and_positive() -> None:
    model = pin.buildModelFromXML(generate_urdf(element()))
    for bound in (model.effortLimit, model.velocityLimit):
        assert np.isfinite(bound).all() and (bound > 0).all()


def test_the_placement_stays_outside() -> None:
    moved = element(placement=Placement((10, 20, 30), (1, 1, 0)))
    assert generate_urdf(moved) == generate_urdf(element())


name_text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=60).filter(
    lambda s: s.strip() and all(c >= " " for c in s)
)


@given(name=name_text)
def test_any_name_gives_well_formed_xml(name: str) -> None:
    text = generate_urdf(element(1, name=name))
    read = ET.fromstring(text.encode("utf-8")).get("name")
    assert read is not None and len(read) == len(name)
    assert all(a == b or b == "\ufffd" for a, b in zip(name, read, strict=True))
    assert pin.buildModelFromXML(text).nq == 3


def test_markup_in_a_name_is_text() -> None:
    name = """a & b <c> "d" 'e' {{ f }} ü 梁"""
    text = generate_urdf(element(1, name=name))
    assert ET.fromstring(text).get("name") == name == pin.buildModelFromXML(text).name


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("beam", "beam"),
        ("Beam 7", "Beam_7"),
        ("../../etc/passwd", "etc_passwd"),
        ("a/b\\c:d*?", "a_b_c_d"),
        ("...", "element"),
        ("梁", "element"),
        ("x" * 200, "x" * 80),
    ],
)
def test_file_names_are_tame(name: str, stem: str) -> None:
    assert file_stem(name) == stem


def test_a_template_with_an_unknown_variable_fails_loudly() -> None:
    with pytest.raises(jinja2.UndefinedError):
        urdf_module._template().render(name="a")


def test_templates_are_found_in_a_wheel_and_in_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout = template_folder()
    assert checkout.name == "urdf_templates" and (checkout / urdf_module.TEMPLATE).is_file()
    package = tmp_path / "site-packages" / "linear_ik"
    monkeypatch.setattr(urdf_module, "__file__", str(package / "urdf.py"))
    with pytest.raises(OutputError, match="urdf_templates: is missing"):
        template_folder()
    (package / "urdf_templates").mkdir(parents=True)
    (package / "urdf_templates" / urdf_module.TEMPLATE).write_text("")
    assert template_folder() == package / "urdf_templates"


def test_no_heavy_import_for_the_urdf_text() -> None:
    code = (
        "import sys; from linear_ik.element import Element; from linear_ik.profile import *\n"
        "from linear_ik.urdf import generate_urdf\n"
        "for p in (Rectangle(.1, .3), Circle(.1), CircleHollow(.1, .01), IShape(.3, .3, .01, .02, .02),\n"
        "          RectangleHollow(.1, .3, .01), LShape(.1, .1, .01)):\n"
        "    generate_urdf(Element('a', p, 2.5), 'meshes')\n"
        "print([m for m in ('trimesh', 'shapely', 'yourdfpy', 'scipy', 'pinocchio', 'open3d') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


# inertia -----------------------------------------------------------------------------


@ALL
def test_inertia_is_that_of_the_mesh(profile: object) -> None:
    body = body_inertia(profile, 0.4, 7850.0)  # type: ignore[arg-type]
    mesh = extruded_mesh(profile, 0.4)  # type: ignore[arg-type]
    mesh.density = 7850.0
    # 128 chords of a circle hold 0.04 % less than it, and 0.08 % less second moment.
    rel = 1e-3 if isinstance(profile, (Circle, CircleHollow)) else 1e-9
    assert body.mass_kg == pytest.approx(mesh.mass, rel=rel)
    np.testing.assert_allclose(body.centre_m, mesh.center_mass, atol=1e-9)
    tensor = np.array([[body.ixx, body.ixy, 0], [body.ixy, body.iyy, 0], [0, 0, body.izz]])
    np.testing.assert_allclose(tensor, mesh.moment_inertia, rtol=rel, atol=rel * body.izz)


def test_inertia_of_a_cylinder_by_formula() -> None:
    body = body_inertia(Circle(0.2), 1.5, 1000.0)
    mass = 1000.0 * math.pi * 0.04 * 1.5
    assert body.mass_kg == pytest.approx(mass, rel=1e-14)
    assert body.izz == pytest.approx(mass * 0.04 / 2, rel=1e-14)
    assert body.ixx == body.iyy == pytest.approx(mass * (3 * 0.04 + 1.5**2) / 12, rel=1e-14)
    assert body.ixy == 0.0 and body.centre_m == (0.0, 0.0, 0.75)


@ALL
def test_pinocchio_reads_the_inertia(profile: object) -> None:
    e = element(3, profile, density_kg_m3=2400.0)
    model = pin.buildModelFromXML(generate_urdf(e, "meshes"))
    body = body_inertia(e.profile, e.segment_length_m, 2400.0)
    inertias = [model.inertias[i] for i in range(1, model.njoints)]
    assert [i.mass for i in inertias] == [0.0, 0.0, body.mass_kg] * 3
    for inertia in inertias[2::3]:
        np.testing.assert_allclose(inertia.lever, body.centre_m, atol=1e-15)
        wanted = np.array([[body.ixx, body.ixy, 0], [body.ixy, body.iyy, 0], [0, 0, body.izz]])
        np.testing.assert_allclose(inertia.inertia, wanted, rtol=1e-12, atol=1e-12 * body.izz)
        moments = np.linalg.eigvalsh(inertia.inertia)
        assert moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 - 1e-12)


def test_an_angle_has_a_product_of_inertia() -> None:
    # Material at (-X, -Y), (-X, +Y) and (+X, -Y): the sum of x y about the centroid is negative, so ixy is positive.
    assert body_inertia(LShape(0.1, 0.1, 0.01), 1.0, 7850.0).ixy > 0.008


# both readers ------------------------------------------------------------------------


@ALL
def test_loads_without_a_warning(
    profile: object, tmp_path: Path, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    import yourdfpy

    caplog.set_level(logging.INFO)
    e = element(2, profile, name="a & <b> ü")
    path, *meshes = write_urdf(e, tmp_path / "out" / "beam.urdf")
    capfd.readouterr()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model, collision, visual = pin.buildModelsFromUrdf(str(path), package_dirs=[str(path.parent)])
        robot = yourdfpy.URDF.load(str(path))
    assert robot.validate() and not robot.errors
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # yourdfpy's own use of an old trimesh call, whatever it loads.
        warnings.filterwarnings("ignore", category=DeprecationWarning, module="yourdfpy")
        robot = yourdfpy.URDF.load(str(path), load_collision_meshes=True, build_collision_scene_graph=True)
    out = capfd.readouterr()
    assert (out.out, out.err, caplog.records) == ("", "", [])
    assert model.nq == len(robot.actuated_joint_names) == 6
    assert robot.actuated_joint_names == list(model.names)[1:]
    assert collision.ngeoms == visual.ngeoms == 2

    outline, length = e.profile.outline(), e.segment_length_m
    box = np.array([[*outline.min(axis=0), 0], [*outline.max(axis=0), 2 * length]])
    for scene in (robot.scene, robot.collision_scene):
        np.testing.assert_allclose(scene.bounds, box, atol=2e-3 if e.profile.radius_m else 1e-7)
    for geometry in (*collision.geometryObjects, *visual.geometryObjects):
        geometry.geometry.computeLocalAABB()
        local = geometry.geometry.aabb_local
        placed = [geometry.placement.act(np.array(corner)) for corner in (local.min_, local.max_)]
        start = model.frames[model.getFrameId(geometry.name.rsplit("_", 1)[0])].placement.translation
        np.testing.assert_allclose(placed - start, box * [1, 1, 0.5], atol=1e-6)
    assert len(meshes) == (0 if isinstance(profile, (Rectangle, Circle)) else 1)


@ALL
def test_one_mesh_serves_all_segments(profile: object, tmp_path: Path) -> None:
    e = element(12, profile, name="Träger 7")
    path, *meshes = write_urdf(e, tmp_path / "beam.urdf")
    named = {m.get("filename") for m in ET.parse(path).getroot().iter("mesh")}
    assert named == {str(m.relative_to(tmp_path)) for m in meshes}
    assert {p for p in tmp_path.rglob("*") if p.is_file()} == {path, *meshes}
    assert all(m.parent.name == "Tr_ger_7_meshes" for m in meshes)
    assert len(list(ET.parse(path).getroot().iter("collision"))) == 12


def test_elements_of_one_name_in_one_folder_keep_their_meshes(tmp_path: Path) -> None:
    _, first = write_urdf(element(3, CircleHollow(0.1, 0.01)), tmp_path / "a.urdf")
    _, second = write_urdf(element(4, CircleHollow(0.1, 0.01)), tmp_path / "b.urdf")
    _, third = write_urdf(element(4, CircleHollow(0.1, 0.02)), tmp_path / "c.urdf")
    _, again = write_urdf(element(4, CircleHollow(0.1, 0.02)), tmp_path / "d.urdf")
    assert len({first, second, third}) == 3 and again == third


def test_without_a_mesh_folder_no_mesh_is_named() -> None:
    robot = ET.fromstring(generate_urdf(element(2, CircleHollow(0.1, 0.01))))
    assert not list(robot.iter("visual")) and not list(robot.iter("mesh")) and len(list(robot.iter("mass"))) == 2
    robot = ET.fromstring(generate_urdf(element(2, CircleHollow(0.1, 0.01)), "here/"))
    assert all(m.get("filename", "").startswith("here/circle_hollow_") for m in robot.iter("mesh"))


@settings(max_examples=40)
@given(data=st.data(), segments=st.integers(1, 8), length=st.floats(0.1, 20))
def test_forward_kinematics_of_both_are_the_contracts(data: st.DataObject, segments: int, length: float) -> None:
    import yourdfpy

    angles = data.draw(st.lists(st.floats(-math.pi, math.pi), min_size=3 * segments, max_size=3 * segments))
    # trimesh, which yourdfpy keeps its poses in, takes matrices within 1e-8 of the identity for it.
    q = np.where(np.abs(angles) < 1e-6, 0.0, angles)
    e = element(segments, length_m=length, joint_limit_deg=180)
    text = generate_urdf(e)
    model = pin.buildModelFromXML(text)
    state = model.createData()
    pin.framesForwardKinematics(model, state, q)
    robot = yourdfpy.URDF.load(BytesIO(text.encode()), load_meshes=False)
    robot.update_cfg(q)
    nodes, orientations = by_hand(q, e.segment_length_m)
    for k, name in enumerate([*segment_names(segments), "end"]):
        T_pinocchio = state.oMf[model.getFrameId(name)].homogeneous
        np.testing.assert_allclose(T_pinocchio, robot.get_transform(name, "base"), rtol=0, atol=1e-12)
        np.testing.assert_allclose(T_pinocchio[:3, 3], nodes[k], rtol=0, atol=1e-12)
        np.testing.assert_allclose(T_pinocchio[:3, :3], orientations[min(k, segments - 1)], rtol=0, atol=1e-12)


def test_a_far_polygon_is_where_it_was_drawn(tmp_path: Path) -> None:
    import trimesh

    profile = Polygon([[90, 90], [90.2, 90], [90.2, 90.1], [90, 90.1]])
    _, mesh = write_urdf(element(1, profile), tmp_path / "far.urdf")
    np.testing.assert_allclose(trimesh.load_mesh(mesh).bounds, [[90, 90, 0], [90.2, 90.1, 2.5]], atol=1e-5)
