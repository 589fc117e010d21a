"""The benchmark of scans as they are: what it draws, judges, writes and remembers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from benchlib import calibration, scene_bench, scene_tables, surroundings  # noqa: E402
from benchlib.bound import node_covariance  # noqa: E402
from benchlib.drawn_profiles import TYPES, drawn  # noqa: E402
from benchlib.named_scenes import CASES, named_scene, sagging  # noqa: E402
from benchlib.random_scenes import BENDS, bent_angles, scene  # noqa: E402
from benchlib.scene_fits import SceneOutcome, axes, judged, mahalanobis, outcome_of, staged  # noqa: E402

from linear_ik import Element, FitSettings, Rectangle, fit, simulate  # noqa: E402
from linear_ik.bending import bend_element, rigid_motion  # noqa: E402

LABELS = {
    "profile": "circle",
    "bends": "knee",
    "stations": "1",
    "stations named": "no",
    "clutter": "none",
    "faces": "as seen",
    "start": "fixed",
    "noise": "1.5 to 2 mm",
    "stands": "beam",
}


def outcome(seed: int = 1, status: str = "converged", excess: float = 0.5, **changes: object) -> SceneOutcome:
    reasons = () if status == "converged" else ("a reason",)
    numbers = (excess, 0.0, 0.3, 0.1, excess, True, (1.0, 9.0), (2, 2), 0.1, 10)
    return replace(SceneOutcome("random", seed, LABELS, status, reasons, *numbers), **changes)  # type: ignore[arg-type]


# Scenes ---------------------------------------------------------------------------------


def test_a_seed_is_a_scene() -> None:
    assert scene(5) == scene(5) != scene(6)
    one, other = scene(4).stage(), scene(4).stage()
    assert one.element == other.element
    np.testing.assert_array_equal(one.scan.points, other.scan.points)


def test_everything_asked_for_is_drawn() -> None:
    every = [scene(seed) for seed in range(1, 501)]
    assert {s.profile for s in every} == set(TYPES) and {s.bends for s in every} == set(BENDS)
    assert {s.clutter for s in every} == {"none", *surroundings.KINDS}
    assert {s.stations for s in every} == {1, 2, 3}
    assert {s.told for s in every} == {s.free for s in every} == {s.on_map for s in every} == {True, False}
    assert all(len(s.hidden) in (0, 2) and (not s.hidden or s.stations > 1) for s in every)
    assert all(0.0015 <= s.noise_m <= 0.005 and 6_000 <= s.points <= 10_000 for s in every)
    assert 0.05 < np.mean([s.noise_m >= 0.003 for s in every]) < 0.15


@pytest.mark.parametrize("seed", [3, 6, 8, 13])
def test_the_truth_is_within_what_the_design_allows(seed: int) -> None:
    drawn_scene = scene(seed)
    there = drawn_scene.stage()
    element, scan = there.element, there.scan
    T = np.linalg.inv(element.placement.T_world_element) @ scan.base_pose
    assert np.abs(T[:3, 3]).max() <= (0.05 if drawn_scene.free else 1e-9)
    assert element.start == ("free" if drawn_scene.free else "fixed")
    assert np.abs(scan.joint_angles_rad).max() <= np.pi / 4
    assert 0.8 * drawn_scene.points < scan.on_element.sum() < 1.2 * drawn_scene.points
    assert (scan.stations is not None) == drawn_scene.told


@pytest.mark.parametrize("kind", TYPES)
def test_profiles_make_elements(kind: str) -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        profile = drawn(kind, rng)
        assert profile.type == kind and 0.04 < np.ptp(profile.outline(), axis=0).max() < 0.6


@pytest.mark.parametrize("kind", BENDS)
def test_bends_are_what_they_are_called(kind: str) -> None:
    angles = bent_angles(kind, 9, np.random.default_rng(1))
    bent = np.count_nonzero(np.abs(angles).max(axis=1) > 1e-6)
    assert bent == {"none": 0, "arc": 8, "knee": 1, "two-axis": 2, "small": 8}[kind]
    assert not angles[0].any()


def test_surroundings_stand_where_they_say() -> None:
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 5)
    bent = bend_element(element, ["3:y:20"])
    beside = surroundings.neighbour_beside(bent)
    corners = surroundings.body(bent)
    apart = [
        max(beside.vertices[:, i].min() - corners[:, i].max(), corners[:, i].min() - beside.vertices[:, i].max())
        for i in range(2)
    ]
    assert max(apart) == pytest.approx(0.05)
    behind = surroundings.wall_behind(bent, np.array([1.0, 0.0, 0.0]), 0.2)
    assert np.allclose(behind.vertices[:, 0], corners[:, 0].min() - 0.2)
    assert surroundings.floor_under(bent, 1.0).vertices[:, 2] == pytest.approx(corners[:, 2].min())
    bracket = surroundings.bracket_on(bent, 0, 0)
    assert bracket.vertices[:, 0].min() == pytest.approx(0.05)
    assert len(surroundings.cable_along(bent, 1, 0.01)) == 5
    kinds = ("floor", "wall", "neighbour", "bracket", "cable")
    assert len(surroundings.around(bent, kinds, np.array([1.0, 0.0, 0.0]), 0.0, np.random.default_rng(0))) == 9


def test_hidden_faces_are_gone() -> None:
    seed = next(s for s in range(1, 100) if scene(s).hidden and scene(s).bends == "none")
    there = scene(seed).stage()
    normals = there.scan.surface_normals[there.scan.on_element] @ there.scan.base_pose[:3, :3]
    for name in scene(seed).hidden:
        sign, axis = (1.0 if name[0] == "+" else -1.0), "xyz".index(name[1])
        assert (sign * normals[:, axis]).max() < 0.71


@pytest.mark.parametrize("name", CASES)
def test_every_case_can_be_staged(name: str) -> None:
    there = named_scene(name, 3)
    assert len(there.limit_mm) == len(there.scan.nodes_m) == there.element.segments + 1
    assert len(there.scan.points) > 1000


def test_the_sag_is_smooth_clamped_and_told_in_the_designs_joints() -> None:
    there = sagging(1)
    nodes = there.scan.nodes_m
    assert nodes[:, 2].min() == pytest.approx(2.46, abs=1e-4) and nodes[-1, 2] == pytest.approx(2.5, abs=1e-6)
    assert 5.0 - nodes[-1, 0] == pytest.approx(0.0008, abs=1e-4)
    told = bend_element(there.element, (), there.scan.joint_angles_rad).nodes_m
    assert np.abs(told - nodes).max() < 1e-4
    assert there.scan.segment.max() == there.element.segments


# Judgement ------------------------------------------------------------------------------


def test_a_scene_is_judged_across_and_along_its_axis() -> None:
    there = staged("half the faces hidden, 22.5°", 1)
    result = fit(there.element, there.scan.without_truth(), FitSettings())
    found = judged("a", 1, there, result, 0.1)
    assert found.succeeded and not found.claimed_wrong and found.across_mm < 1.0
    error = np.linalg.norm(result.nodes_m - there.scan.nodes_m, axis=1).max()
    assert max(found.across_mm, found.along_mm) <= 1e3 * error <= found.across_mm + found.along_mm
    off = replace(result, nodes_m=result.nodes_m + [0.1, 0.0, 0.0])
    failed = judged("a", 1, there, off, 0.1)
    assert not failed.succeeded and failed.claimed_wrong == (result.status == "converged")
    assert not any(failed.inside)
    again = outcome_of(json.loads(json.dumps(failed.__dict__)))
    assert again == failed


def test_axes_halve_the_angle_at_a_node() -> None:
    nodes = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 1]])
    np.testing.assert_allclose(axes(nodes), [[0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5)], [1, 0, 0]], atol=1e-12)


def test_distances_leave_out_what_has_no_deviation() -> None:
    C = np.stack([np.zeros((3, 3)), np.diag([4e-6, 1e-6, 0.0])])
    distance, dimensions = mahalanobis(np.array([[0.0, 0, 0], [0.002, 0.002, 1e-7]]), C)
    assert dimensions == [0, 2] and distance == pytest.approx([0.0, 5.0])


def test_bound_of_a_base_that_may_move() -> None:
    fixed = Element("e", Rectangle(0.2, 0.2), 2.0, 4)
    moved = rigid_motion((0.01, -0.02, 0.0), (1.0, 0.0, 0.0))
    free = replace(fixed, start="free")
    held = node_covariance(fixed, simulate(fixed, points=4000), 0.001)
    loose = node_covariance(free, simulate(free, points=4000, displacement=moved), 0.001)
    assert not held[0].any() and 1e-5 < np.sqrt(loose[0, 0, 0]) < 0.001
    # No face shows a slide along a straight axis: the tolerance is all that is known.
    assert np.sqrt(loose[:, 2, 2]) == pytest.approx(0.05 / np.sqrt(3), rel=0.02)
    assert (np.linalg.eigvalsh(loose - held) > -1e-9).all()


# Tables ---------------------------------------------------------------------------------


def test_what_must_not_happen_is_counted() -> None:
    fits = [
        outcome(1),
        outcome(2, "converged", 3.0),
        outcome(3, "uncertain", 4.0),
        outcome(4, "uncertain", 0.5, observable=False),
    ]
    row = scene_tables.row("all", fits)
    assert row["succeed %"] == 50.0 and row["converged yet wrong"] == 1
    assert row["failures that say so %"] == 50.0 and row["successes that doubt %"] == 50.0
    assert row["nodes inside 95 %"] == 50.0
    rows = scene_tables.random_rows(fits)
    assert rows[0]["fits"] == 3 and rows[-1]["fits"] == 1
    assert "seed 2 (3.0 mm)" in " ".join(scene_tables.random_notes(fits))
    named = {m.name: m.value for m in scene_tables.metrics(fits, {"a": [replace(fits[0], kind="a")]})}
    assert named["random scenes: success, %"] == pytest.approx(100 / 3)
    assert named["random scenes: converged yet wrong"] == 1
    assert named["random scenes: failures that do not say so"] == 1
    assert named["named cases: within their limits, %"] == 100.0
    lines = scene_tables.worst(fits, 5)
    assert "seed 2: converged, YET WRONG" in lines[0] and "staged('random', 2)" in lines[1]
    assert scene_tables.worst(fits[:1], 5) == ["no scene failed"]


def test_calibration_counts_nodes(tmp_path: Path) -> None:
    fits = [outcome(i, labels={**LABELS, "start": "free"}) for i in range(5)] + [outcome(9, "not_scanned")]
    row = calibration.calibration_row("all", fits)
    assert row["scans"] == 5 and row["nodes"] == 10 and row["inside 95 %"] == 50.0
    assert row["scans with every node inside 95 %"] == 0.0
    assert "all (50.0 %)" in calibration.calibration_notes([row])[0]
    by_kind = calibration.kinds(fits)
    assert len(by_kind["start free"]) == 5 and len(by_kind["clean"]) == 1 and "clutter" not in by_kind
    for again in ("a", "b"):
        calibration.draw_calibration(tmp_path / again, by_kind)
    for ending in (".png", ".svg"):
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


# The command ----------------------------------------------------------------------------


def test_script_is_executable_bash() -> None:
    script = ROOT / "scripts" / "bench_scenes"
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", script], check=True)
    assert "-m benchlib.scene_bench " in script.read_text()
    for name in ("random", "calibration", "cases"):
        assert f"<!-- bench_scenes {name} -->" in (ROOT / "docs" / "scenes.md").read_text()


def test_bench_scenes_writes_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scene_bench, "QUICK_CASES", ("circle, one station",))
    asked = ["--quick", "--scenes", "2", "--seed", "4", "--workers", "1", "--worst", "1", "-o", str(tmp_path)]
    assert scene_bench.main(asked) == 0
    shown = capsys.readouterr()
    assert "4 fits, 0 of them done before" in shown.err and "fail" in shown.err
    rows = json.loads((tmp_path / "random.json").read_text())["rows"]
    assert rows[0]["scenes"] == "every bend shown" and rows[0]["fits"] == 2
    assert json.loads((tmp_path / "cases.json").read_text())["rows"][0]["seeds"] == 2
    assert ET.parse(tmp_path / "calibration.svg").getroot().tag.endswith("svg")
    assert len(json.loads((tmp_path / "outcomes.json").read_text())) == 4
    assert scene_bench.main(asked) == 0
    assert "4 fits, 4 of them done before" in capsys.readouterr().err
