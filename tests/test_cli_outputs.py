"""Where the command writes, and where it refuses to."""

import os
from pathlib import Path

import pytest
from command import fit_to, folder

from linear_ik.cli import main
from linear_ik.readers.result_json import read_result

__all__ = ["folder"]


@pytest.mark.parametrize("more", [["--urdf"], ["--glb"]])
def test_outputs_are_checked_before_the_work(folder, tmp_path, capsys, monkeypatch, more):
    monkeypatch.setattr("linear_ik.readers.read_scan", lambda *_, **__: pytest.fail("worked before it checked"))
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.json").symlink_to(folder / "scan.ply")
    before = sorted(os.listdir(tmp_path))
    scan = (folder / "scan.ply").read_bytes()
    for path, said in (
        (tmp_path / "folder", "is a folder"),
        (tmp_path / "file" / "r.json", "is no folder"),
        (tmp_path / "file" / "deep" / "r.json", "is no folder"),
        (folder / "scan.ply", "files that are read"),
        (folder / "beam.yaml", "files that are read"),
        (tmp_path / "link.json", "files that are read"),
        (Path("/proc/nothing/r.json"), "nothing can be written in /proc: "),
        (tmp_path / ("x" * 300), "cannot be written"),
    ):
        for arguments in ([path], [tmp_path / "r.json", *more, str(path)]):
            assert fit_to(folder, *arguments) == 2, path
            out, err = capsys.readouterr()
            assert err.startswith(f"error: {path}: ") and said in err and err.count("\n") == 1 and not out
    assert fit_to(folder, tmp_path / "r.json", *more, str(tmp_path / "r.json")) == 2
    assert "two outputs" in capsys.readouterr().err
    beside = ["--urdf", f"{tmp_path}/b.urdf", "--record", f"{tmp_path}/b_joints.json"]
    assert fit_to(folder, tmp_path / "r.json", *more, str(tmp_path / "m"), *beside) == 2
    assert "b_joints.json: is given for two outputs" in capsys.readouterr().err
    assert sorted(os.listdir(tmp_path)) == before and (folder / "scan.ply").read_bytes() == scan


def test_a_write_protected_place_is_refused(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("linear_ik.cli.outputs.os.access", lambda path, mode: mode != os.W_OK)
    (tmp_path / "r.json").write_text("{}")
    assert fit_to(folder, tmp_path / "r.json") == 2
    assert "write-protected" in capsys.readouterr().err
    assert (tmp_path / "r.json").read_text() == "{}"


def test_links_are_followed_and_devices_left_alone(folder, tmp_path):
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    assert fit_to(folder, tmp_path / "link.json", "-q") == 0
    assert (tmp_path / "link.json").is_symlink() and read_result(tmp_path / "real.json").status == "converged"
    assert fit_to(folder, "/dev/null", "-q") == 0
    assert Path("/dev/null").is_char_device()


def test_stdout_is_no_place_for_a_file(folder, capsys):
    assert main(["urdf", f"{folder}/beam.yaml", "-o", "-"]) == 2
    assert capsys.readouterr().err == "error: -: is stdout (a file name)\n"
