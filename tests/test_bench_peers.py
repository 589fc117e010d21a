"""The benchmarks of peers and of scaling: what they measure, write and gate."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from benchlib import peers, peers_table, qp_steps, scaling, timing  # noqa: E402
from benchlib.methods import chain_peers, registry, slicing  # noqa: E402
from benchlib.methods.common import Template, errors_mm, regressed_nodes  # noqa: E402
from benchlib.methods.rigid import model_cloud, moved, rigid_icp  # noqa: E402
from benchlib.peer_clouds import CLOUDS, HALF, WALL, task, task_of  # noqa: E402
from benchlib.peers_table import Runs  # noqa: E402
from benchlib.stages import STAGES, StageClock, stage_of  # noqa: E402

from linear_ik import Chain  # noqa: E402

SCRIPTS = [ROOT / "scripts" / f"bench_{name}" for name in ("peers", "scaling")]
CHILDREN = {**os.environ, "PYTHONPATH": str(ROOT / "scripts"), "OMP_NUM_THREADS": "1"}


def bench(module: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"benchlib.{module}", *map(str, arguments)]
    return subprocess.run(command, env=CHILDREN, capture_output=True, text=True, timeout=120, check=False)


# The commands ---------------------------------------------------------------------------


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_script_is_executable_bash(script: Path) -> None:
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", script], check=True)
    assert f"-m benchlib.{script.name.removeprefix('bench_')} " in script.read_text()


@pytest.mark.parametrize("module", ["peers", "scaling"])
def test_help(module: str) -> None:
    done = bench(module, "--help")
    assert done.returncode == 0
    assert all(word in done.stdout for word in ("--quick", "--out", "--gate", "--rounds"))


def test_peers_writes_its_tables_and_a_baseline(tmp_path: Path) -> None:
    baseline = tmp_path / "baseline.json"
    arguments = ("--quick", "--only", "default,slicing", "--clouds", "moderate,wall", "--out", tmp_path)
    done = bench("peers", *arguments, "--baseline", baseline, "--update-baseline")
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "peers_moderate.json").read_text())["rows"]
    ours, sliced = rows
    assert ours["time / ours"] == ours["nodes / ours"] == 1.0
    assert ours["nodes rms mm"] < 1.0 < sliced["nodes rms mm"] < 60.0
    assert "No peer is better" in (tmp_path / "peers_moderate.md").read_text()
    assert (tmp_path / "peers_moderate.csv").read_text().count("\n") == 3
    searched = json.loads((tmp_path / "peers_wall.json").read_text())["rows"]
    # The wall's points are not the element's.
    assert searched[0]["surface rms mm"] < 2.0
    assert searched[0]["iterations"] > 2 * ours["iterations"]
    figures = json.loads(baseline.read_text())["bench_peers"]["quick"]["figures"]
    assert figures["moderate: nodes rms mm"]["value"] == pytest.approx(ours["nodes rms mm"], rel=1e-4)
    assert figures["moderate: iterations"]["target"] == 10.0 and figures["wall: iterations"]["target"] is None


def test_scaling_writes_its_tables_and_pictures(tmp_path: Path) -> None:
    done = bench("scaling", "--tiny", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    answers = json.loads((tmp_path / "scaling.json").read_text())["answers"]
    (answer,) = answers
    assert (answer["points"], answer["segments"]) == (1000, 10)
    assert set(answer["stages"]) == set(STAGES)
    assert sum(answer["stages"].values()) == pytest.approx(1.0)
    assert answer["stages"]["closest-point query"] > 0.0 < answer["stages"]["QP"]
    assert answer["node_rms_mm"] < 1.0
    names = {p.name for p in tmp_path.iterdir()}
    assert {"scaling.md", "scaling.csv", "scaling.png", "scaling.svg", "stages.png", "stages.svg"} <= names


@pytest.mark.parametrize(
    ("module", "arguments", "word"),
    [
        ("peers", ("--only", "default,nobody"), "nobody"),
        ("peers", ("--rounds", "0"), "--rounds"),
        ("peers", ("--clouds", "cumulus"), "cumulus"),
        ("scaling", ("--most-points", "3"), "--most-points"),
    ],
)
def test_a_wrong_argument_is_said(
    module: str, arguments: tuple[str, ...], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        {"peers": peers, "scaling": scaling}[module].main(arguments)
    assert left.value.code == 2
    assert word in capsys.readouterr().err


# The table ------------------------------------------------------------------------------


def runs(name: str, times: list[float], nodes: list[float], rounds: list[int] | None = None) -> Runs:
    (method,) = registry.named([name])
    answers = [
        {
            "time_s": t,
            "core_s": t / 2,
            "node_rms_mm": n,
            "tip_mm": n,
            "surface_rms_mm": 1.0,
            "peak_mb": 2.0,
            "iterations": None,
        }
        for t, n in zip(times, nodes, strict=True)
    ]
    return Runs(method, list(range(len(times))) if rounds is None else rounds, answers)


def test_ratios_are_taken_within_a_round() -> None:
    ours = runs("default", [1.0, 10.0, 100.0], [1.0, 1.0, 1.0])
    peer = runs("slicing", [2.0, 20.0, 200.0], [3.0, 3.0, 3.0])
    late = runs("pycpd", [500.0], [9.0], rounds=[2])
    assert peer.time_ratio(ours) == 2.0
    assert late.time_ratio(ours) == 5.0
    rows = peers_table.rows_of([ours, peer, late])
    assert [r["nodes / ours"] for r in rows] == pytest.approx([1.0, 3.0, 9.0])
    assert math.isnan(rows[0]["iterations"])


def test_a_peer_better_on_both_is_named() -> None:
    ours = runs("default", [1.0, 1.0], [1.0, 3.0])
    faster, exacter = runs("slicing", [0.5, 0.5], [2.5, 2.5]), runs("open3d_icp", [2.0, 2.0], [0.5, 0.5])
    assert peers_table.better_on_both([ours, faster, exacter]) == []
    both = runs("rustcpd", [0.5, 0.5], [0.5, 0.5])
    # Round 1 was hard for ours: a peer that ran in it alone is measured against that round.
    hard = runs("pycpd", [0.5], [2.9], rounds=[1])
    variant = runs("default_daqp", [0.5, 0.5], [0.5, 0.5])
    assert peers_table.better_on_both([ours, both, hard, variant]) == [both, hard]
    assert "BETTER THAN OURS" in peers_table.verdicts([ours, both], CLOUDS[0])[0]


def test_the_headline_says_where_no_search_is_needed() -> None:
    ours, icp = runs("default", [1.0, 1.0], [1.0, 1.0]), runs("open3d_icp", [4.0, 4.0], [9.0, 9.0])
    plain, half, _ = CLOUDS
    assert peers_table.headline([ours, icp], plain) == [
        "Time of the default where no search is needed (22.5° at segment 8): 0.250 x rigid ICP with its normals "
        "(0.500 x without their time)."
    ]
    assert "where it must search" in peers_table.headline([ours, icp], half)[0]
    names = {m.name: m for m in peers_table.peer_metrics([ours, icp], plain)}
    assert names["moderate: time, default / Open3D ICP, rigid"].target == 0.25
    searched = peers_table.peer_metrics([ours, icp], half)
    assert all(m.target is None for m in searched if "time, " in m.name)


def test_a_late_import_is_said() -> None:
    ours = runs("default", [1.0], [1.0])
    ours.answers[0]["late_imports"] = ["heavy"]
    assert "heavy" in peers_table.verdicts([ours], CLOUDS[0])[-1]


def test_a_method_that_is_not_installed_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    method = registry.Method("x", "X", "no:thing", "-", "no_such_distribution", ("no_such_distribution",))
    (run,) = peers.run_all([method], CLOUDS[0], peers.QUICK, {})
    assert run.remark == "not installed: pip install no_such_distribution"
    (row,) = peers_table.rows_of([run])
    assert math.isnan(row["time s"]) and row["remark"] == run.remark
    (run,) = peers.run_all([method], CLOUDS[0], peers.QUICK, {"x": "no compiler"})
    assert run.remark == "not installed: no compiler"


def test_a_job_that_fails_says_why() -> None:
    with pytest.raises(timing.JobError, match="exit code 1"):
        timing.run_job("benchlib.no_such_module", {}, 60)


def test_peak_memory_follows_an_array() -> None:
    timing.reset_peak()
    before = timing.resident_bytes()
    np.ones(8_000_000)
    assert 60e6 < timing.peak_bytes() - before < 90e6 or sys.platform == "darwin"


# How answers are measured ---------------------------------------------------------------


def test_template_has_a_ring_at_every_node_and_the_surface_of_the_design() -> None:
    element = task(100, 1).element
    template = Template.of(element, 2000)
    assert 1700 < len(template.vertices) < 2300
    z = np.unique(template.vertices[:, 2].round(9))
    assert set(np.linspace(0, 2.5, 11).round(9)) <= set(z)
    a, b, c = template.vertices[template.triangles].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(0.8 * 2.5)


def test_regressed_nodes_of_a_bent_template_are_the_truth() -> None:
    wanted = task(100, 1)
    chain = Chain.of(wanted.element)
    q = np.random.default_rng(0).uniform(-0.3, 0.3, 30)
    poses = chain.segment_poses(q)
    template = Template.of(wanted.element, 2000).vertices
    inside = template[np.abs(template[:, 2] / 0.25 - np.round(template[:, 2] / 0.25)) > 1e-6]
    k = np.minimum((inside[:, 2] / 0.25).astype(int), 9)
    local = inside - np.outer(k, [0, 0, 0.25])
    bent = np.einsum("pij,pj->pi", poses[k][:, :3, :3], local) + poses[k][:, :3, 3]
    np.testing.assert_allclose(regressed_nodes(wanted.element, inside, bent), chain.nodes(q), atol=1e-9)


def test_clouds_are_the_papers_beam_bent_about_x() -> None:
    wanted = task(300, 1)
    assert np.abs(wanted.nodes_m[:, 0]).max() < 1e-12 < 0.1 < np.abs(wanted.nodes_m[-1, 1])
    half, wall = task_of(HALF, 300, 1), task_of(WALL, 300, 1)
    np.testing.assert_allclose(half.nodes_m, wanted.nodes_m, atol=1e-12)
    assert wall.on_element is not None and wall.on_element.sum() == 210 and len(wall.points) == 300


def test_rigid_icp_brings_the_model_to_the_scan() -> None:
    wanted = task(3000, 1)
    model = model_cloud(wanted.element, 3000)
    T = np.eye(4)
    T[:3, 3] = [0.02, -0.01, 0.0]
    found, seconds = rigid_icp(model, model + T[:3, 3])
    np.testing.assert_allclose(found[:2, 3], T[:2, 3], atol=2e-3)
    assert seconds > 0.0


def test_errors_of_the_straight_element() -> None:
    wanted = task(2000, 1)
    T = np.eye(4)
    T[:3, 3] = [0.0, 0.0, -0.001]
    errors = errors_mm(wanted, moved(wanted, T))
    straight = np.column_stack([np.zeros((11, 2)), np.linspace(0, 2.5, 11) + 0.001])
    distance = 1e3 * np.linalg.norm(straight - wanted.nodes_m, axis=1)
    assert errors["tip_mm"] == pytest.approx(distance[-1])
    assert errors["node_rms_mm"] == pytest.approx(np.sqrt(np.mean(distance[1:] ** 2)))
    assert 20.0 < errors["surface_rms_mm"] < 100.0


def test_jacobian_of_least_squares_by_differences() -> None:
    wanted = task(300, 1)
    chain, matcher = chain_peers.prepared(wanted)
    q = np.random.default_rng(0).uniform(-0.05, 0.05, 30)

    def residual(q: np.ndarray) -> np.ndarray:
        pairs = matcher.match(chain.pose(chain.with_q(q)), wanted.points)
        return pairs.residual_m[np.argsort(pairs.order)]

    pose = chain.pose(chain.with_q(q))
    pairs = matcher.match(pose, wanted.points)
    J = chain_peers.residual_jacobian(pose, pairs)[np.argsort(pairs.order)]
    for j in range(0, 30, 7):
        step = np.zeros(30)
        step[j] = 1e-6
        slope = (residual(q + step) - residual(q - step)) / 2e-6
        # A few points change their face within the step.
        assert np.mean(np.abs(slope - J[:, j]) < 1e-4) > 0.97


def test_slicing_follows_a_straight_scan() -> None:
    wanted = task(5000, 1)
    straight = wanted.points[wanted.points[:, 2] < 1.7]
    line = slicing.centres(type(wanted)(wanted.element, straight, wanted.nodes_m), np.array([[0.0, 0, 0], [0, 0, 2.5]]))
    assert np.abs(line[1:, :2]).max() < 0.004
    np.testing.assert_allclose(slicing.at_length(line, np.array([0.5]))[0, 2], 0.5, atol=1e-4)


# Scaling --------------------------------------------------------------------------------


def test_slope_of_a_power() -> None:
    answers = [{"points": n, "time_s": 3e-6 * n**0.7} for n in (10, 100, 1000)]
    assert scaling.slope(answers, "points", "time_s") == pytest.approx(0.7)
    assert math.isnan(scaling.slope(answers[:1], "points", "time_s"))


def test_a_stage_keeps_only_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("benchlib.stages.time.perf_counter", lambda: now[0])
    clock = StageClock()

    def spend(seconds: float) -> None:
        now[0] += seconds

    inner = clock.wrapped(lambda: spend(3.0), "QP")

    def outer() -> None:
        spend(1.0)
        inner()
        spend(1.0)

    clock.wrapped(outer, "assembly")()
    spend(5.0)
    shares = clock.shares()
    assert (shares["assembly"], shares["QP"], shares["rest"]) == (0.2, 0.3, 0.5)


def test_every_stage_is_one_of_the_package() -> None:
    assert stage_of("linear_ik.terms.prior") == "assembly"
    assert stage_of("linear_ik.ik_step") == "QP"
    assert stage_of("linear_ik.viewer") is None
    fitting = ("doubts", "icpik", "fit", "scan", "tally", "repair")
    assert all(stage_of(f"linear_ik.{name}") in STAGES for name in fitting)


# The bare steps ---------------------------------------------------------------------------


def test_shortcomings_of_a_step() -> None:
    H, c = np.diag([1.0, 4.0]), np.array([-1.0, -4.0])
    box = -np.ones(2) * 0.5, np.ones(2) * 0.5
    assert qp_steps.shortcomings(H, c, *box, np.array([0.5, 0.5])) == (0.0, 0.0)
    assert qp_steps.shortcomings(H, c, *box, np.array([0.5, 0.2])) == pytest.approx((0.3, 0.0))
    assert qp_steps.shortcomings(H, c, *box, np.array([0.6, 0.5])) == pytest.approx((0.0, 0.1))


def test_the_direct_step_is_measured_as_exact() -> None:
    rng = np.random.default_rng(0)
    A = rng.standard_normal((40, 12))
    program = A.T @ A, rng.standard_normal(12) * 10, np.full(12, -0.05), np.full(12, 0.05)
    assert qp_steps.shortcomings(*program, qp_steps.maker(qp_steps.DIRECT)(*program))[0] < 1e-12
