"""Files out: whole or not at all, and saying what the chain says."""

from __future__ import annotations

import json
import os
import stat
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from samples import SAMPLES

from linear_ik.atomic import check_writable, write_atomically, written_whole
from linear_ik.element import Element, Placement
from linear_ik.errors import ChainError, OutputError
from linear_ik.exports.fitted_urdf import write_fitted_urdf
from linear_ik.exports.glb import write_glb
from linear_ik.profile import CircleHollow, IShape, Profile, Rectangle
from linear_ik.section import extruded_mesh
from linear_ik.urdf import generate_urdf, joint_names, segment_names

ALL = pytest.mark.parametrize("profile", SAMPLES.values(), ids=SAMPLES.keys())


def bent(profile: Profile, segments: int, at: tuple = (1.0, 2.0, 3.0)) -> tuple[Element, np.ndarray, np.ndarray]:
    element = Element("a & <b>", profile, 2.5, segments, Placement(at, (1, 2, 0.5), (0, 0, 1)))
    q = np.random.default_rng(segments).uniform(-0.3, 0.3, 3 * segments)
    return element, q, element.placement.T_world_element


def pinocchio_frames(element: Element, q: np.ndarray) -> dict[str, np.ndarray]:
    model = pin.buildModelFromXML(generate_urdf(element))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    names = ["base", *segment_names(element.segments), "end"]
    return {name: data.oMf[model.getFrameId(name)].homogeneous for name in names}


def files(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


# atomic ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "stored"), [(b"\x00\xff\r\n", b"\x00\xff\r\n"), ("ü\n", "ü\n".encode()), ("", b"")]
)
def test_content_is_written_as_it_is(tmp_path: Path, content: bytes | str, stored: bytes) -> None:
    path = tmp_path / "new" / "folders" / "a.bin"
    assert write_atomically(path, b"older and longer content") == path
    assert write_atomically(str(path), content) == path
    assert path.read_bytes() == stored and files(tmp_path) == {"new/folders/a.bin"}


def test_permissions_follow_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        path = write_atomically(tmp_path / "a", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit, PermissionError, OSError])
def test_nothing_is_left_behind_when_it_stops_half_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stop: type[BaseException]
) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")

    def fail(source: Path, target: Path) -> None:
        assert Path(source).read_text() == "new"
        raise stop

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError if issubclass(stop, OSError) else stop):
        write_atomically(path, "new")
    assert path.read_text() == "old" and files(tmp_path) == {"a.json"}


@pytest.mark.parametrize("write", [check_writable, lambda path: write_atomically(path, "x")], ids=["check", "write"])
def test_places_that_hold_no_file_are_refused(tmp_path: Path, write: object) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder").mkdir()
    for path, said in (
        (tmp_path / "folder", "is a folder"),
        (Path(""), "is a folder"),
        (tmp_path / "file" / "a.json", "cannot be written: "),
        (tmp_path / "a\0b", "cannot be written: "),
        (tmp_path / ("x" * 300) / "a.json", "cannot be written: File name too long"),
    ):
        with pytest.raises(OutputError) as caught:
            write(path)  # type: ignore[operator]
        assert caught.value.subject == str(path) and caught.value.what.startswith(said)
    assert files(tmp_path) == {"file"}


def test_a_read_only_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Asked of the system, not tried: the person running the tests may be root, who may write everywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="a.json: cannot be written: the folder is write-protected"):
        write_atomically(tmp_path / "a.json", "x")
    assert files(tmp_path) == set()


def test_text_that_is_no_unicode_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_atomically(tmp_path / "a", "\ud800")
    assert files(tmp_path) == set()


def test_a_link_keeps_pointing_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_text() == "new"


def test_data_are_on_the_disk_before_the_name_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsync, replace = os.fsync, os.replace
    done: list[object] = []
    monkeypatch.setattr(os, "fsync", lambda fd: (done.append(os.fstat(fd).st_size), fsync(fd)))
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("named"), replace(*paths)))
    write_atomically(tmp_path / "a", "12345")
    with written_whole(tmp_path / "b") as part:
        part.write_text("123")
    assert done == [5, "named", 3, "named"]


