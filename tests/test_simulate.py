"""The simulator's clouds lie on the bent element's true surface, and its truth is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from cases import TABLE_1, make
from hypothesis import given, settings
from hypothesis import strategies as st

from linear_ik.bending import Bend, bend_element, rigid_motion
from linear_ik.chain import Chain
from linear_ik.element import Element, Placement
from linear_ik.errors import SettingsError
from linear_ik.profile import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Polygon,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)
from linear_ik.scan import Scan
from linear_ik.simulate import SimulatedScan, simulate

BEAM = Element("beam", Rectangle(0.1, 0.3), 2.5)
PIPE = Element("pipe", CircleHollow(0.15, 0.01), 2.5)
UTM = Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2), ref_direction=(0, 0, 1))
PROFILES = [
    Rectangle(0.1, 0.3),
    RectangleHollow(0.35, 0.35, 0.01),
    Circle(0.15),
    CircleHollow(0.1, 0.005),
    IShape(0.3, 0.3, 0.011, 0.019, 0.027),
    LShape(0.15, 0.1, 0.012),
    UShape(0.2, 0.08, 0.008, 0.012),
    TShape(0.2, 0.15, 0.01, 0.015),
    Polygon([[0, 0], [0.2, 0], [0.2, 0.1], [0.05, 0.2]]),
]
TURN = {
    "x": lambda a: np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]),
    "y": lambda a: np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]]),
    "z": lambda a: np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]),
}


def frames(element: Element, angles: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orientations [N][3][3] and nodes [N+1][3], by the paper's words and not by the chain."""
    R, nodes, turns = base[:3, :3], [base[:3, 3]], []
    for x, y, z in angles:
        R = R @ TURN["z"](z) @ TURN["y"](y) @ TURN["x"](x)
        turns.append(R)
        nodes.append(nodes[-1] + R[:, 2] * element.length_m / element.segments)
    return np.array(turns), np.array(nodes)


def in_segments(scan: SimulatedScan, element: Element, base: np.ndarray | None = None) -> np.ndarray:
    """The points in the frame of the segment they say they are on."""
    base = element.placement.T_world_element if base is None else base
    R, nodes = frames(element, scan.joint_angles_rad, base)
    k = scan.segment - 1
    return np.einsum("pij,pi->pj", R[k], scan.points - nodes[k])


def off_surface(local: np.ndarray, element: Element) -> np.ndarray:
    """Distance of points to the open tube of a segment, by GEOS."""
    if element.profile.radius_m is not None:
        across = np.abs(np.linalg.norm(local[:, :2], axis=1) - element.profile.radius_m)
    else:
        across = shapely.distance(shapely.LinearRing(element.profile.outline()), shapely.points(local[:, :2]))
    along = local[:, 2] - np.clip(local[:, 2], 0, element.length_m / element.segments)
    return np.hypot(across, along)


@pytest.mark.parametrize("layout", ["random", "grid"])
@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.type)
def test_every_point_lies_on_the_bent_surface(profile, layout) -> None:
    element = Element("e", profile, 3.0, segments=7, placement=Placement((1, 2, 3), (1, 1, 0)))
    scan = simulate(element, bends=["3:y:22.5", "5:x:-40", "5:z:10"], points=3000, noise_m=0.0, layout=layout)
    assert off_surface(in_segments(scan, element), element).max() < 1e-12
    assert np.ptp(in_segments(scan, element)[:, 2]) > 0.9 * 3.0 / 7


@pytest.mark.parametrize("layout", ["random", "grid"])
def test_a_round_section_is_round_and_not_its_chords(layout) -> None:
    scan = simulate(PIPE, bends=["4:x:30"], noise_m=0.0, layout=layout)
    radius = np.linalg.norm(in_segments(scan, PIPE)[:, :2], axis=1)
    assert np.abs(radius - 0.15).max() < 1e-13


