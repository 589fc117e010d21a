"""The output folder of a run: files that no run of this design wrote stay as they are."""

from __future__ import annotations

import errno
import json
import os
import shutil
import socket
import subprocess
from dataclasses import replace

import pytest
from site_samples import ABSENT, GUIDS, design, only, site

from linear_ik.cli import main
from linear_ik.errors import OutputError
from linear_ik.fit import not_scanned
from linear_ik.model_fit import ModelFitOptions, fit_model
from linear_ik.model_fit.folder import RunFolder
from linear_ik.model_fit.lock import NO_LOCKS
from linear_ik.model_fit.ownership import SCHEMA, check_ours, note_design
from linear_ik.settings import FitSettings

HERE = {"workers": 0}
NAMES = ("asbuilt.ifc", "deviation.ply", "deviation.laz", "elements.csv", "run.json", "elements/beam.json")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """One element that is not in the scan: a run of a moment."""
    made = site(tmp_path_factory.mktemp("site"))
    return replace(made, design=only(made.design, ABSENT))


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", NAMES)
def test_files_of_others_are_not_replaced(built, tmp_path, name):
    theirs = tmp_path / name
    theirs.parent.mkdir(exist_ok=True)
    theirs.write_text('{"design": "site.ifc"}')
    before = contents(tmp_path)
    with pytest.raises(OutputError, match=r"was not written by a run of linear_ik.*--overwrite") as caught:
        fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert caught.value.subject == str(theirs)
    assert contents(tmp_path) == before
    fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE, overwrite=True))
    assert json.loads((tmp_path / "run.json").read_text())["design"] == "site.ifc"
    # From then on the folder is this design's.
    fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))


def test_a_run_of_another_design_is_not_replaced(built, tmp_path):
    fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    before = contents(tmp_path)
    other = replace(built.design, source="other.ifc")
    with pytest.raises(OutputError, match=r"is of a run with site\.ifc"):
        fit_model(other, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert contents(tmp_path) == before
    fit_model(other, [built.scan], tmp_path, options=ModelFitOptions(**HERE, overwrite=True))
    with pytest.raises(OutputError, match=r"is of a run with other\.ifc"):
        fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))


def test_two_designs_of_one_name_are_told_apart_by_where_they_are(tmp_path):
    project, other = tmp_path / "a", tmp_path / "b"
    for folder in (project, other):
        folder.mkdir()
        (folder / "design.ifc").touch()
    out, files = project / "out", ["elements.csv"]
    out.mkdir()
    (out / "elements.csv").touch()
    note_design(out, "design.ifc", project / "design.ifc")
    check_ours(out, "design.ifc", project / ".." / "a" / "design.ifc", files, False)
    check_ours(out, "design.ifc", None, files, False)
    with pytest.raises(OutputError, match=r"elements\.csv: is of a run with .*/a/design\.ifc, and would .*--overwrite"):
        check_ours(out, "design.ifc", other / "design.ifc", files, False)
    check_ours(out, "design.ifc", other / "design.ifc", files, True)
    # A project that is moved as a whole goes on.
    moved = project.rename(tmp_path / "c")
    check_ours(moved / "out", "design.ifc", moved / "design.ifc", files, False)


def test_a_run_that_noted_no_path_goes_on(tmp_path):
    (tmp_path / "elements.csv").touch()
    (tmp_path / "run.json").write_text(json.dumps({"schema": SCHEMA, "design": "design.ifc"}))
    check_ours(tmp_path, "design.ifc", tmp_path / "design.ifc", ["elements.csv"], False)