def test_a_file_written_bit_by_bit_follows_a_link_and_spares_a_device(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    with written_whole(tmp_path / "link") as part:
        part.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        with written_whole(tmp_path / "pipe") as part:
            part.write_text("through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert (tmp_path / "pipe").is_fifo()
    with pytest.raises(ZeroDivisionError), written_whole(tmp_path / "link") as part:
        part.write_text("half")
        1 / 0  # noqa: B018
    assert (tmp_path / "real").read_text() == "new"
    assert {p.name for p in tmp_path.iterdir()} == {"real", "link", "pipe"}


def test_a_pipe_is_written_to_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_atomically(pipe, "through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_standard_output_is_written_to_even_when_it_is_a_file(tmp_path: Path) -> None:
    code = "from linear_ik.atomic import write_atomically; write_atomically('/dev/stdout', 'a'); print('b')"
    with (tmp_path / "out").open("ab") as out:
        subprocess.run([sys.executable, "-c", code], stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "ab\n"


# URDF and joint values ---------------------------------------------------------------


@ALL
def test_fitted_urdf_gives_the_bent_member_back(profile: Profile, tmp_path: Path) -> None:
    element, q, T = bent(profile, 4)
    urdf, joints, *meshes = write_fitted_urdf(element, q, T, tmp_path / "out" / "column.v2.urdf")
    assert joints == tmp_path / "out" / "column.v2_joints.json" and files(tmp_path / "out") == {
        str(p.relative_to(tmp_path / "out")) for p in (urdf, joints, *meshes)
    }
    values = json.loads(joints.read_text())
    assert values["schema"] == "linear_ik/joints/1" and values["urdf"] == urdf.name
    assert values["q"] == q.tolist() and values["base_pose"] == T.tolist()
    assert list(values["joints_rad"]) == joint_names(4)

    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    by_name = np.array([values["joints_rad"][name] for name in list(model.names)[1:]])
    pin.framesForwardKinematics(model, data, by_name)
    wanted = pinocchio_frames(element, q)
    for name, frame in wanted.items():
        np.testing.assert_array_equal(data.oMf[model.getFrameId(name)].homogeneous, frame)


@pytest.mark.parametrize("write", [write_fitted_urdf, write_glb])
@pytest.mark.parametrize(
    ("q", "pose", "named"),
    [
        (np.zeros(8), np.eye(4), "q"),
        (np.zeros((3, 3)), np.eye(4), "q"),
        (np.full(9, np.nan), np.eye(4), "q"),
        (np.zeros(9), np.eye(3), "base_pose"),
        (np.zeros(9), np.full((4, 4), np.inf), "base_pose"),
    ],
)
def test_wrong_shapes_are_refused_and_nothing_written(
    write: object, q: np.ndarray, pose: np.ndarray, named: str, tmp_path: Path
) -> None:
    with pytest.raises(ChainError) as caught:
        write(Element("a", Rectangle(1, 1), 2, 3), q, pose, tmp_path / "a.out")  # type: ignore[operator]
    assert caught.value.subject == named and not files(tmp_path)


# GLB ---------------------------------------------------------------------------------


def extras(scene: trimesh.Scene) -> tuple[str, np.ndarray]:
    record = scene.metadata["linear_ik"]
    return record["name"], np.array(record["local_origin_m"])


@ALL
@pytest.mark.parametrize("at", [(1.0, 2.0, 3.0), (500_000.3, 5_600_000.7, 120.4)], ids=["near", "UTM"])
def test_glb_is_where_pinocchio_says(profile: Profile, at: tuple, tmp_path: Path) -> None:
    element, q, T = bent(profile, 5, at)
    scene = trimesh.load_scene(write_glb(element, q, T, tmp_path / "new" / "a.glb"))
    name, origin = extras(scene)
    assert name == element.name
    assert np.any(origin) == (at[0] > 100) and np.abs(np.array(at) - origin).max() <= max(at if at[0] < 100 else [0.5])
    T_scan_base = T.copy()
    T_scan_base[:3, 3] -= origin
    for frame, T_base_frame in pinocchio_frames(element, q).items():
        np.testing.assert_allclose(scene.graph.get(frame, "scan")[0], T_scan_base @ T_base_frame, rtol=0, atol=1e-9)

    # Every segment's vertices, in glTF's axes: x right, y up (the scan's z), z towards the viewer (its -y).
    frames = pinocchio_frames(element, q)
    placed = {m.metadata["node"]: m.vertices for m in scene.dump()}
    assert set(placed) == set(segment_names(5))
    for segment, vertices in placed.items():
        mesh = extruded_mesh(profile, element.segment_length_m).apply_transform(T_scan_base @ frames[segment])
        x, y, z = mesh.vertices.T
        np.testing.assert_allclose(vertices, np.column_stack([x, z, -y]), rtol=0, atol=1e-6)


def test_glb_holds_one_mesh_and_flat_faces(tmp_path: Path) -> None:
    element, q, T = bent(IShape(0.3, 0.3, 0.011, 0.019, 0.027), 30)
    data = write_glb(element, q, T, tmp_path / "a.glb").read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    gltf = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    assert len(gltf["meshes"]) == 1 and sum("mesh" in node for node in gltf["nodes"]) == 30
    assert "NORMAL" not in gltf["meshes"][0]["primitives"][0]["attributes"]
    assert gltf["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] < 0.5
    assert str(tmp_path) not in json.dumps(gltf)


def test_glb_of_a_long_chain(tmp_path: Path) -> None:
    element, q, T = bent(CircleHollow(0.1, 0.01), 500)
    q /= 50
    scene = trimesh.load_scene(write_glb(element, q, T, tmp_path / "a.glb"))
    R, tip = np.eye(3), np.zeros(3)
    for z, y, x in q.reshape(-1, 3):
        R = R @ pin.rpy.rpyToMatrix(x, y, z)
        tip = tip + R[:, 2] * element.segment_length_m
    np.testing.assert_allclose(scene.graph.get("end", "scan")[0][:3, 3], T[:3, :3] @ tip + T[:3, 3], atol=1e-6)


def test_unwritable_places_are_refused_before_the_work(tmp_path: Path) -> None:
    element, q, T = bent(Rectangle(0.1, 0.3), 2)
    for write in (write_fitted_urdf, write_glb):
        with pytest.raises(OutputError, match="is a folder"):
            write(element, q, T, tmp_path)