def test_noise_is_isotropic_and_as_large_as_asked() -> None:
    exact = simulate(BEAM, bends=["8:y:22.5"], noise_m=0.0, points=100_000)
    noisy = simulate(BEAM, bends=["8:y:22.5"], noise_m=0.002, points=100_000)
    error = noisy.points - exact.points
    assert np.abs(np.cov(error.T) - 0.002**2 * np.eye(3)).max() < 0.03 * 0.002**2
    assert np.abs(error.mean(axis=0)).max() < 4 * 0.002 / np.sqrt(1e5)
    assert off_surface(in_segments(noisy, BEAM), BEAM).max() < 6 * 0.002


@pytest.mark.parametrize("layout", ["random", "grid"])
@pytest.mark.parametrize(("points", "segments"), [(10_000, 10), (10_007, 10), (3, 10), (1, 1), (999, 500)])
def test_segments_share_the_points(points, segments, layout) -> None:
    scan = simulate(Element("e", BEAM.profile, 2.5, segments), points=points, layout=layout)
    counts = np.bincount(scan.segment, minlength=segments + 1)[1:]
    assert counts.sum() == points == len(scan)
    assert counts.max() - counts.min() <= 1


def test_random_points_are_uniform_by_area() -> None:
    element = Element("i", IShape(0.3, 0.2, 0.011, 0.019), 2.0, segments=4)
    scan = simulate(element, points=100_000, noise_m=0.0)
    local = in_segments(scan, element)
    top = np.abs(local[:, 1] - 0.1) < 1e-9
    perimeter = 2 * 0.3 + 2 * (0.3 - 0.011) + 2 * 0.2
    assert top.mean() == pytest.approx(0.3 / perimeter, rel=0.02)
    for values, high in ((local[top, 0] + 0.15, 0.3), (local[:, 2], 0.5)):
        shares = np.histogram(values, bins=10, range=(0, high))[0] / len(values)
        assert np.abs(shares - 0.1).max() < 0.01


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    for layout in ("random", "grid"):
        one, two, other = (simulate(BEAM, bends=["8:y:9"], seed=s, layout=layout).points.tobytes() for s in (7, 7, 8))
        assert one == two != other


def test_a_grid_is_regular_and_perturbed_by_no_more_than_asked() -> None:
    plain = simulate(PIPE, points=10_000, noise_m=0.0, layout="grid", perturbation=0.0)
    moved = simulate(PIPE, points=10_000, noise_m=0.0, layout="grid", perturbation=0.2)
    first = in_segments(plain, PIPE)[plain.segment == 1]
    rows = np.unique(np.round(first[:, 2], 9))
    assert np.ptp(np.diff(rows)) < 1e-8
    spacing = rows[1] - rows[0]
    around = 2 * np.pi * 0.15 * len(rows) / len(first)
    assert spacing == pytest.approx(around, rel=0.05), "cells should be nearly square"
    shift = np.abs(in_segments(moved, PIPE) - in_segments(plain, PIPE))[:, 2]
    assert 0.19 * spacing < shift.max() <= 0.2 * spacing * (1 + 1e-9)
    nearest = shapely.STRtree(shapely.points(first[:, 1:][first[:, 0] > 0.1]))
    _, gap = nearest.query_nearest(
        shapely.points(first[:, 1:][first[:, 0] > 0.1]), exclusive=True, return_distance=True
    )
    assert gap.min() > 0.7 * around, "no two points of a grid coincide"


@pytest.mark.parametrize("face", ["+x", "-x", "+y", "-y"])
@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.type)
def test_a_missing_face_is_missing_and_nothing_else_is(profile, face) -> None:
    element = Element("e", profile, 2.5, segments=5)
    whole = simulate(element, bends=["3:x:20"], points=4000)
    holed = simulate(element, bends=["3:x:20"], points=4000, missing=[face])
    R, _ = frames(element, whole.joint_angles_rad, np.eye(4))
    outward = np.einsum("pij,pi->pj", R[whole.segment - 1], whole.surface_normals)
    sign = 1 if face[0] == "+" else -1
    gone = sign * outward[:, "xy".index(face[1])] > np.cos(np.pi / 4) - 1e-9
    assert 0 < gone.sum() < 4000
    assert holed.points.tobytes() == whole.points[~gone].tobytes()


