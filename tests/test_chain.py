"""Kinematic chain: poses, limits and supports, against yourdfpy and plain products of matrices."""

from __future__ import annotations

import re
from collections.abc import Callable
from io import BytesIO

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linear_ik.bending import bend_element
from linear_ik.chain import BASE, SEGMENTS_A_PIECE, Chain
from linear_ik.element import Element, PlacementTolerance
from linear_ik.errors import ChainError
from linear_ik.profile import Rectangle
from linear_ik.urdf import generate_urdf, joint_names, segment_names

FREE_BASE = np.array([0.5, 0.5, 0.5, np.pi, np.pi, np.pi])


def element(segments: int, **changes: object) -> Element:
    fields = {"name": "beam", "profile": Rectangle(0.1, 0.3), "length_m": 2.5, "segments": segments}
    return Element(**{**fields, **changes})  # type: ignore[arg-type]


def turn(axis: int, angle: float) -> np.ndarray:
    """Rodrigues' formula, for a rotation about a coordinate axis."""
    K = np.cross(np.eye(3)[axis], np.eye(3)).T
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def product(x: np.ndarray, segment_length_m: float) -> np.ndarray:
    """T_element_segment [N+1][4][4] by the contract; the last one is the tip's."""
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = x[:3], turn(2, x[3]) @ turn(1, x[4]) @ turn(0, x[5])
    step, out = np.eye(4), []
    step[2, 3] = segment_length_m
    for z, y, x_ in x[BASE:].reshape(-1, 3):
        R = np.eye(4)
        R[:3, :3] = turn(2, z) @ turn(1, y) @ turn(0, x_)
        T = T @ R
        out.append(T)
        T = T @ step
    return np.array([*out, T])


def random_x(segments: int, seed: int = 0, base: bool = True, reach: float = 0.5) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-reach, reach, BASE + 3 * segments)
    return x if base else np.concatenate([np.zeros(BASE), x[BASE:]])


# forward kinematics -------------------------------------------------------------------


@pytest.mark.parametrize("base", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("segments", [1, 2, 9, 10, 11, 20, 21, 37, 100, 500])
def test_poses_are_the_product_of_the_joints_rotations(segments: int, base: bool) -> None:
    chain = Chain(generate_urdf(element(segments)), -FREE_BASE, FREE_BASE)
    x = random_x(segments, base=base)
    pose, T = chain.pose(x), product(x, 2.5 / segments)
    assert pose.n_segments == chain.n_segments == segments and chain.nv == BASE + 3 * segments == pose.J.shape[1]
    np.testing.assert_allclose(pose.nodes_m, T[:, :3, 3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(pose.rotations, T[:-1, :3, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.segment_length_m, 2.5 / segments, rtol=1e-15)


@settings(max_examples=40, deadline=None)
@given(data=st.data(), segments=st.integers(1, 13), length=st.floats(0.1, 20))
def test_any_angles_and_any_length(data: st.DataObject, segments: int, length: float) -> None:
    angles = st.floats(-np.pi, np.pi)
    x = np.array(data.draw(st.lists(angles, min_size=BASE + 3 * segments, max_size=BASE + 3 * segments)))
    e = element(segments, length_m=length, joint_limit_deg=180)
    pose, T = Chain(generate_urdf(e), -FREE_BASE, FREE_BASE).pose(x), product(x, length / segments)
    np.testing.assert_allclose(pose.nodes_m, T[:, :3, 3], rtol=0, atol=1e-12 * max(1, length))
    np.testing.assert_allclose(pose.rotations, T[:-1, :3, :3], rtol=0, atol=1e-12)


@pytest.mark.parametrize("segments", [1, 9, 10, 11, 23])
def test_poses_are_yourdfpys(segments: int) -> None:
    import yourdfpy

    text = generate_urdf(element(segments, joint_limit_deg=180))
    q = random_x(segments, seed=segments, reach=3.0)[BASE:]
    robot = yourdfpy.URDF.load(BytesIO(text.encode()), load_meshes=False)
    robot.update_cfg(dict(zip(joint_names(segments), q, strict=True)))
    chain = Chain(text)
    for name, T in zip(segment_names(segments), chain.segment_poses(q), strict=True):
        np.testing.assert_allclose(T, robot.get_transform(name, "base"), rtol=0, atol=1e-12)
    np.testing.assert_allclose(chain.nodes(q)[-1], robot.get_transform("end", "base")[:3, 3], rtol=0, atol=1e-12)


def test_q_is_pinocchios_of_the_same_urdf() -> None:
    text = generate_urdf(element(12))
    model = pin.buildModelFromXML(text)
    q = random_x(12)[BASE:]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    chain = Chain(text)
    ends = [data.oMf[model.getFrameId(name)].translation for name in [*segment_names(12), "end"]]
    np.testing.assert_allclose(chain.nodes(q), ends, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(chain.with_q(q), np.concatenate([np.zeros(BASE), q]))


def test_the_simulators_truth_is_the_same_chain() -> None:
    e = element(12)
    bent = bend_element(e, ["3:y:20", "7:x:-30", "12:z:10"])
    np.testing.assert_allclose(Chain.of(e).nodes(bent.q), bent.nodes_m, rtol=0, atol=1e-14)


def test_the_straight_chain_is_the_design() -> None:
    for segments in (1, 10, 25):
        nodes = Chain.of(element(segments)).nodes(np.zeros(3 * segments))
        np.testing.assert_allclose(nodes[:, 2], np.linspace(0, 2.5, segments + 1), rtol=1e-14)
        assert not nodes[:, :2].any()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), segments=st.integers(1, 25))
def test_no_angle_stretches_a_segment(seed: int, segments: int) -> None:
    pose = Chain.of(element(segments)).pose(random_x(segments, seed, reach=3.0))
    np.testing.assert_allclose(np.linalg.norm(np.diff(pose.nodes_m, axis=0), axis=1), 2.5 / segments, rtol=1e-12)
    gram = pose.rotations @ pose.rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), rtol=0, atol=1e-12)


def test_a_pose_is_not_changed_by_the_next() -> None:
    chain = Chain.of(element(SEGMENTS_A_PIECE + 3))
    x = random_x(chain.n_segments)
    pose = chain.pose(x)
    kept = pose.nodes_m.copy(), pose.rotations.copy(), pose.J.copy()
    chain.pose(x + 0.1)
    for now, then in zip((pose.nodes_m, pose.rotations, pose.J), kept, strict=True):
        np.testing.assert_array_equal(now, then)


# the base ------------------------------------------------------------------------------


def test_the_base_moves_the_whole_chain() -> None:
    chain = Chain(generate_urdf(element(11)), -FREE_BASE, FREE_BASE)
    x = random_x(11)
    T = chain.base_pose(x)
    expected = np.eye(4)
    expected[:3, 3], expected[:3, :3] = x[:3], turn(2, x[3]) @ turn(1, x[4]) @ turn(0, x[5])
    np.testing.assert_allclose(T, expected, rtol=0, atol=1e-14)
    unmoved = chain.nodes(x[BASE:])
    np.testing.assert_allclose(chain.pose(x).nodes_m, unmoved @ T[:3, :3].T + T[:3, 3], rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("start", "translation_m", "rotation_rad"),
    [
        ("fixed", [0, 0, 0], 0),
        ("pinned", [0, 0, 0], np.pi),
        ("roller", [0, 0, 0.02], np.pi),
        ("free", [0.02, 0.02, 0.02], np.radians(3.0)),
    ],
)
def test_a_start_support_is_the_box_of_the_base(start: str, translation_m: list, rotation_rad: float) -> None:
    chain = Chain.of(element(2, start=start, placement_tolerance=PlacementTolerance(0.02, 3.0)))
    wanted = [*translation_m, *[rotation_rad] * 3]
    assert chain.upper[:BASE].tolist() == wanted
    assert chain.lower[:BASE].tolist() == [-v for v in wanted]


# limits --------------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 10, 11, 500])
@pytest.mark.parametrize("limits", [45, 180, 1e-3, [10, 20, 30], (0.1, 180, 33.3)])
def test_limits_are_exact_to_the_last_bit(limits: float | list, segments: int) -> None:
    e = element(segments, joint_limit_deg=limits)
    x, y, z = np.radians(np.broadcast_to(limits, 3))
    chain = Chain.of(e)
    assert chain.upper[BASE:].tolist() == [z, y, x] * segments
    assert chain.lower[BASE:].tolist() == [-z, -y, -x] * segments


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32), reach=st.floats(0, 10))
def test_clipped_is_within_and_touches_nothing_else(seed: int, reach: float) -> None:
    chain = Chain.of(element(4, start="roller"))
    x = random_x(4, seed, reach=reach)
    clipped = chain.clip(x)
    assert (clipped >= chain.lower).all() and (clipped <= chain.upper).all()
    inside = (x >= chain.lower) & (x <= chain.upper)
    np.testing.assert_array_equal(clipped[inside], x[inside])
    assert np.isin(clipped[~inside], np.concatenate([chain.lower, chain.upper])).all()


