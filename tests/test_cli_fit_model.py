"""`linear-ik fit` of a design model."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command import run

import linear_ik
from linear_ik.cli import main
from linear_ik.cli.fit_model import _Talk, read_transform, summary
from linear_ik.errors import LinearIkError

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))
pytest.importorskip("ifcopenshell")

from benchlib.building import building  # noqa: E402
from benchlib.building_bench import error_of  # noqa: E402
from benchlib.building_ifc import write_ifc  # noqa: E402
from benchlib.building_scan import scan_building  # noqa: E402


@pytest.fixture(scope="module")
def frame(tmp_path_factory):
    """A frame of one bay with a pipe, as IFC and as a LAZ scan."""
    folder = tmp_path_factory.mktemp("frame")
    plan = building(1, 1, 1, pipes=1, seed=3)
    write_ifc(plan, folder / "design.ifc")
    places = np.array([[2.0, 1.8, 1.7], [4.5, 3.9, 1.5], [4.0, -2.0, 1.6]])
    scan_building(plan, places, 120_000, folder / "site.laz")
    return plan, folder


@pytest.fixture(scope="module")
def fitted(frame, tmp_path_factory):
    """The pipe and a beam of it, by the command."""
    plan, folder = frame
    chosen = [
        next(m.guid for m in plan.design.members if m.ifc_class == kind) for kind in ("IfcBeam", "IfcPipeSegment")
    ]
    out = tmp_path_factory.mktemp("out") / "new" / "asbuilt"
    few = ["--only", ",".join(chosen), "--segments", 6]
    done = run("fit", folder / "design.ifc", folder / "site.laz", "-o", out, *few, "--workers", 1)
    return done, out, chosen


def test_a_model_and_a_scan_become_a_folder(frame, fitted):
    plan, _ = frame
    done, out, chosen = fitted
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert {p.name for p in out.iterdir()} == {
        "elements",
        "elements.csv",
        "deviation.ply",
        "deviation.laz",
        "asbuilt.ifc",
        "run.json",
        "run_state",
    }
    assert {p.stem for p in (out / "elements").iterdir()} == set(chosen)
    for guid in chosen:
        result = linear_ik.read_result(out / "elements" / f"{guid}.json")
        assert error_of(result, plan.built[guid]).across_m < 2e-3, result.reasons
    with (out / "elements.csv").open(newline="") as file:
        assert {row["guid"] for row in csv.DictReader(file)} == set(chosen)


def test_the_as_built_model_keeps_its_identities(frame, fitted):
    import ifcopenshell

    plan, _ = frame
    model = ifcopenshell.open(str(fitted[1] / "asbuilt.ifc"))
    assert {p.GlobalId for p in model.by_type("IfcColumn")} == {
        m.guid for m in plan.design.members if m.ifc_class == "IfcColumn"
    }
    assert model.by_guid(fitted[2][1]).is_a("IfcPipeSegment")


def test_a_design_of_the_same_name_elsewhere_is_refused(frame, fitted, tmp_path, capsys):
    _, folder = frame
    other = tmp_path / "design.ifc"
    other.write_bytes((folder / "design.ifc").read_bytes())
    assert main(["fit", str(other), str(folder / "site.laz"), "-o", str(fitted[1]), "--workers", "1"]) == 2
    assert f"is of a run with {(folder / 'design.ifc').resolve()}, and would be replaced" in capsys.readouterr().err


def test_a_second_run_in_the_same_folder_is_refused_with_one_line(frame, fitted, capsys):
    from linear_ik.model_fit.folder import RunFolder

    _, folder = frame
    first = RunFolder(fitted[1], [])
    first.make()
    try:
        assert main(["fit", f"{folder}/design.ifc", f"{folder}/site.laz", "-o", f"{fitted[1]}", "--workers", "1"]) == 2
    finally:
        first.release()
    assert capsys.readouterr() == ("", f"error: {fitted[1]}: another run is at work in it (another folder, or wait)\n")


def test_the_person_is_told_what_was_found(fitted):
    lines = fitted[0].stderr.splitlines()
    assert lines[-2].startswith("elements   ")
    assert lines[-1].startswith("written    ")
    assert "asbuilt.ifc" in lines[-1]


KEPT = "what is finished is kept: type the line again to go on\n"
# Long enough after a result for somebody to press Ctrl-C, however busy the machine.
PAUSING = """
import signal, time
# A shell that runs the tests in the background has it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
from linear_ik.model_fit.kept_results import KeptResults
keep = KeptResults.keep
def keep_and_pause(*what):
    keep(*what)
    time.sleep(60)