def test_missing_faces_of_the_beam_by_position() -> None:
    local = in_segments(simulate(BEAM, noise_m=0.0, missing=["+x", "-y"]), BEAM)
    assert (local[:, 0] < 0.05 - 1e-9).all()
    assert (local[:, 1] > -0.15 + 1e-9).all()
    assert len(local) == pytest.approx(5000, rel=0.05), "two of four faces are half of the surface"


def test_a_missing_side_of_a_pipe_is_its_quarter() -> None:
    local = in_segments(simulate(PIPE, noise_m=0.0, missing=["-y"]), PIPE)
    angle = np.degrees(np.arctan2(local[:, 1], local[:, 0]))
    assert not ((angle > -135) & (angle < -45)).any()
    assert len(local) == pytest.approx(7500, rel=0.03)


@pytest.mark.parametrize("profile", [BEAM.profile, PIPE.profile], ids=lambda p: p.type)
def test_surface_normals_point_outwards(profile) -> None:
    element = Element("e", profile, 2.5, placement=Placement((1, 2, 3), (1, -1, 0.5)))
    exact = simulate(element, bends=["8:y:22.5"], noise_m=0.0)
    assert np.abs(np.linalg.norm(exact.surface_normals, axis=1) - 1).max() < 1e-12
    section = shapely.Polygon(profile.outline())
    for step, inside in ((1e-3, False), (-1e-3, True)):
        moved = replace(exact, points=exact.points + step * exact.surface_normals)
        local = in_segments(moved, element)
        assert (shapely.contains_xy(section, local[:, 0], local[:, 1]) == inside).all()
        assert np.median(off_surface(local, element)) == pytest.approx(1e-3, rel=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    bends=st.lists(st.builds(Bend, st.integers(1, 6), st.sampled_from("xyz"), st.floats(-40, 40)), max_size=8),
    seed=st.integers(0, 2**63 - 1),
)
def test_the_truth_is_the_papers_kinematics(bends, seed) -> None:
    element = Element("e", Rectangle(0.1, 0.2), 1.8, 6, Placement((4, 5, 6), (0, 1, 1)), joint_limit_deg=180)
    angles = np.zeros((6, 3))
    for bend in bends:
        angles[bend.segment - 1, "xyz".index(bend.axis)] += np.radians(bend.degrees)
    if np.abs(angles).max() > np.pi:
        with pytest.raises(SettingsError, match="up to 180 degrees"):
            simulate(element, bends=bends, seed=seed)
        return
    scan = simulate(element, bends=bends, points=120, noise_m=0.0, seed=seed)
    _, nodes = frames(element, angles, element.placement.T_world_element)
    assert np.abs(scan.joint_angles_rad - angles).max() < 1e-12
    assert np.array_equal(scan.q.reshape(-1, 3)[:, ::-1], scan.joint_angles_rad)
    assert np.abs(scan.nodes_m - nodes).max() < 1e-12
    assert off_surface(in_segments(scan, element), element).max() < 1e-12


def test_a_bend_turns_the_right_way_at_the_right_node() -> None:
    scan = simulate(BEAM, bends=[Bend(8, "y", 30.0)])
    assert np.abs(scan.nodes_m[:8] - [[0, 0, 0.25 * k] for k in range(8)]).max() < 1e-12
    assert scan.nodes_m[-1] == pytest.approx([0.75 * 0.5, 0, 1.75 + 0.75 * np.sqrt(0.75)])