# what is no chain ----------------------------------------------------------------------

GOOD = generate_urdf(Element("beam", Rectangle(0.1, 0.3), 2.5, 3))


def swapped(old: str, new: str, count: int = -1) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, count)


@pytest.mark.parametrize(
    "urdf",
    [
        "",
        "bend me",
        "\x00",
        "<robot/>",
        '<robot name="r"><link name="base"/></robot>',
        GOOD[: len(GOOD) // 2],
        swapped('type="revolute"', 'type="spherical"'),
        swapped("segment_02_y", "segment_02_w"),
        swapped('"end"', '"tip"'),
        swapped('<axis xyz="1 0 0"/>', '<axis xyz="0 1 0"/>'),
        swapped('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', 1),
        swapped('<parent link="segment_01"/>', '<parent link="base"/>'),
        swapped('xyz="0 0 0.8333333333333334" rpy="0 0 0"', 'xyz="0 0 0.8333333333333334" rpy="0 0.1 0"'),
        swapped('xyz="0 0 0.8333333333333334"', 'xyz="0.01 0 0.8333333333333334"'),
        swapped('link"/>\n    <origin xyz="0 0 0.0"', 'link"/>\n    <origin xyz="0 0 0.1"'),
        swapped(
            '<parent link="segment_03"/>\n    <child link="end"/>', '<parent link="base"/>\n    <child link="end"/>'
        ),
        re.sub(r'lower="[^"]*"', 'lower="3"', GOOD, count=1),
        re.sub(r'upper="[^"]*"', 'upper="nan"', GOOD, count=1),
    ],
    ids=(
        "empty text binary no-links no-joints truncated spherical unknown-joint no-end wrong-axis reversed-axis "
        "branch oblique offset not-coincident end-elsewhere crossed-limits nan-limit"
    ).split(),
)
def test_what_is_no_chain_is_refused(urdf: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ChainError) as raised:
        Chain(urdf)
    assert raised.value.expected and "\n" not in str(raised.value)
    assert not capfd.readouterr().out


@pytest.mark.parametrize("spoil", [lambda v: v + 1.0, lambda v: v * np.nan], ids=["crossed", "nan"])
def test_a_base_without_room_is_refused(spoil: Callable[[np.ndarray], np.ndarray]) -> None:
    with pytest.raises(ChainError, match="lower limit"):
        Chain(GOOD, spoil(np.ones(BASE)), np.ones(BASE))