KeptResults.keep = keep_and_pause
from linear_ik.cli import main
main()
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["Ctrl-C", "kill"])
def test_ctrl_c_leaves_what_is_finished_and_nothing_half(frame, fitted, tmp_path, number, code):
    _, folder = frame
    out = tmp_path / "asbuilt"
    arguments = ["fit", folder / "design.ifc", folder / "site.laz", "-o", out, "--only", ",".join(fitted[2])]
    arguments += ["--segments", 6]
    process = subprocess.Popen(
        [sys.executable, "-c", PAUSING, *map(str, arguments), "--workers", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 100
    while not list((out / "elements").glob("[!.]*.json")) and time.monotonic() < deadline:
        time.sleep(0.01)
    if number == signal.SIGINT:
        # As a terminal does it: to every process of the command.
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout, stderr) == (code, "", KEPT + "interrupted\n")
    assert len(list((out / "elements").iterdir())) == 1
    assert not list(out.rglob(".linear_ik-*"))
    again = run(*arguments, "--workers", 1)
    assert again.returncode == 0, again.stderr
    for guid in fitted[2]:
        results = [json.loads((o / "elements" / f"{guid}.json").read_text()) for o in (out, fitted[1])]
        assert {**results[0], "timings_s": 0} == {**results[1], "timings_s": 0}


def test_a_disk_that_the_clouds_fill_costs_nothing_but_them(frame, fitted, tmp_path, monkeypatch, capsys):
    resource = pytest.importorskip("resource")
    import linear_ik.model_fit.run as of_run

    out, colour = shutil.copytree(fitted[1], tmp_path / "asbuilt", copy_function=shutil.copy2), of_run.colour_scan
    names = ("asbuilt.ifc", "elements.csv", "run.json")
    for name in (*names, "deviation.ply", "deviation.laz"):
        (out / name).unlink()
    arguments = ["fit", frame[1] / "design.ifc", frame[1] / "site.laz", "-o", out, "--only", ",".join(fitted[2])]
    arguments = [*map(str, arguments), "--segments", "6", "--workers", "1", "--quiet"]
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def on_a_full_disk(*given):
        # Python ignores the signal: whoever writes more than that gets an OSError, as of a full disk.
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))
        try:
            return colour(*given)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    for needs_laz in (False, True):
        with monkeypatch.context() as patch:
            patch.setattr(of_run, "colour_scan", on_a_full_disk)
            if needs_laz:
                patch.setattr("linear_ik.model_fit.colours.PlyCloud", FileOfNothing)
            assert main(arguments) == 2
        stdout, stderr = capsys.readouterr()
        assert (stdout, stderr.count("\n")) == ("", 1)
        assert stderr.startswith(f"error: {out / 'deviation.'}"), stderr
        assert "cannot be written: " in stderr
        assert {p.name for p in out.iterdir()} == {*names, "elements", "run_state"}
        assert json.loads((out / "run.json").read_text())["deviation"] == {}
    assert main(arguments) == 0
    assert (out / "deviation.ply").read_bytes() == (fitted[1] / "deviation.ply").read_bytes()
    assert json.loads((out / "run.json").read_text())["where"]["fitted_now"] == 0


class FileOfNothing:
    def __init__(self, path, *_):
        path.touch()

    def write(self, *_):
        pass

    close = write