def test_a_run_that_was_stopped_before_its_end_goes_on(built, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("linear_ik.model_fit.run.versions", stopped)
        with pytest.raises(KeyboardInterrupt):
            fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert (tmp_path / "elements.csv").exists() and not (tmp_path / "run.json").exists()
    fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert (tmp_path / "run.json").exists()


def test_what_the_system_refuses_is_said_of_the_file(tmp_path):
    folder = RunFolder(tmp_path, ["a"])
    folder.make()
    result = not_scanned(design().members[0].element, "none", FitSettings())
    # A folder in a file's place.
    (tmp_path / "run_state" / "first" / "a.json").mkdir()
    (tmp_path / "run_state" / "points").write_text("")
    for work, name in (
        (lambda: folder.results.keep("a", "first", "x", result, {}), "elements/a.json"),
        (lambda: folder.results.back_to_first("a"), "run_state/first/a.json"),
        (lambda: folder.results.forget("a"), "run_state/first/a.json"),
        (folder.new_scratch, "run_state/points"),
    ):
        with pytest.raises(OutputError, match="cannot be written: ") as caught:
            work()
        assert caught.value.subject == str(tmp_path / name)
    folder.release()


def test_what_an_interrupted_run_leaves_is_not_taken_for_its_results(tmp_path, capsys):
    """As found: the scan of 2026, into the folder of 2024, stopped after one element: "0 of 4 moved"."""
    built = site(tmp_path)
    pipes = only(built.design, *GUIDS[2:])
    before, after = tmp_path / "2024", tmp_path / "2026"
    fit_model(pipes, [built.scan], before, options=ModelFitOptions(**HERE))
    shutil.copytree(before, after)
    later = shutil.copy(built.scan, tmp_path / "later.ply")

    def stop(stage, done, total, seconds):
        if stage == "fitting" and done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_model(pipes, [later], after, options=ModelFitOptions(**HERE), on_progress=stop)
    assert len(list((after / "elements").iterdir())) == 1, "none of the other scan"
    for words in (["compare", before, after], ["report", after, "-o", tmp_path / "r.html"],
                  ["report", after / "elements", "-o", tmp_path / "r.html"]):  # fmt: skip
        assert main([str(word) for word in words]) == 2
        out, err = capsys.readouterr()
        assert not out and "the run in it was not finished (run linear-ik fit again: it goes on)" in err
    # What waits beside it is no work to do again.
    stages = set()
    fit_model(pipes, [built.scan], after, options=ModelFitOptions(**HERE), on_progress=lambda *a: stages.add(a[0]))
    assert "fitting" in stages and json.loads((after / "run.json").read_text())["where"]["fitted_now"] == 1
    assert main(["compare", str(before), str(after)]) == 0
    assert "0 of 2 moved" in capsys.readouterr().out


def test_where_the_file_system_has_no_locks_a_file_keeps_other_runs_out(built, tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    options, note = ModelFitOptions(**HERE), tmp_path / "run_state" / "lock.holder"
    folder = RunFolder(tmp_path, [])
    folder.make()
    folder.new_scratch()
    me = f"{socket.gethostname()} {os.getpid()}"
    for holder in (me, "elsewhere 1"):
        note.write_text(holder)
        with pytest.raises(OutputError, match=rf"another run is at work in it .*: {holder}\) \(.* remove {note}\)"):
            fit_model(built.design, [built.scan], tmp_path, options=options)
        assert folder.scratch.exists() and note.read_text() == holder
    folder.release()
    assert not note.exists()
    gone = subprocess.Popen(["true"])
    gone.wait()
    note.write_text(f"{socket.gethostname()} {gone.pid}")
    found = fit_model(built.design, [built.scan], tmp_path, options=options)
    assert NO_LOCKS in found.notes and NO_LOCKS in json.loads((tmp_path / "run.json").read_text())["notes"]
    assert not note.exists()


def test_files_that_no_run_writes_are_let_be(built, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    fit_model(built.design, [built.scan], tmp_path, options=ModelFitOptions(**HERE))
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_the_command_refuses_with_one_line(built, tmp_path, capsys):
    (tmp_path / "design.ifc").write_text("never read")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "asbuilt.ifc").write_text("theirs")
    words = ["fit", str(tmp_path / "design.ifc"), str(built.scan), "-o", str(tmp_path / "out")]
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"error: {tmp_path / 'out' / 'asbuilt.ifc'}: was not written by a run of linear_ik")
    assert err.count("\n") == 1
    assert main([*words, "--overwrite"]) == 2
    assert "design.ifc" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["asbuilt.ifc"]