def test_the_fits_chain_bends_the_same_way() -> None:
    rng = np.random.default_rng(11)
    for segments in (1, 4, 10):
        element = Element("e", BEAM.profile, 2.5, segments, UTM, joint_limit_deg=180)
        bent = bend_element(element, joint_angles_rad=rng.uniform(-np.pi, np.pi, (segments, 3)))
        chain = Chain.of(element)
        assert np.abs(chain.segment_poses(bent.q) - bent.T_base_segment).max() < 1e-12
        nodes = chain.nodes(bent.q) @ bent.base_pose[:3, :3].T + bent.base_pose[:3, 3]
        assert np.abs(nodes - bent.nodes_m).max() < 1e-8


def test_angles_instead_of_bends() -> None:
    angles = np.radians(np.random.default_rng(3).uniform(-20, 20, (10, 3)))
    scan = simulate(BEAM, joint_angles_rad=angles, noise_m=0.0)
    assert np.array_equal(scan.joint_angles_rad, angles)
    assert off_surface(in_segments(scan, BEAM), BEAM).max() < 1e-12


def test_utm_coordinates_keep_their_digits() -> None:
    here = simulate(BEAM, bends=["8:y:22.5"])
    there = simulate(Element("utm", BEAM.profile, 2.5, placement=UTM), bends=["8:y:22.5"])
    T = UTM.T_world_element
    assert np.abs((there.points - T[:3, 3]) @ T[:3, :3] - here.points).max() < 5e-9
    assert there.nodes_m[0] == pytest.approx(UTM.location, abs=1e-9)


def test_a_displaced_member_moves_as_a_whole() -> None:
    element = Element("e", BEAM.profile, 2.5, placement=UTM, start="free")
    motion = rigid_motion((0.05, -0.02, 0.01), (1, -2, 3))
    still = simulate(element, bends=["8:y:22.5"])
    moved = simulate(element, bends=["8:y:22.5"], displacement=motion)
    T = UTM.T_world_element
    local = (still.points - T[:3, 3]) @ T[:3, :3]
    expected = (local @ motion[:3, :3].T + motion[:3, 3]) @ T[:3, :3].T
    assert np.abs(moved.points - T[:3, 3] - expected).max() < 1e-8
    assert np.abs(moved.base_pose - T @ motion).max() < 1e-9
    assert moved.nodes_m[0] == pytest.approx(moved.base_pose[:3, 3], abs=1e-9)
    assert motion[:3, :3] == pytest.approx(
        TURN["z"](np.radians(3)) @ TURN["y"](np.radians(-2)) @ TURN["x"](np.radians(1))
    )


def test_the_scan_without_its_truth_is_a_plain_scan() -> None:
    plain = simulate(BEAM).without_truth()
    assert type(plain) is Scan
    assert plain.normals is None and plain.stations is None


@pytest.mark.parametrize(
    ("text", "bend"),
    [("8:y:22.5", Bend(8, "y", 22.5)), (" 1 : X : -9 ", Bend(1, "x", -9.0)), ("12:z:1e1", Bend(12, "z", 10.0))],
)
def test_bends_are_read_as_typed(text, bend) -> None:
    assert Bend.parse(text) == bend