def test_nothing_of_it_in_the_scan_is_exit_code_3(frame, tmp_path):
    _, folder = frame
    far = tmp_path / "far.ply"
    linear_ik.write_scan(linear_ik.Scan(np.random.default_rng(0).uniform(500, 510, (100, 3))), far)
    out = tmp_path / "out"
    done = run("fit", folder / "design.ifc", far, "-o", out, "--class", "IfcPipeSegment", "--workers", 1)
    assert done.returncode == 3, done.stderr
    report = json.loads((out / "run.json").read_text())
    assert report["counts"] == {"elements": 1, "not_scanned": 1}


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--only", ""], "error: --only: names no element (GlobalIds or tags, separated by commas)"),
        (["--only", " nobody, "], "error: --only: nobody is not in the design (a GlobalId, tag or name"),
        (
            ["--class", "IfcSlab"],
            "error: --class: IfcSlab is not a class of its linear elements (IfcBeam, IfcColumn, IfcPipeSegment)",
        ),
        (["--workers", "-2"], "error: --workers: -2 (a whole number from 1 to 1000)"),
        (["--workers", "0"], "error: --workers: 0 (a whole number from 1 to 1000)"),
        (["--memory", "1"], "error: --memory: 1.0 (a number from 16 to 1e+06)"),
        (["--urdf", "x.urdf"], "error: --urdf: is for one element (not with a design model)"),
        (["--inverse"], "error: --inverse: given without --transform (--transform T.txt)"),
        (["--range-noise", "-1"], "error: --range-noise: -1.0 (a number from 1e-06 to 1)"),
        (["--transform", "no.txt"], "error: no.txt: cannot be read: No such file or directory"),
    ],
)
def test_bad_options_are_one_line_and_nothing_is_written(frame, tmp_path, monkeypatch, capsys, more, line):
    _, folder = frame
    monkeypatch.chdir(tmp_path)
    assert main(["fit", f"{folder}/design.ifc", f"{folder}/site.laz", "-o", "out", *more]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(line)
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_nothing_that_is_read_is_written(frame, tmp_path, monkeypatch, capsys):
    _, folder = frame
    monkeypatch.chdir(tmp_path)
    os.mkdir("out")
    for name in ("asbuilt.ifc", "deviation.ply", "run.json"):
        Path("out", name).write_text("mine")
    for arguments in (
        ["out/asbuilt.ifc", f"{folder}/site.laz"],
        [f"{folder}/design.ifc", "out/deviation.ply"],
        [f"{folder}/design.ifc", f"{folder}/site.laz", "--transform", "out/run.json"],
    ):
        assert main(["fit", *arguments, "-o", "out"]) == 2
        said = capsys.readouterr().err
        assert said.endswith(" is one of the files that are read (another file name)\n"), said
    assert {p.read_text() for p in Path("out").iterdir()} == {"mine"}


def test_bad_files_are_one_line_and_nothing_is_written(frame, tmp_path, capsys):
    _, folder = frame
    (tmp_path / "bad.ifc").write_text("no model")
    (tmp_path / "file").write_text("")
    for arguments in (
        [f"{tmp_path}/bad.ifc", f"{folder}/site.laz", "-o", f"{tmp_path}/out"],
        [f"{folder}/none.ifc", f"{folder}/site.laz", "-o", f"{tmp_path}/out"],
        [f"{folder}/design.ifc", f"{folder}/none.laz", "-o", f"{tmp_path}/out"],
        [f"{folder}/design.ifc", f"{folder}/site.laz", "-o", f"{tmp_path}/file"],
    ):
        assert main(["fit", *arguments]) == 2
        assert capsys.readouterr().err.startswith("error: ")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.ifc", "file"]


def test_options_of_a_model_are_refused_for_one_element(tmp_path, capsys):
    assert main(["fit", "beam.yaml", "scan.ply", "-o", f"{tmp_path}/r.json", "--only", "x"]) == 2
    assert capsys.readouterr().err == "error: --only: is for design models (not with one element)\n"


def test_a_transform_is_read_and_turned_round(tmp_path):
    T = np.array([[0.0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]])
    np.savetxt(tmp_path / "T.txt", T)
    assert np.array_equal(read_transform(tmp_path / "T.txt"), T)
    assert np.allclose(read_transform(tmp_path / "T.txt", inverse=True) @ T, np.eye(4))
    (tmp_path / "T.txt").write_text("1, 0, 0, 0,\n0, 1, 0, 0,\n0, 0, 1, 0,\n0, 0, 0, 1")
    assert np.array_equal(read_transform(tmp_path / "T.txt"), np.eye(4))
    for text, why in (("1 2 3", "holds 3 numbers"), ("one", "something else"), ("1 " * 16, "last row")):
        (tmp_path / "T.txt").write_text(text)
        with pytest.raises(LinearIkError, match=why):
            read_transform(tmp_path / "T.txt")


def test_an_estimate_says_what_it_does_not_count(monkeypatch):
    said = []
    talk = _Talk(quiet=True)
    monkeypatch.setattr(talk.progress, "update", said.append)
    talk("fitting", 3, 12, 130.0)
    talk("colouring the scan", 5000, 9000, float("nan"))
    assert said == [
        "fitting: 3 of 12 elements, 2:10 left, then settling and colouring",
        "colouring the scan: 5,000 of 9,000",
    ]


def test_failures_are_named(tmp_path):
    from site_samples import design

    from linear_ik.model_fit import ModelFit
    from linear_ik.model_fit.fits import Row

    rows = tuple(Row(m, None, "it broke", {}) for m in design().members * 3)
    text = summary(ModelFit(rows, tmp_path, {"failed": 15}, ("elements.csv",), ("a note",)), Path("out"))
    assert text[0] == "elements   15 failed"
    assert text[1] == f"failed     {rows[0].member.guid}: it broke"
    assert text[11] == "           and 5 more, see elements.csv"
    assert text[12:] == ["note       a note", "written    out: elements, elements.csv"]
