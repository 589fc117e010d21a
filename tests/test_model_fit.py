"""The fit of a whole model: what is written, what is taken over, and what it does not hang on."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
from dataclasses import replace

import laspy
import numpy as np
import pytest
from site_samples import ABSENT, GUIDS, design, member, only, site

import linear_ik
from linear_ik.design_model import MapConversion, Member
from linear_ik.deviation import deviations
from linear_ik.element import Element, Placement
from linear_ik.errors import LinearIkError, OutputError, ScanError, SettingsError
from linear_ik.fit import not_scanned
from linear_ik.model_fit import ModelFitOptions, fit_model
from linear_ik.model_fit.fits import Row
from linear_ik.model_fit.folder import RunFolder
from linear_ik.model_fit.kept_results import file_stems, light
from linear_ik.model_fit.selection import select
from linear_ik.model_fit.table import line
from linear_ik.profile import Circle, Rectangle
from linear_ik.rigid import check_rigid
from linear_ik.scan import Scan

HERE = {"workers": 0}
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows (x, y, z) of points, times it: (x, z, -y)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return site(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def done(built, tmp_path_factory):
    """A run in this process, which tests look at and leave alone."""
    folder = tmp_path_factory.mktemp("asbuilt")
    said = {}

    def on_progress(stage, done, total, seconds):
        said[stage] = done, total

    found = fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE), on_progress=on_progress)
    assert said["colouring the scan"] == (8000, 8000)
    assert said["fitting"] == (5, 5)
    return found, folder


def table(folder):
    with (folder / "elements.csv").open(newline="", encoding="utf-8") as file:
        return {row["guid"]: row for row in csv.DictReader(file)}


def contents(folder):
    """All files of a run, without times and dates."""
    out = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_dir() or name.startswith("run_state"):
            continue
        if name == "run.json":
            report = json.loads(path.read_text())
            out[name] = {k: v for k, v in report.items() if k not in ("timings_s", "where")}
        elif path.suffix == ".json":
            out[name] = {k: v for k, v in json.loads(path.read_text()).items() if k != "timings_s"}
        elif path.suffix != ".laz":  # its header carries the date
            out[name] = path.read_bytes()
    return out


def test_every_member_is_fitted_to_its_own_points(built, done):
    found, folder = done
    assert found.counts == {"converged": 4, "not_scanned": 1}
    assert found.fitted == 4
    for guid, nodes in built.truth.items():
        result = linear_ik.read_result(folder / "elements" / f"{guid}.json")
        assert result.status == "converged", result.reasons
        error = result.nodes_m - nodes
        axis = result.element.placement.T_world_element[:3, 2]
        assert np.abs(error - np.outer(error @ axis, axis)).max() < 1e-3


def test_what_is_not_scanned_is_written_and_says_so(done):
    _, folder = done
    result = linear_ik.read_result(folder / "elements" / f"{ABSENT}.json")
    assert result.status == "not_scanned"
    assert result.reasons == ("the element is not in the scan: no points within 200 mm of its designed surface",)
    row = table(folder)[ABSENT]
    assert (row["status"], row["points"], row["matched_points"], row["max_offset_mm"]) == ("not_scanned", "0", "0", "")


def test_the_table_has_a_line_an_element_in_the_designs_order(built, done):
    found, folder = done
    rows = table(folder)
    assert list(rows) == [m.guid for m in built.design.members]
    column = rows[GUIDS[0]]
    assert (column["ifc_class"], column["tag"], column["length_m"]) == ("IfcColumn", "T0", "2.0000")
    assert 0 < float(column["max_offset_band95_mm"]) < 3
    assert int(column["matched_points"]) > 1200
    nodes = built.truth[GUIDS[0]]
    start = np.hypot(*nodes[0, :2])
    assert float(column["start_offset_mm"]) == pytest.approx(1e3 * start, abs=1.0)
    plumb = np.hypot(*(nodes[-1] - nodes[0])[:2])
    assert float(column["out_of_plumb_mm"]) == pytest.approx(1e3 * plumb, abs=1.0)
    assert column["sag_mm"] == ""  # of a column
    assert json.loads((folder / column["file"]).read_text())["guid"] == GUIDS[0]
    assert rows[GUIDS[1]]["sag_mm"] != ""


def test_the_scan_is_coloured_by_its_distance_from_the_design(built, done):
    _, folder = done
    with laspy.open(folder / "deviation.laz") as file:
        las = file.read()
    xyz = np.column_stack([las.x, las.y, las.z])
    element, deviation = np.asarray(las.element), np.asarray(las.deviation_m)
    assert set(np.unique(element)) == {1, 2, 3, 4}
    assert 5700 < len(xyz) <= 6100  # all four members, without the floor
    pipe = element == 3
    nodes = built.truth[GUIDS[2]]
    axis = np.column_stack([np.interp(xyz[pipe, 0], nodes[:, 0], nodes[:, i]) for i in (1, 2)])
    radius = np.linalg.norm(xyz[pipe, 1:] - axis, axis=1)
    outwards = (xyz[pipe, 1:] - axis) / radius[:, None]
    expected = np.einsum("pi,pi->p", axis - 1.0, outwards) + radius - 0.05
    assert np.abs(expected - deviation[pipe]).max() < 1e-3
    assert np.abs(deviation[pipe]).max() > 0.01
    red, blue = np.asarray(las.red), np.asarray(las.blue)
    assert (red[deviation > 0.005] > blue[deviation > 0.005]).all()
    assert (red[deviation < -0.005] < blue[deviation < -0.005]).all()
    scan = linear_ik.read_scan(folder / "deviation.ply")
    assert np.abs(np.sort(scan.points, axis=0) - np.sort(xyz, axis=0)).max() < 1e-4
    head = (folder / "deviation.ply").read_bytes()[:800]
    assert b"property float scalar_deviation_m" in head
    assert b"blue -0.02 m, grey 0, red +0.02 m" in head


def test_the_report_says_how_it_came_about(built, done):
    _, folder = done
    report = json.loads((folder / "run.json").read_text())
    assert report["counts"] == {"elements": 5, "converged": 4, "not_scanned": 1}
    assert report["coordinates"] == "the model's; as the scan's"
    assert report["left_out"][0]["reason"] == "it is not slender"
    assert report["scan_points"]["points"] == 8000
    assert report["options"]["max_points"] == 100_000
    assert "total" in report["timings_s"]


def test_nothing_is_left_but_what_is_said(done):
    found, folder = done
    names = {p.name for p in folder.iterdir()}
    assert names == {"elements", "run_state", *found.files}
    assert not (folder / "run_state" / "points").exists()
    assert not list(folder.rglob(".linear_ik-*"))


def test_a_second_run_fits_nothing_again(built, done, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    times = {p: p.stat().st_mtime_ns for p in (folder / "elements").iterdir()}
    stages = set()
    fit_model(
        built.design, [built.scan], folder, options=ModelFitOptions(**HERE), on_progress=lambda *a: stages.add(a[0])
    )
    assert {p: p.stat().st_mtime_ns for p in (folder / "elements").iterdir()} == times
    assert stages == {"reading the design"}
    assert contents(folder) == contents(done[1])


def test_a_note_of_the_design_is_said_once_whatever_its_words(built, done, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    model = replace(built.design, notes=("deviation.dwg is not looked at",))
    for _ in range(2):
        found = fit_model(model, [built.scan], folder, options=ModelFitOptions(**HERE))
        assert found.notes == model.notes


@pytest.mark.parametrize("what", ["design", "settings", "scan", "max_points"])
def test_what_has_changed_is_fitted_again(built, done, tmp_path, what):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    model, settings, options, scan = only(built.design, GUIDS[2]), None, HERE, built.scan
    if what == "design":
        pipe = model.members[0]
        longer = replace(pipe, element=replace(pipe.element, segments=5))
        model = replace(model, members=(longer,))
    elif what == "settings":
        settings = linear_ik.FitSettings(seed=3)
    elif what == "scan":
        scan = shutil.copy(scan, tmp_path / "other.ply")
    else:
        options = {**HERE, "max_points": 1000}
    before = (folder / "elements" / f"{GUIDS[2]}.json").read_bytes()
    other = (folder / "elements" / f"{GUIDS[0]}.json").read_bytes()
    fit_model(model, [scan], folder, settings, ModelFitOptions(**options))
    assert (folder / "elements" / f"{GUIDS[2]}.json").read_bytes() != before
    assert (folder / "run_state" / "other" / f"{GUIDS[0]}.json").read_bytes() == other


def test_a_result_that_somebody_changed_or_removed_is_made_again(built, done, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    (folder / "elements" / f"{GUIDS[0]}.json").unlink()
    with (folder / "elements" / f"{GUIDS[1]}.json").open("a") as file:
        file.write(" ")
    fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE))
    assert contents(folder) == contents(done[1])


def test_results_of_elements_that_are_not_asked_for_wait_elsewhere(built, done, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    one = ModelFitOptions(**HERE, only=[ABSENT])
    found = fit_model(built.design, [built.scan], folder, options=one)
    assert found.counts == {"not_scanned": 1}
    assert [p.stem for p in (folder / "elements").iterdir()] == [ABSENT]
    with (folder / "run_state" / "other" / f"{GUIDS[2]}.json").open("a") as file:
        file.write(" ")
    stages = {}
    found = fit_model(
        built.design,
        [built.scan],
        folder,
        options=ModelFitOptions(**HERE),
        on_progress=lambda stage, done, total, seconds: stages.update({stage: total}),
    )
    assert contents(folder) == contents(done[1])
    assert stages["fitting"] == 1, "only the one that somebody changed"
    assert list((folder / "run_state" / "other").iterdir()) == []


def test_an_element_whose_rival_is_gone_has_its_first_fit_again(tmp_path):
    sizes = {"A" * 22: 0.0, "B" * 22: 0.1}
    a, b = (member(guid, "IfcBeam", Rectangle(0.1, 0.1), 1.0, (x, 0, 0), (0, 0, 1)) for guid, x in sizes.items())
    linear_ik.write_scan(Scan(linear_ik.simulate(a.element, points=800, seed=1).points), tmp_path / "scan.ply")
    both = replace(design(), members=(a, b), obstacles=())

    def run(model, **options):
        folder = tmp_path / "out"
        found = fit_model(model, [tmp_path / "scan.ply"], folder, options=ModelFitOptions(**HERE, **options))
        for row in found.rows:
            written = linear_ik.read_result(folder / "elements" / f"{row.member.guid}.json")
            assert (written.status, written.reasons) == (row.result.status, row.result.reasons)
        return contents(folder)

    contested = run(both)
    # One of them twice, which is still one.
    assert json.loads((tmp_path / "out" / "run.json").read_text())["where"]["fitted_now"] == 2
    alone = run(replace(both, members=(b,)))
    name = f"elements/{b.guid}.json"
    assert alone[name]["status"] != contested[name]["status"] == "not_scanned"
    assert run(both) == contested
    assert run(both, contest=False)[name] == alone[name]
    assert run(both) == contested


def test_neither_workers_nor_the_order_of_the_design_change_a_result(built, done, tmp_path):
    turned = replace(built.design, members=built.design.members[3:1:-1])
    fit_model(turned, [built.scan], tmp_path, options=ModelFitOptions(workers=2))
    here, there = contents(tmp_path), contents(done[1])
    for guid in GUIDS[2:]:
        assert here[f"elements/{guid}.json"] == there[f"elements/{guid}.json"]
        assert table(tmp_path)[guid] == table(done[1])[guid]


def test_one_bad_element_never_stops_the_rest(built, tmp_path, monkeypatch):
    from linear_ik.model_fit import tasks

    real = tasks.fit

    def fit(element, scan, settings):
        if element.name == "column":
            raise ZeroDivisionError("of a kind\nnobody thought of")
        return real(element, scan, settings)

    monkeypatch.setattr(tasks, "fit", fit)
    model = only(built.design, GUIDS[0], GUIDS[2])
    found = fit_model(model, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert found.counts == {"failed": 1, "converged": 1}
    row = table(tmp_path)[GUIDS[0]]
    assert (row["status"], row["reasons"]) == ("failed", "ZeroDivisionError: of a kind nobody thought of")
    assert not (tmp_path / "elements" / f"{GUIDS[0]}.json").exists()
    monkeypatch.undo()
    again = fit_model(model, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert again.counts == {"converged": 2}


def test_a_contest_that_fails_leaves_the_first_fit_in_doubt(built, tmp_path, monkeypatch):
    """And tries again when the run is repeated."""
    from linear_ik.model_fit import tasks

    real = tasks._run

    def no_memory(task):
        if task.first is not None and task.guid == GUIDS[2]:
            raise MemoryError("of the second fit")
        return real(task)

    pipes, path = only(built.design, *GUIDS[2:]), tmp_path / "elements" / f"{GUIDS[2]}.json"
    with monkeypatch.context() as patch:
        patch.setattr(tasks, "_run", no_memory)
        found = fit_model(pipes, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert found.counts == {"uncertain": 1, "converged": 1}
    written, row = linear_ik.read_result(path), found.rows[0]
    for result in (written, row.result):
        assert (result.status, result.reason_codes) == ("uncertain", ("neighbours_not_settled",))
        assert "MemoryError: of the second fit" in result.reasons[0]
    assert written.configuration_covariance is not None
    assert table(tmp_path)[GUIDS[2]]["reason_codes"] == "neighbours_not_settled"
    stages = {}
    found = fit_model(
        pipes,
        [built.scan],
        tmp_path,
        options=ModelFitOptions(**HERE),
        on_progress=lambda stage, done, total, seconds: stages.update({stage: total}),
    )
    assert (stages.get("fitting"), stages["settling between neighbours"]) == (None, 1)
    assert found.counts == {"converged": 2}
    settled = linear_ik.read_result(path)
    assert (settled.status, settled.reason_codes) == ("converged", ())
    assert np.array_equal(settled.nodes_m, written.nodes_m)


def test_a_scan_of_something_else_finds_nothing(built, tmp_path):
    model = only(built.design, ABSENT)
    found = fit_model(model, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert found.fitted == 0
    assert not (tmp_path / "deviation.ply").exists()
    assert "deviation.ply" not in found.files


def test_points_without_coordinates_are_counted(built, tmp_path):
    model = only(built.design, ABSENT)
    points = linear_ik.read_scan(built.scan).points
    np.savetxt(tmp_path / "scan.xyz", np.insert(points, [0, 7, len(points)], np.nan, axis=0))
    for T in (None, np.eye(4)):
        found = fit_model(
            model, [tmp_path / "scan.xyz"], tmp_path / "out", options=ModelFitOptions(**HERE, T_model_scan=T)
        )
        report = json.loads((tmp_path / "out" / "run.json").read_text())
        assert "left out of the scan: 3 points without usable coordinates, withheld or noise" in found.notes
        assert report["scan_points"]["left_out"] == 3
        assert report["scan_points"]["points"] == len(points)


def test_a_scan_in_other_coordinates_is_moved_into_the_models(built, done, tmp_path):
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    T[:3, 3] = (-500000.0, 5400000.0, 30.0)
    points = linear_ik.read_scan(built.scan).points
    linear_ik.write_scan(linear_ik.Scan((points - T[:3, 3]) @ T[:3, :3]), tmp_path / "map.ply")
    folder = tmp_path / "asbuilt"
    model = only(built.design, GUIDS[2])
    fit_model(model, [tmp_path / "map.ply"], folder, options=ModelFitOptions(**HERE, T_model_scan=T))
    result = linear_ik.read_result(folder / "elements" / f"{GUIDS[2]}.json")
    assert np.abs(result.nodes_m - built.truth[GUIDS[2]])[:, 1:].max() < 1e-3
    report = json.loads((folder / "run.json").read_text())
    assert report["T_model_scan"] == T.tolist()
    assert report["coordinates"] == "the model's; T_model_scan was used"


def test_a_scan_in_the_maps_coordinates(built, tmp_path):
    T = np.eye(4)
    T[:3, :3] = 0.9996 * np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    T[:3, 3] = (500000.0, 5400000.0, 100.0)
    points = linear_ik.read_scan(built.scan).points
    linear_ik.write_scan(linear_ik.Scan(points @ T[:3, :3].T + T[:3, 3]), tmp_path / "map.ply")
    model = replace(only(built.design, GUIDS[2]), map_conversion=MapConversion(T, "EPSG:25832"))
    found = fit_model(model, [tmp_path / "map.ply"], tmp_path / "a", options=ModelFitOptions(**HERE))
    assert found.notes == ("no point is near an element: the scan seems to be in the map's coordinates (--map)",)
    fit_model(model, [tmp_path / "map.ply"], tmp_path / "b", options=ModelFitOptions(**HERE, map_coordinates=True))
    result = linear_ik.read_result(tmp_path / "b" / "elements" / f"{GUIDS[2]}.json")
    assert np.abs(result.nodes_m - built.truth[GUIDS[2]])[:, 1:].max() < 1e-3
    with pytest.raises(SettingsError, match="no map conversion"):
        fit_model(built.design, [built.scan], tmp_path / "c", options=ModelFitOptions(**HERE, map_coordinates=True))


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (1000.0, ": the scan seems to be in millimetres (--scan-unit mm)"),
        (1.0, ", though the scan is about where the design is (linear-ik align lays it on)"),
        (None, ": the scan and the design are 860.7 m apart (--transform; see linear-ik align)"),
    ],
)
def test_a_scan_elsewhere_is_told_why(built, tmp_path, change, hint):
    points = linear_ik.read_scan(built.scan).points
    moved = points + 500.0 if change is None else points * change
    linear_ik.write_scan(linear_ik.Scan(moved), tmp_path / "scan.ply")
    pipe = only(built.design, GUIDS[2]).members[0]
    if change == 1.0:
        placement = Placement((0.5, 1.0, 1.6), (1, 0, 0))
        pipe = replace(pipe, element=replace(pipe.element, placement=placement))
    model = replace(design(), members=(pipe,))
    # Unless the person has said the unit, millimetres are refused.
    options = ModelFitOptions(**HERE, scan_unit="m")
    found = fit_model(model, [tmp_path / "scan.ply"], tmp_path / "out", options=options)
    assert found.fitted == 0
    assert found.notes == (f"no point is near an element{hint}",)


def test_stations_reach_the_fit(built, tmp_path, monkeypatch):
    import pye57

    from linear_ik.model_fit import tasks

    places = np.array([[1.0, -3.0, 1.0], [1.0, 5.0, 2.0]])
    points = linear_ik.read_scan(built.scan).points
    with pye57.E57(str(tmp_path / "scan.e57"), mode="w") as file:
        for place, side in zip(places, (points[:, 1] < 1.0, points[:, 1] >= 1.0), strict=True):
            columns = (points[side] - place).T
            data = {f"cartesian{a}": np.ascontiguousarray(c) for a, c in zip("XYZ", columns, strict=True)}
            file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=place)
    seen, real = [], tasks.fit

    def fit(element, scan, settings):
        seen.append(scan)
        return real(element, scan, settings)

    monkeypatch.setattr(tasks, "fit", fit)
    model = only(built.design, GUIDS[2])
    fit_model(model, [tmp_path / "scan.e57"], tmp_path / "out", options=ModelFitOptions(**HERE))
    assert np.allclose(seen[0].stations, places)
    assert np.array_equal(seen[0].station_index, seen[0].points[:, 1] >= 1.0)


def test_points_of_unknown_stations_among_others_are_said(built, tmp_path):
    points = linear_ik.read_scan(built.scan).points
    near = np.abs(points - [1.2, 1.0, 1.0]).max(axis=1) < 0.4  # on the two pipes
    write_ptx(tmp_path / "a.ptx", points[~near])
    model = only(built.design, GUIDS[0], ABSENT)
    options = ModelFitOptions(**HERE, contest=False, max_points=1000, segments=2)
    np.savetxt(tmp_path / "far.pts", points[near])
    found = fit_model(model, [tmp_path / "a.ptx", tmp_path / "far.pts"], tmp_path / "out", options=options)
    assert not any("stations" in note for note in found.notes)
    np.savetxt(tmp_path / "near.pts", points[points[:, 2] > 0.5][:50])
    for _ in range(2):  # the second takes all over
        found = fit_model(model, [tmp_path / "a.ptx", tmp_path / "near.pts"], tmp_path / "out", options=options)
        assert "1 element has points of unknown stations among others: there no station was used" in found.notes
    report = json.loads((tmp_path / "out" / "run.json").read_text())
    assert report["scan_points"]["elements_with_mixed_stations"] == 1


def write_ptx(path, points):
    header = [f"{len(points)}\n1", "1 -3 1", "1 0 0\n0 1 0\n0 0 1", "1 0 0 0\n0 1 0 0\n0 0 1 0\n1 -3 1 1"]
    rows = "\n".join(" ".join(f"{v:.6f}" for v in p) + " 0.5" for p in points - [1, -3, 1])
    path.write_text("\n".join([*header, rows]) + "\n")


def test_a_selection_by_class_and_guid(built, tmp_path):
    chosen = ModelFitOptions(**HERE, classes=["ifcpipesegment"], only=[GUIDS[3], GUIDS[0]], segments=3)
    found = fit_model(built.design, [built.scan], tmp_path, options=chosen)
    assert [row.member.guid for row in found.rows] == [GUIDS[3]]
    assert found.rows[0].result.element.segments == 3


def test_an_element_is_named_by_its_tag_or_its_name_where_only_one_has_it():
    model = design()
    tags, names = ("C1", "C2", "B", "B", ""), ("HEA200", "HEA200", "IPE300", "purlin", "C2")
    named = [replace(m, tag=t, name=n) for m, t, n in zip(model.members, tags, names, strict=True)]
    model = replace(model, members=tuple(named))
    chosen, _ = select(model, ModelFitOptions(only=["C2", "purlin", GUIDS[0]]))
    assert [m.guid for m in chosen] == [GUIDS[0], GUIDS[1], GUIDS[3]]
    with pytest.raises(SettingsError, match=re.escape(f"B is the tag of 2 elements (one of {GUIDS[2]}, {GUIDS[3]})")):
        select(model, ModelFitOptions(only=["B"]))
    with pytest.raises(SettingsError, match="HEA200 is the name of 2 elements"):
        select(model, ModelFitOptions(only=["HEA200"]))


def test_a_class_is_also_that_of_its_standard_case():
    model = design()
    kinds = ("IfcBeamStandardCase", "IfcBeam", "IfcColumnStandardCase", "IfcColumn", "IfcMember")
    model = replace(model, members=tuple(replace(m, ifc_class=k) for m, k in zip(model.members, kinds, strict=True)))
    for name in ("IfcBeam", "ifcbeamstandardcase"):
        chosen, _ = select(model, ModelFitOptions(classes=[name]))
        assert [m.ifc_class for m in chosen] == list(kinds[:2])


def test_wrong_choices_name_the_right_ones(built, tmp_path):
    folder = tmp_path / "none"
    cases = [
        ({"only": [GUIDS[0][:-1]]}, f"only: {GUIDS[0][:-1]} is not in the design ({GUIDS[0]}?)"),
        ({"only": ["nobody"]}, "nobody is not in the design (a GlobalId, tag or name of one of its linear elements)"),
        ({"only": ["5plate00000000000000$_"]}, "is not fitted: it is not slender"),
        ({"classes": ["IfcSlab"]}, "IfcBeam, IfcColumn, IfcMember, IfcPipeSegment"),
        ({"only": [GUIDS[0]], "classes": ["IfcBeam"]}, "no element is in both"),
    ]
    for change, text in cases:
        with pytest.raises(LinearIkError) as caught:
            fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE, **change))
        assert text in str(caught.value)
    for name, value in (("workers", -1), ("max_points", 5), ("memory_mb", 1), ("reach_m", -1), ("segments", 0)):
        with pytest.raises(SettingsError, match=name):
            ModelFitOptions(**{name: value})
    assert not folder.exists()


def test_numbers_of_numpy_are_numbers(built, tmp_path):
    options = ModelFitOptions(
        workers=np.int64(0), max_points=np.int32(5000), segments=np.int64(4), reach_m=np.float32(0.25),
        legend_m=np.float16(0.5), contest=np.True_,
    )  # fmt: skip
    settings = linear_ik.FitSettings(seed=np.int64(3), max_step_rad=np.float32(0.25))
    fit_model(only(built.design, ABSENT), [built.scan], tmp_path, settings, options)
    report = json.loads((tmp_path / "run.json").read_text())
    chosen = [report["options"][name] for name in ("max_points", "segments", "reach_m", "legend_m", "contest")]
    assert chosen == [5000, 4, 0.25, 0.5, True]
    assert (report["settings"]["seed"], report["settings"]["max_step_rad"]) == (3, 0.25)
    with pytest.raises(SettingsError, match=r"contest: 'no' \(True or False\)"):
        ModelFitOptions(contest="no")


@pytest.mark.parametrize(
    "wrong", [np.ones((4, 4)), np.eye(3), [[1]], "x", np.diag([2.0, 2, 2, 1]), np.full((4, 4), np.nan)]
)
def test_a_transform_that_is_none(wrong):
    with pytest.raises(SettingsError, match="T"):
        check_rigid("T", wrong)


def test_a_transform_of_few_digits_becomes_a_rotation():
    c, s = np.cos(0.3), np.sin(0.3)
    T = check_rigid("T", np.round([[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], 6))
    assert np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("there", [".", "deep", "deep/asbuilt", "deep/asbuilt/elements"])
def test_bad_scans_leave_nothing(built, tmp_path, there):
    folder = tmp_path / "deep" / "asbuilt"
    (tmp_path / there).mkdir(parents=True, exist_ok=True)
    cut = tmp_path / "cut.ply"
    cut.write_bytes(built.scan.read_bytes()[:-1000])
    before = set(tmp_path.rglob("*"))
    with pytest.raises(ScanError, match="no such file"):
        fit_model(built.design, [tmp_path / "no.ply"], folder, options=ModelFitOptions(**HERE))
    with pytest.raises(ScanError, match="cut.ply"):
        fit_model(built.design, [built.scan, cut], folder, options=ModelFitOptions(**HERE))
    with pytest.raises(LinearIkError, match="at least one"):
        fit_model(built.design, [], folder, options=ModelFitOptions(**HERE))
    assert set(tmp_path.rglob("*")) == before


def test_ctrl_c_keeps_points_that_were_all_handed_out_and_no_others(built, tmp_path, monkeypatch):
    from linear_ik.model_fit.fits import Fits

    model, points = only(built.design, GUIDS[2]), tmp_path / "run_state" / "points"

    def stopped(*_):
        raise KeyboardInterrupt

    def run(on_progress=None):
        fit_model(model, [built.scan], tmp_path, options=ModelFitOptions(**HERE), on_progress=on_progress)

    with pytest.raises(KeyboardInterrupt):
        run(lambda stage, *_: stage == "handing out points" and stopped())
    assert not points.exists()
    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "keep_scan_extent", stopped)
        with pytest.raises(KeyboardInterrupt):
            run()
    assert (points / "complete.json").exists()
    with monkeypatch.context() as patch:
        patch.setattr(Fits, "first", stopped)
        stages = set()
        with pytest.raises(KeyboardInterrupt):
            run(lambda stage, *_: stages.add(stage))
    assert stages == {"reading the design"}, "the scan is not read again"
    noted = json.loads((points / "complete.json").read_text())
    wrong = [[], "complete", {**noted, "received": "all"}, {**noted, "stations": [1]}, {**noted, "extent": None}]
    for note in (*wrong, noted):
        (points / "complete.json").write_text(json.dumps(note))
        if note is noted:
            # As after a power cut.
            os.truncate(points / "0.points", (points / "0.points").stat().st_size - 1000)
        with monkeypatch.context() as patch:
            patch.setattr(Fits, "first", stopped)
            stages = set()
            with pytest.raises(KeyboardInterrupt):
                run(lambda stage, *_, stages=stages: stages.add(stage))
        assert "handing out points" in stages, note
        assert json.loads((points / "complete.json").read_text()) == noted


@pytest.mark.parametrize("said, to_scan", [("--scan-unit ft", np.eye(3) / 0.3048), ("y up instead of z", Y_UP)])
def test_a_scan_that_is_surely_in_other_coordinates_is_refused_before_the_fits(
    built, tmp_path, monkeypatch, said, to_scan
):
    from linear_ik.model_fit.fits import Fits

    class FitsBegan(Exception):
        pass

    def began(*_):
        raise FitsBegan

    monkeypatch.setattr(Fits, "first", began)
    scan = linear_ik.write_scan(
        linear_ik.Scan(linear_ik.read_scan(built.scan).points @ to_scan), tmp_path / "other.ply"
    )
    with pytest.raises(LinearIkError, match=f"other.ply: .*{said}"):
        fit_model(built.design, [scan], tmp_path / "run", options=ModelFitOptions(**HERE))
    assert not (tmp_path / "run").exists()
    # The person knows better; and a scan that is in its place is none the worse.
    with pytest.raises(FitsBegan):
        fit_model(built.design, [scan], tmp_path / "run", options=ModelFitOptions(**HERE, scan_unit="m"))
    with pytest.raises(FitsBegan):
        fit_model(built.design, [built.scan], tmp_path / "run", options=ModelFitOptions(**HERE))


def test_a_scan_that_is_clearly_in_its_place_is_not_looked_at_again(built, monkeypatch):
    """To look costs a sample of every surface of the design."""
    from linear_ik.model_fit.placing import check_place

    class Looked(Exception):
        pass

    def looked(*_):
        raise Looked

    monkeypatch.setattr("linear_ik.model_fit.placing.SiteCheck", looked)
    sample = linear_ik.read_scan(built.scan).points
    check_place(built.design, sample, {"points": 8000, "in_a_neighbourhood": 6000}, built.scan)
    with pytest.raises(Looked):
        check_place(built.design, sample, {"points": 8000, "in_a_neighbourhood": 2000}, built.scan)


def test_a_bad_scan_leaves_what_an_earlier_run_found(built, done, tmp_path):
    folder = shutil.copytree(done[1], tmp_path / "again", copy_function=shutil.copy2)
    cut = tmp_path / "cut.ply"
    cut.write_bytes(built.scan.read_bytes()[:-1000])
    with pytest.raises(ScanError):
        fit_model(built.design, [cut], folder, options=ModelFitOptions(**HERE))
    assert contents(folder) == contents(done[1])


@pytest.mark.parametrize("stage", ["handing out points", "colouring the scan"])
def test_a_scan_that_changes_while_it_is_read_is_refused(built, done, tmp_path, stage):
    folder = tmp_path / "asbuilt"
    if stage == "colouring the scan":
        shutil.copytree(done[1], folder, copy_function=shutil.copy2)
        (folder / "deviation.ply").unlink()
    at = built.scan.stat()

    def on_progress(now, *_):
        if now == stage:
            os.utime(built.scan, ns=(at.st_atime_ns, at.st_mtime_ns + 1_000_000))

    try:
        with pytest.raises(ScanError, match="it changed while it was read") as caught:
            fit_model(built.design, [built.scan], folder, options=ModelFitOptions(**HERE), on_progress=on_progress)
    finally:
        os.utime(built.scan, ns=(at.st_atime_ns, at.st_mtime_ns))
    assert caught.value.subject == str(built.scan)
    assert folder.exists() == (stage == "colouring the scan")
    assert not (folder / "deviation.ply").exists()


@pytest.mark.parametrize("name", ["asbuilt.ifc", "deviation.ply", "deviation.laz", "elements.csv", "run.json"])
def test_a_file_that_is_read_is_never_replaced(built, tmp_path, name):
    (tmp_path / name).write_bytes(b"mine")
    (tmp_path / "link").symlink_to(name)
    for design_path, scan in ((tmp_path / "link", built.scan), (built.design, tmp_path / name)):
        with pytest.raises(OutputError, match="is one of the files that are read"):
            fit_model(design_path, [scan], tmp_path, options=ModelFitOptions(**HERE))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {name: b"mine", "link": b"mine"}


def test_a_file_in_the_folders_place(built, tmp_path):
    (tmp_path / "asbuilt").write_text("mine")
    with pytest.raises(OutputError):
        fit_model(built.design, [built.scan], tmp_path / "asbuilt", options=ModelFitOptions(**HERE))
    assert (tmp_path / "asbuilt").read_text() == "mine"


def test_what_a_killed_run_was_writing_is_swept_away(tmp_path):
    folder = RunFolder(tmp_path, [])
    folder.make()
    folder.release()
    parts = [
        tmp_path / f / ".linear_ik-0123456789abcdef.tmp" for f in (".", "elements", "run_state", "run_state/first")
    ]
    for path in (*parts, tmp_path / "mine.tmp"):
        path.write_text("")
    folder.make()
    assert not any(path.exists() for path in parts)
    assert (tmp_path / "mine.tmp").exists()


def test_an_element_without_a_chord_has_no_figures_against_it():
    t = np.linspace(0, 2 * np.pi, 61)
    axis = np.column_stack([1 - np.cos(t), 0 * t, np.sin(t)])
    axis[-1] = 0.0
    length = float(np.linalg.norm(np.diff(axis, axis=0), axis=1).sum())
    ring = Element("ring", Circle(0.05), length, 12, axis_points=tuple(map(tuple, axis)))
    result = replace(not_scanned(ring, ""), status="converged")
    with pytest.raises(LinearIkError):
        deviations(result)
    values = line(Row(Member("g", "IfcPipeSegment", "", "", "", ring), result, "", {}, "elements/g.json"))
    assert values["max_offset_mm"] == "0.000"
    assert "bow_mm" not in values
    assert values["file"] == "elements/g.json"


def test_the_table_has_a_measured_length_beside_the_designed_one(done):
    found, folder = done
    assert {row["measured_length_m"] for row in table(folder).values()} == {""}, "lengths were taken as known"
    row = found.rows[0]
    loose = replace(row.result.element, length_tolerance_m=0.03)
    values = line(replace(row, result=replace(row.result, element=loose, length_m=2.0123, length_sd_m=0.0005)))
    assert (values["length_m"], values["measured_length_m"]) == ("2.0000", "2.0123")
    assert values["measured_length_band95_mm"] == "0.980"


def test_joint_covariances_are_in_the_files_alone_and_the_table_knows_them(done):
    found, folder = done
    assert all(row.result.configuration_covariance is None for row in found.rows), "1,000 long members: 0.7 GB"
    whole = linear_ik.read_result(folder / "elements" / f"{GUIDS[1]}.json")
    bands = [f"{1e3 * deviations(result).bow_m.band:.3f}" for result in (whole, light(whole))]
    assert table(folder)[GUIDS[1]]["bow_band95_mm"] == bands[0] != bands[1]


def test_files_are_named_as_every_file_system_takes_it():
    stems = file_stems(["0Ab$_", "0aB$_", "../evil", "a/b", "", "0ab$_", "x" * 100, "0ac$_"])
    assert stems["0ac$_"] == "0ac$_"
    assert file_stems(["0ab$_", "0aB$_"]) == {guid: stems[guid] for guid in ("0ab$_", "0aB$_")}
    assert len({s.lower() for s in stems.values()}) == len(stems)
    assert all(
        s and set(s) <= set("0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$-") for s in stems.values()
    )
    assert all(len(s) <= 64 for s in stems.values())


def test_an_element_far_from_the_origin_keeps_its_digits(built, tmp_path):
    offset = np.array([500000.0, 5400000.0, 100.0])
    pipe = only(built.design, GUIDS[2]).members[0]
    here = pipe.element.placement
    there = Placement(tuple(here.location + offset), here.axis, here.ref_direction)
    moved = replace(pipe, element=replace(pipe.element, placement=there))
    points = linear_ik.read_scan(built.scan).points
    linear_ik.write_scan(linear_ik.Scan(points + offset), tmp_path / "map.ply")
    model = replace(design(), members=(moved,), obstacles=())
    fit_model(model, [tmp_path / "map.ply"], tmp_path / "out", options=ModelFitOptions(**HERE))
    result = linear_ik.read_result(tmp_path / "out" / "elements" / f"{GUIDS[2]}.json")
    assert np.abs(result.nodes_m - offset - built.truth[GUIDS[2]])[:, 1:].max() < 1e-3