@pytest.mark.parametrize(
    "text", ["", "8", "8:y", "8:y:", "8:w:3", "0:y:3", "-1:y:3", "1.5:y:3", "8:y:3:4", "8:y:nan", "8:y:inf", "a:b:c"]
)
def test_a_wrong_bend_says_what_a_bend_is(text) -> None:
    with pytest.raises(SettingsError) as error:
        Bend.parse(text)
    assert repr(text) in str(error.value) and "8:y:22.5" in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": 0}, "points: 0"),
        ({"points": 10**9}, "points: 1000000000"),
        ({"points": 1.5}, "points: 1.5"),
        ({"points": True}, "points: True"),
        ({"noise_m": -0.1}, "noise_m: -0.1"),
        ({"noise_m": float("nan")}, "noise_m: nan"),
        ({"noise_m": "much"}, "noise_m: 'much'"),
        ({"seed": -1}, "seed: -1"),
        ({"layout": "spiral"}, "one of random, grid"),
        ({"perturbation": 0.6}, "perturbation: 0.6"),
        ({"missing": ["+z"]}, r"missing: '\+z' .*\+x, -x, \+y, -y"),
        ({"missing": "up"}, "missing: 'up'"),
        ({"missing": ["+x", "-x", "+y", "-y"]}, "leave no point"),
        ({"bends": ["11:y:3"]}, "segment 11 .1 to 10"),
        ({"bends": ["8:y:46"]}, "segment 8 by 46 degrees about y .up to 45 degrees"),
        ({"bends": ["8:y:30", "8:y:30"]}, "segment 8 by 60 degrees about y"),
        ({"bends": ["8:y:400"]}, "bend degrees: 400"),
        ({"joint_angles_rad": np.zeros((9, 3))}, r"shape \[9\]\[3\] .*\[10\]\[3\]"),
        ({"joint_angles_rad": np.full((10, 3), np.nan)}, "not finite"),
        ({"joint_angles_rad": np.full((10, 3), 1.0)}, "up to 45 degrees"),
        ({"joint_angles_rad": [["a"] * 3] * 10}, "not numbers"),
        ({"joint_angles_rad": np.zeros((10, 3)), "bends": ["8:y:3"]}, "together with bends"),
        ({"displacement": 2 * np.eye(4)}, "not a rigid motion"),
        ({"displacement": np.diag([1, 1, -1, 1])}, "not a rigid motion"),
        ({"displacement": np.eye(3)}, r"displacement: shape \[3\]\[3\]"),
    ],
)
def test_wrong_arguments_are_named(arguments, message) -> None:
    with pytest.raises(SettingsError, match=message):
        simulate(BEAM, **arguments)


def test_a_wrong_bend_is_refused_when_made() -> None:
    for arguments in ((0, "x", 1.0), (1, "w", 1.0), (1, "x", float("inf")), ("1", "x", 1.0)):
        with pytest.raises(SettingsError, match="^bend "):
            Bend(*arguments)
    with pytest.raises(SettingsError, match="translation_m"):
        rigid_motion((1, 2))


def test_a_bend_at_the_limit_is_within_it() -> None:
    scan = simulate(BEAM, bends=[f"8:x:{45 / 7}"] * 7)
    assert np.abs(scan.joint_angles_rad).max() <= BEAM.joint_limit_rad[0]
    assert bend_element(Element("e", BEAM.profile, 1, joint_limit_deg=180), "2:z:180").nodes_m.shape == (11, 3)


@pytest.mark.parametrize("case", TABLE_1, ids=lambda c: c.name)
def test_the_papers_cases_are_what_the_table_says(case) -> None:
    element, scan = make(case.name, seed=5)
    assert element.length_m == 2.5 and element.segments == 10
    kept = np.bincount(scan.segment, minlength=11)[1:] / 1000
    expected = {"4a": 0.625, "4b": 0.875, "4c": 0.5}.get(case.name, 1.0)
    assert kept == pytest.approx(np.full(10, expected), abs=0.06 if expected < 1 else 0)
    distance = off_surface(in_segments(scan, element), element)
    assert 0.0005 < np.sqrt((distance**2).mean()) < 0.0012
    degrees = np.degrees(np.abs(scan.joint_angles_rad).max(axis=1))
    joint, angle = {"1a": (8, 9), "1c": (8, 45), "2a": (8, 9), "2b": (4, 9)}.get(case.name, (8, 22.5))
    assert degrees == pytest.approx(np.eye(10)[joint - 1] * angle)
    tip = scan.nodes_m[-1] - scan.nodes_m[0]
    assert abs(tip[1]) > 0.1 and abs(tip[0]) < 1e-12


def test_table_1_is_complete() -> None:
    assert [c.name for c in TABLE_1] == "1a 1b 1c 2a 2b 3a-150 3a-200 3b 3c 4a 4b 4c".split()
    assert sum(not c.solved_in_paper for c in TABLE_1) == 2
