"""Jacobians of nodes, segment frames and base, against central finite differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from linear_ik.chain import BASE, SEGMENTS_A_PIECE, Chain, Pose
from linear_ik.element import Element
from linear_ik.profile import Rectangle
from linear_ik.urdf import generate_urdf, segment_names

STEP = 1e-6
SIZES = [1, 2, SEGMENTS_A_PIECE - 1, SEGMENTS_A_PIECE, SEGMENTS_A_PIECE + 1, 2 * SEGMENTS_A_PIECE + 1, 100, 500]
BASES = pytest.mark.parametrize("base", [False, True], ids=["fixed", "floating"])


def chain_of(segments: int) -> Chain:
    return Chain(generate_urdf(Element("beam", Rectangle(0.1, 0.3), 2.5, segments)), [-3.2] * BASE, [3.2] * BASE)


def bent(chain: Chain, base: bool, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-0.7, 0.7, chain.nv) / np.sqrt(chain.n_segments)
    x[:BASE] = rng.uniform(-1, 1, BASE) if base else 0.0
    return x


def some_columns(chain: Chain, most: int = 36) -> np.ndarray:
    """All variables of a short chain; of a long one the base, the joints at the seams, the last, and some."""
    if chain.nv <= 120:
        return np.arange(chain.nv)
    seams = BASE + 3 * SEGMENTS_A_PIECE * np.array([1, 2, chain.n_segments // SEGMENTS_A_PIECE - 1])
    chosen = [*range(BASE + 3), *(seams - 1), *seams, *(seams + 2), *range(chain.nv - 3, chain.nv)]
    rest = np.setdiff1d(np.arange(chain.nv), chosen)
    return np.union1d(chosen, np.random.default_rng(1).choice(rest, most - len(chosen)))


def around(chain: Chain, x: np.ndarray, i: int) -> tuple[Pose, Pose]:
    step = np.zeros(len(x))
    step[i] = STEP
    return chain.pose(x - step), chain.pose(x + step)


def unskewed(S: np.ndarray) -> np.ndarray:
    return np.stack([S[..., 2, 1] - S[..., 1, 2], S[..., 0, 2] - S[..., 2, 0], S[..., 1, 0] - S[..., 0, 1]], -1) / 2


@BASES
@pytest.mark.parametrize("segments", SIZES)
def test_node_jacobians(segments: int, base: bool) -> None:
    chain = chain_of(segments)
    x = bent(chain, base)
    J = chain.pose(x).node_jacobians()
    assert J.shape == (segments + 1, 3, chain.nv)
    for i in some_columns(chain):
        low, high = around(chain, x, i)
        numeric = (high.nodes_m - low.nodes_m) / (2 * STEP)
        np.testing.assert_allclose(J[:, :, i], numeric, rtol=0, atol=2e-9)


@BASES
@pytest.mark.parametrize("segments", SIZES)
def test_segment_frame_jacobians(segments: int, base: bool) -> None:
    chain = chain_of(segments)
    x = bent(chain, base, seed=1)
    pose = chain.pose(x)
    frames = {1, 2, SEGMENTS_A_PIECE, SEGMENTS_A_PIECE + 1, segments // 2, segments} & set(range(1, segments + 1))
    jacobians = {k: pose.segment_jacobian(k) for k in frames}
    for i in some_columns(chain):
        low, high = around(chain, x, i)
        for k, J in jacobians.items():
            R, p = pose.rotations[k - 1], pose.nodes_m[k - 1]
            w = unskewed((high.rotations[k - 1] - low.rotations[k - 1]) / (2 * STEP) @ R.T)
            v = (high.nodes_m[k - 1] - low.nodes_m[k - 1]) / (2 * STEP)
            # Spatial velocity: linear part that of the point now at the element's origin.
            np.testing.assert_allclose(J[3:, i], w, rtol=0, atol=2e-9)
            np.testing.assert_allclose(J[:3, i], v - np.cross(w, p), rtol=0, atol=2e-9)


@BASES
def test_base_jacobian(base: bool) -> None:
    chain = chain_of(12)
    x = bent(chain, base, seed=2)
    J, T = chain.pose(x).J, chain.base_pose(x)
    for i in range(chain.nv):
        step = np.zeros(chain.nv)
        step[i] = STEP
        change = (chain.base_pose(x + step) - chain.base_pose(x - step)) / (2 * STEP)
        if i >= BASE:
            assert not change.any()
            continue
        w = unskewed(change[:3, :3] @ T[:3, :3].T)
        np.testing.assert_allclose(J[3:, i], w, rtol=0, atol=2e-9)
        np.testing.assert_allclose(J[:3, i], change[:3, 3] - np.cross(w, T[:3, 3]), rtol=0, atol=2e-9)


@pytest.mark.parametrize("segments", [3, SEGMENTS_A_PIECE, SEGMENTS_A_PIECE + 2])
def test_frame_jacobians_are_pinocchios(segments: int) -> None:
    text = generate_urdf(Element("beam", Rectangle(0.1, 0.3), 2.5, segments))
    model = pin.buildModelFromXML(text)
    data = model.createData()
    q = np.random.default_rng(3).uniform(-0.7, 0.7, model.nq)
    chain = Chain(text)
    pose = chain.pose(chain.with_q(q))
    for k, name in enumerate(segment_names(segments), start=1):
        theirs = pin.computeFrameJacobian(model, data, q, model.getFrameId(name), pin.ReferenceFrame.WORLD)
        np.testing.assert_allclose(pose.segment_jacobian(k)[:, BASE:], theirs, rtol=0, atol=1e-12)


def test_a_node_is_moved_by_the_joints_before_it_and_by_no_other() -> None:
    segments = SEGMENTS_A_PIECE + 3
    chain = chain_of(segments)
    pose = chain.pose(bent(chain, base=True))
    J = pose.node_jacobians()
    for k in range(segments + 1):
        assert not J[k, :, BASE + 3 * k :].any()
        if k:
            assert not pose.segment_jacobian(k)[:, BASE + 3 * k :].any()
            # A segment's last joint turns about its own X: its end moves by its length a radian.
            length = np.linalg.norm(J[k, :, BASE + 3 * k - 1])
            assert length == pytest.approx(2.5 / segments, rel=1e-12)


def test_a_point_of_a_segment_moves_by_the_summed_columns() -> None:
    chain = chain_of(12)
    x, k = bent(chain, base=True, seed=4), 11
    dx = STEP * np.random.default_rng(5).standard_normal(chain.nv)
    local = np.array([0.05, -0.15, 0.1])

    def place(x: np.ndarray) -> np.ndarray:
        pose = chain.pose(x)
        return pose.nodes_m[k - 1] + pose.rotations[k - 1] @ local

    twist = chain.pose(x).segment_jacobian(k) @ dx
    moved = (place(x + dx) - place(x - dx)) / 2
    np.testing.assert_allclose(twist[:3] + np.cross(twist[3:], place(x)), moved, rtol=0, atol=1e-14)
