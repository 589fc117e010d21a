"""The benchmarks of the paper's method: what they compute, draw and write."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import TABLE_1

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from benchlib import ablation, accuracy, cells, comparison, figures, maps, pairings, reports, scenes, variants  # noqa: E402
from benchlib.bound import cramer_rao  # noqa: E402
from benchlib.cases import BOTH_ENDS, PAPER, make, named  # noqa: E402
from benchlib.cells import Cell, Outcome  # noqa: E402
from benchlib.runs import Run, Yardstick, in_segments, model_cloud, patched, run  # noqa: E402
from benchlib.scenes import MapPlan, Scene, map_plans  # noqa: E402

from linear_ik import Element, FitSettings, Rectangle, simulate  # noqa: E402

SCRIPTS = [ROOT / "scripts" / f"bench_{name}" for name in ("paper", "accuracy", "ablation")]


def outcome(seed: int = 1, max_mm: float = 0.2, bound_mm: float = 0.1, status: str = "converged") -> Outcome:
    return Outcome(seed, status, max_mm, max_mm / 2, max_mm, bound_mm, bound_mm / 2, bound_mm, True, 0.1, 10)


def fitted(worst_mm: float, curve: list[float], iterations: int = 100) -> Run:
    return Run("converged", iterations, {"coarse": iterations}, 1.0, [0.0, worst_mm], curve[-1], 1.0, curve, curve)


# The commands ---------------------------------------------------------------------------


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_script_is_executable_bash(script: Path) -> None:
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", script], check=True)
    module = script.name.removeprefix("bench_")
    assert f"-m benchlib.{module} " in script.read_text()
    assert (ROOT / "scripts" / "benchlib" / f"{module}.py").exists()


def test_bench_paper_quick(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchlib.paper", "--quick", "-o", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "scripts")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split()) == sorted(str(path) for path in tmp_path.iterdir())
    table = json.loads((tmp_path / "table1.json").read_text())
    assert [row["case"] for row in table["rows"]] == ["1b"] * 4 + ["4c"] * 4
    assert [row["by"] for row in table["rows"][:4]] == [
        "paper, published",
        "paper's method, our run",
        "paper's method, clouds on one grid",
        "default",
    ]
    for row in table["rows"]:
        if row["by"] == "default":
            assert row["worst node mm"] < 1.5
            assert row["RMSE mm"] == pytest.approx(row["RMSE of the truth mm"], rel=0.05)
    assert any("published" in note for note in table["notes"])
    assert (tmp_path / "table1.csv").read_text().count("\n") == 9
    for n in (3, 4, 5, 6):
        assert (tmp_path / f"figure{n}.png").read_bytes().startswith(b"\x89PNG")
        assert ET.parse(tmp_path / f"figure{n}.svg").getroot().tag.endswith("svg")


def test_bench_accuracy_writes_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seeds = {"default": 2, "icpik": 1}
    plan = accuracy.Plan(("1b",), seeds, {"default": 1, "icpik": 1}, 600, ("joints that bend",), 9)
    monkeypatch.setattr(accuracy, "QUICK", plan)
    monkeypatch.setattr(scenes, "MAP_POINTS", 600)
    assert accuracy.main(["--quick", "--workers", "1", "-o", str(tmp_path)]) == 0
    assert "5 fits, 0 of them done before" in capsys.readouterr().err
    rows = json.loads((tmp_path / "efficiency.json").read_text())["rows"]
    assert [(row["method"], row["seeds"]) for row in rows] == [("icpik", 1), ("default", 2)]
    assert rows[1]["nodes / bound"] < 2.0 < rows[0]["nodes / bound"]
    first = (tmp_path / "maps_succeeded.svg").read_bytes()
    assert accuracy.main(["--quick", "--workers", "1", "-o", str(tmp_path)]) == 0
    assert "5 fits, 5 of them done before" in capsys.readouterr().err
    assert (tmp_path / "maps_succeeded.svg").read_bytes() == first


def test_bench_ablation_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = ablation.Place("arc", scene=Scene(20.0, points=800))
    some = [ablation.Group("default", "The default", variants.default_variants()[:2], (place,), 1)]
    monkeypatch.setattr(ablation, "groups", lambda quick: some)
    assert ablation.main(["--quick", "--workers", "1", "-o", str(tmp_path)]) == 0
    lines = (tmp_path / "default.md").read_text().splitlines()
    assert lines[2].startswith("| default | ") and "· 1/1 |" in lines[2]
    assert json.loads((tmp_path / "default.json").read_text())["rows"][0]["arc: seeds"] == 1


# Cases and scenes -----------------------------------------------------------------------


def test_cases_are_the_papers_and_two_held_at_both_ends() -> None:
    assert len({case.name[:2] for case in TABLE_1}) == 11
    assert len({case.name for case in PAPER}) == 14
    assert sum(case.solved_in_paper for case in TABLE_1 if case.name != "3a-200") == 9
    for case in BOTH_ENDS:
        nodes = case.scan(points=50).nodes_m
        assert np.linalg.norm(nodes[-1, :2]) < 1e-9
        assert np.abs(nodes[:, 1]).max() > 0.07
        assert 2.5 - nodes[-1, 2] < 2 * case.element.end_tolerance_m
    with pytest.raises(KeyError):
        named("9z")
    element, scan = make("2a", seed=3)
    assert element.name == "2a" and np.array_equal(scan.points, named("2a").scan(3).points)


def test_scene_bends_by_the_total_in_one_plane() -> None:
    scan = Scene(90.0, joints=3, points=300).scan(5)
    along = np.diff(scan.nodes_m, axis=0) / 0.25
    bends = np.degrees(np.arccos(np.clip(np.einsum("ki,ki->k", along[1:], along[:-1]), -1, 1)))
    assert bends[bends > 1e-3] == pytest.approx([30.0] * 3)
    assert along[0].tolist() == [0.0, 0.0, 1.0]
    assert np.linalg.matrix_rank(scan.nodes_m - scan.nodes_m[0], tol=1e-6) == 2
    assert np.array_equal(scan.points, Scene(90.0, joints=3, points=300).scan(5).points)
    assert not Scene(46.0, joints=1).possible and Scene(180.0).possible
    assert Scene(45.0, joints=1, points=50).scan(2).on_element.all()


def test_scene_holes_outliers_and_wall() -> None:
    plain = Scene(45.0, points=2_000)
    assert len(replace(plain, holes=0.75).scan(1).points) == 500
    cluttered = replace(plain, outliers=0.5).scan(1)
    assert len(cluttered.points) == 4_000 and cluttered.on_element.sum() == 2_000
    walled = replace(plain, clutter=0.2, noise_m=0.0).scan(1)
    element, wall = walled.points[walled.on_element], walled.points[~walled.on_element]
    assert len(wall) == 500
    normal = np.linalg.svd(wall - wall.mean(axis=0))[2][-1]
    beyond = (wall @ normal).mean() - element @ normal
    assert np.abs(beyond).min() == pytest.approx(0.05, abs=1e-6) and len(set(np.sign(beyond))) == 1


def test_maps_cover_what_was_asked() -> None:
    plans = {plan.title: plan for plan in map_plans()}
    scenes = [plan.scene(i, 0) for plan in plans.values() for i in range(len(plan.y))]
    assert {s.noise_m for s in scenes} >= {0.0, 0.005}
    assert {s.holes for s in scenes} >= {0.0, 0.75}
    assert {s.outliers for s in scenes} >= {0.0, 0.5} and {s.clutter for s in scenes} >= {0.0, 0.5}
    assert {s.segments for s in scenes} >= {5, 60}
    assert all(plan.totals_deg[0] == 0.0 and plan.totals_deg[-1] == 180.0 for plan in plans.values())
    assert min(accuracy.FULL.case_seeds["default"], 24) == 24


# The bound ------------------------------------------------------------------------------


def test_bound_of_one_straight_segment_is_the_textbooks() -> None:
    element = Element("rod", Rectangle(0.2, 0.2), 1.0, segments=1)
    scan = simulate(element, points=40_000, noise_m=0.001, seed=1)
    x_faces = np.abs(scan.surface_normals[:, 0]) > 0.5
    lever = [np.sum(scan.points[rows, 2] ** 2) for rows in (x_faces, ~x_faces)]
    expected = 0.001 * math.sqrt(1 / lever[0] + 1 / lever[1])
    found = cramer_rao(element, scan, 0.001)
    assert found.tip_m == pytest.approx(expected, rel=0.01)
    assert cramer_rao(element, scan, 0.002).tip_m == pytest.approx(2 * expected, rel=0.01)
    assert found.observable


def test_bound_knows_what_no_face_shows() -> None:
    scene = Scene(0.0, profile="box", faces_missing=("+x", "-x"), points=2_000)
    found = cramer_rao(scene.element, scene.scan(1), 0.001)
    assert not found.observable and found.tip_m > 0.1


# Runs -----------------------------------------------------------------------------------


def test_yardstick_scores_truth_best_and_run_follows_every_iteration() -> None:
    case = named("1b")
    scan = case.scan(1, 1_000)
    yardstick = Yardstick(case.element, scan)
    truth = yardstick.at_truth()
    straight = yardstick.measure(np.zeros(30), np.eye(4))
    assert truth[1] == pytest.approx(1.0, abs=0.15) and truth[0] < straight[0] and truth[1] < straight[1]
    done = run(case.element, scan, FitSettings(), yardstick=yardstick)
    assert len(done.cloud_curve_mm) == len(done.surface_curve_mm) == done.iterations + 1
    assert done.cloud_curve_mm[0] == straight[0]
    assert sum(done.phases.values()) == done.iterations
    assert done.surface_rmse_mm == pytest.approx(truth[1], abs=0.05)
    assert done.max_mm >= done.tip_mm and done.max_mm < 1.0


def test_clouds_of_one_grid_are_close_where_independent_ones_are_not() -> None:
    case = named("1b")
    scan = case.scan(1, 2_000, layout="grid")
    cloud = simulate(case.element, points=2_000, noise_m=0.0, seed=9, layout="grid")
    segment, local = in_segments(case.element, cloud)
    assert local[:, 2].min() >= 0 and local[:, 2].max() <= 0.25 and set(segment) == set(range(10))
    on_grid = Yardstick(case.element, scan, cloud=cloud).at_truth()[0]
    assert on_grid < 0.5 * Yardstick(case.element, scan).at_truth()[0]
    from linear_ik import icpik

    before = icpik.ModelCloud
    with model_cloud(case.element, cloud):
        assert np.array_equal(icpik.ModelCloud(None, None, 5, 0).local, local)
    assert icpik.ModelCloud is before


def test_patched_puts_back_and_knows_its_names() -> None:
    from linear_ik import icpik

    before = icpik.THRESHOLD_DECAY
    with pytest.raises(ZeroDivisionError), patched((icpik, "THRESHOLD_DECAY", 0.5)):
        assert icpik.THRESHOLD_DECAY == 0.5
        raise ZeroDivisionError
    assert before == icpik.THRESHOLD_DECAY
    with pytest.raises(AttributeError), patched((icpik, "NO_SUCH_CONSTANT", 1)):
        pass


# Verdicts -------------------------------------------------------------------------------


def test_settled_at_is_where_a_curve_stops_falling() -> None:
    assert comparison.settled_at([100.0, 50.0, 10.0, 9.9, 10.0, 10.0]) == 2
    assert comparison.settled_at([10.0]) == 0
    assert comparison.settled_at([10.0, 1.0, 8.0, 1.0]) == 3


def test_published_ranges_are_read_by_their_upper_end() -> None:
    assert comparison.highest("4 to 5") == 5.0
    assert comparison.highest("< 6") == 6.0
    assert comparison.highest("-") == math.inf


def test_differences_name_what_the_runs_do_not_show() -> None:
    def compared(name: str, worst_mm: float, rmse_mm: float) -> comparison.Compared:
        runs = {m: fitted(worst_mm, [50.0, rmse_mm]) for m in ("icpik", "grid")}
        runs["default"] = fitted(0.1, [50.0, 7.9], iterations=9)
        case = named(name)
        bound = cramer_rao(case.element, case.scan(1, 500), 0.001)
        return comparison.Compared(case, runs, {"icpik": 7.9, "grid": 2.4, "default": 7.9}, bound)

    text = "\n".join(comparison.differences([compared("1b", 30.0, 8.4), compared("4c", 35.0, 9.0)]))
    assert "RMSE of 1b" in text and "7.9" in text and "8.4 (1b, published < 6)" in text
    assert "4c: the paper calls its fit a complete failure, ours ends 35 mm off" in text
    assert "1b: the paper calls" not in text
    good = comparison.differences([compared("1b", 30.0, 5.0)])
    assert not any("RMSE" in note.split(":")[0] for note in good)
    assert comparison.outcome(0.4) == "within 0.5 mm" and comparison.outcome(51.0) == "failure"
    names = {m.name: m for m in comparison.metrics([compared("1b", 30.0, 8.4)])}
    assert names["1b: worst node, mm"].value == pytest.approx(0.1) and names["median iterations"].value == 9


def test_success_is_a_millimetre_or_three_times_the_bound() -> None:
    assert outcome(max_mm=0.99).succeeded and not outcome(max_mm=1.01).succeeded
    assert outcome(max_mm=2.9, bound_mm=1.0).succeeded and not outcome(max_mm=3.1, bound_mm=1.0).succeeded
    assert outcome(max_mm=49.0).aligned and not outcome(max_mm=51.0).aligned


def test_where_the_papers_method_reaches_farther_is_said() -> None:
    places = {
        ("noise", 0, 0, "icpik"): [outcome(1, 0.5)],
        ("noise", 0, 0, "default"): [outcome(1, 0.4), outcome(2, 9.0)],
        ("noise", 0, 1, "icpik"): [outcome(1, 0.5), outcome(2, 7.0)],
        ("noise", 0, 1, "default"): [outcome(1, 60.0), outcome(2, 7.0)],
    }
    found = accuracy.beyond_default(places)
    assert len(found) == 2 and all("column 1, seed 1" in line for line in found)
    plan = MapPlan("noise", "mm", (("0", Scene(0.0)),), (0.0, 45.0))
    drawn = accuracy.success_map(plan, places, "succeeded")
    assert drawn.share["default"].tolist() == [[0.5, 0.0]]
    row = accuracy.map_row(plan, places)
    assert row["default wrong but converged"] == 3 and row["icpik succeed %"] == pytest.approx(200 / 3)


def test_efficiency_is_of_root_mean_squares() -> None:
    row = accuracy.efficiency_row("1b", "default", [outcome(1, 0.6, 0.2), outcome(2, 0.8, 0.2, "uncertain")])
    assert row["nodes / bound"] == pytest.approx(math.sqrt((0.3**2 + 0.4**2) / 2) / 0.1)
    assert row["mean nodes / bound"] == pytest.approx(3.5)
    assert row["converged"] == "1/2" and row["worst node mm"] == 0.8
    notes = " ".join(accuracy.efficiency_notes([row]))
    assert "1b (3.54)" in notes and "1b (0.80 mm)" in notes


def test_interval_holds_the_ratio_and_closes_with_the_seeds() -> None:
    rng = np.random.default_rng(1)
    errors, bounds = np.abs(rng.normal(1.0, 0.3, 400)), np.full(400, 0.5)
    wide, narrow = (accuracy.interval(errors[:n], bounds[:n]) for n in (12, 400))
    ratio = accuracy.root_mean_square(errors) / 0.5
    assert narrow[0] < ratio < narrow[1] and narrow[1] - narrow[0] < 0.5 * (wide[1] - wide[0])
    (told,) = accuracy.brief([accuracy.efficiency_row("1b", "default", [outcome(1), outcome(2)])])
    assert told["nodes / bound"] == "2.00 (2.00 to 2.00)" and not any("time" in key for key in told)


def test_outcomes_are_kept_by_scene_method_and_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def counted(job: tuple[Cell, int]) -> tuple[Cell, int, Outcome]:
        asked.append(job[1])
        if job[1] == 3 and len(asked) < 4:
            raise KeyboardInterrupt
        return *job, outcome(job[1])

    monkeypatch.setattr(cells, "run_one", counted)
    cell = Cell("default", (1, 2, 3), Scene(0.0))
    with pytest.raises(KeyboardInterrupt):
        cells.run_all([cell], tmp_path, workers=1)
    found = cells.run_all([cell], tmp_path, workers=1)
    assert asked == [1, 2, 3, 3] and [o.seed for o in found[cell]] == [1, 2, 3]
    others = [replace(cell, method="icpik"), replace(cell, scene=Scene(1.0)), replace(cell, points=5)]
    assert len({c.key(1) for c in (cell, *others)} | {cell.key(2)}) == 5
    before = cells.fingerprint()
    assert before != cells.fingerprint(("variants.py",))
    assert {"numpy", "osqp", "pin"} <= set(cells.versions())
    monkeypatch.setattr(cells, "versions", lambda: {"numpy": "0.1"})
    assert before != cells.fingerprint()


def test_the_models_cloud_is_as_large_as_the_scan_for_one_fit_only(monkeypatch: pytest.MonkeyPatch) -> None:
    from linear_ik import icpik

    seen: list[int] = []
    own = icpik.ModelCloud

    def noted(surface: object, lengths: object, points: int, seed: int) -> object:
        seen.append(points)
        return own(surface, lengths, points, seed)  # type: ignore[arg-type]

    monkeypatch.setattr(icpik, "ModelCloud", noted)
    monkeypatch.setattr(icpik, "MOST_ITERATIONS", 1)
    before = icpik.MODEL_POINTS
    cells.run_one((Cell("icpik", (1,), Scene(0.0, points=300)), 1))
    cells.run_one((Cell("model points 3000", (1,), Scene(0.0, points=300)), 1))
    assert seen == [300, 3000] and before == icpik.MODEL_POINTS


# Variants -------------------------------------------------------------------------------


def test_variants_change_what_exists() -> None:
    every = variants.all_variants()
    made = variants.default_variants() + variants.pairing_variants() + variants.icpik_variants()
    assert len(every) == len(made) > 40
    for variant in made:
        FitSettings(**variant.run.settings)  # type: ignore[attr-defined]
        if isinstance(variant.run, variants.Changed):
            with patched(*variant.run.changes):
                pass


def test_variants_of_icpik_say_what_is_ours_and_are_known_by_what_does_not_change() -> None:
    from linear_ik import icpik

    titles = {v.name: v.title for v in variants.icpik_variants()}
    weights = FitSettings(method="icpik").weights
    assert titles["Q 0.1"] == f"Q 0.1 (ours {weights.continuity:g})"
    assert titles["largest step, rad 0.1"].endswith(f"(ours {FitSettings().max_step_rad:g})")
    with patched((icpik, "MODEL_POINTS", 77)):
        assert [v.name for v in variants.icpik_variants()] == list(titles)
    asked = (
        "exponent",
        "segment weight by",
        "damping eased",
        "damping hardened",
        "floor",
        "largest step",
        "twist",
        "seed",
    )
    assert all(any(word in name for name in titles) for word in asked)
    assert min(g.seeds for g in ablation.groups(quick=False)) >= 5


def test_variants_of_the_terms_are_what_they_say() -> None:
    from linear_ik import descent
    from linear_ik.chain import BASE
    from linear_ik.problem import Problem

    case = named("1a")
    problem = Problem.of(case.element, case.scan(1, 500))
    x = problem.designed.copy()
    x[BASE:] = np.random.default_rng(0).uniform(-0.1, 0.1, len(x) - BASE)
    weights = FitSettings(method="icpik", continuity=0.5, directional=0.0).weights
    pulling = variants.pulling_angles(descent.shape_damping)(x, 1.0, weights)
    angles = x[BASE + 3 :].reshape(-1, 3)
    bent = np.diff(angles, axis=0)
    assert x @ pulling.H @ x == pytest.approx(0.5 * np.sum(bent**2))
    np.testing.assert_allclose(pulling.c, pulling.H @ x, atol=1e-12)
    twist = np.zeros(len(x))
    twist[BASE::3] = 1.0
    assert twist @ variants.bends_only(x, 1.0).H @ twist == 0.0
    damping = variants.bounded_damping(least=1e-3)(2e-3)
    assert damping.after(True).after(True).weight == 1e-3 and damping.most == 1e3


def test_points_out_of_reach_are_refused_by_the_gate_on_normals() -> None:
    from linear_ik.problem import Problem

    case = named("1a")
    scan = case.scan(1, 300)
    far = replace(scan, points=scan.points + np.where(np.arange(300) < 5, 50.0, 0.0)[:, None])
    with pytest.raises(ValueError, match="beyond the element's reach"):
        pairings.gated(Problem.of(case.element, far), far)


@pytest.mark.parametrize(
    ("name", "worst_mm"),
    [
        ("scan to surface, point to plane", 1.0),
        ("the same, gate on true normals (an oracle)", 1.0),
        ("model to scan, point to plane", 1.5),
        ("model to scan, point to point, geometric features", 40.0),
    ],
)
def test_pairings_fit_a_small_bend(name: str, worst_mm: float) -> None:
    case = named("1a")
    scan = case.scan(1, 2_000)
    with patched((pairings, "MODEL_POINTS", 2_000)):
        found = variants.all_variants()[name].run(case.element, scan)
    assert 1e3 * np.linalg.norm(found.nodes_m - scan.nodes_m, axis=1).max() < worst_mm
    assert found.iterations > 5 and found.time_s > 0


# Pictures and tables --------------------------------------------------------------------


@pytest.mark.parametrize("case", [TABLE_1[1], TABLE_1[5], TABLE_1[8]], ids=lambda case: case.name)
def test_faces_lie_where_the_scan_does(case: object) -> None:
    assert hasattr(case, "scan")
    scan = case.scan(1, 3_000, noise_m=0.0)
    quads = figures.faces(case.element, figures.Bent(scan.q, scan.base_pose))  # type: ignore[attr-defined]
    corners = quads.reshape(-1, 3)
    assert np.abs(corners.min(axis=0) - scan.points.min(axis=0)).max() < 0.02
    assert np.abs(corners.max(axis=0) - scan.points.max(axis=0)).max() < 0.02
    outward = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    assert (np.linalg.norm(outward, axis=1) > 0).all()


def test_the_reader_sees_depth_right_and_up_at_right_angles() -> None:
    xy, depth = figures.seen(np.eye(3))
    view = np.column_stack([xy, depth])
    assert view @ view.T == pytest.approx(np.eye(3))
    assert xy[2, 1] > 0.9


def test_pictures_are_the_same_every_time(tmp_path: Path) -> None:
    curves = [figures.Curves("1b", "1", m, [9.0, 8.0], [5.0, 1.0], [0.0, 0.2, 0.3], 7.9) for m in ("grid", "icpik")]
    share = {"default": np.array([[1.0, 0.5]]), "icpik": np.array([[0.0, np.nan]])}
    one = maps.SuccessMap("noise", "deg", ["0", "45"], "mm", ["1"], share, np.array([[True, False]]))
    for again in ("a", "b"):
        figures.draw_rmse(tmp_path / again / "rmse", curves, {"1": (3.0, 6.0)})
        figures.draw_nodes(tmp_path / again / "nodes", curves[1:], {"1b": 15.0})
        maps.draw_maps(tmp_path / again / "maps", [one])
        maps.draw_efficiency(tmp_path / again / "bound", ["1b"], {"default": [np.array([0.1, 0.2])]}, [0.1], "tip")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 8


def test_numbers_are_shown_with_three_digits() -> None:
    shown = [reports.shown(v) for v in (0.12345, 12.345, 1234.5, 7, math.nan, None, "a|b", 0.0, True)]
    assert shown == ["0.123", "12.3", "1234", "7", "-", "-", "a\\|b", "0.0", "True"]


def test_table_in_three_formats(tmp_path: Path) -> None:
    rows = [{"case": "1a", "mm": 0.5, "n": 3}, {"case": "1b", "mm": math.nan, "n": 4}]
    written = reports.write_table(tmp_path / "t", rows, ["a note"], points=10)
    assert written[0].read_text().splitlines()[:3] == ["| case | mm | n |", "|---|---:|---:|", "| 1a | 0.500 | 3 |"]
    assert written[0].read_text().endswith("- a note\n")
    assert written[1].read_text() == "case,mm,n\n1a,0.5,3\n1b,,4\n"
    told = json.loads(written[2].read_text())
    assert told["rows"][1]["mm"] is None and told["points"] == 10 and told["machine"]["numpy"]


def test_a_place_in_a_document_is_filled_in(tmp_path: Path) -> None:
    document = tmp_path / "a.md"
    document.write_text("before\n<!-- t -->\nold\n<!-- /t -->\nafter\n")
    reports.fill_in(document, "t", "new\n")
    assert document.read_text() == "before\n<!-- t -->\n\nnew\n\n<!-- /t -->\nafter\n"
    with pytest.raises(ValueError, match="no <!-- u -->"):
        reports.fill_in(document, "u", "new")
