"""`linear-ik` as a person types it: help, usage, urdf, simulate, fit."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from command import BEAM, folder, here, run

import linear_ik
from linear_ik.cli import main
from linear_ik.readers import read_scan
from linear_ik.readers.result_json import read_result

__all__ = ["folder", "here"]

VERBS = ("check", "align", "fit", "report", "compare", "tolerances", "view", "demo", "urdf", "simulate")

# --- what a person asks first -----------------------------------------------------------


@pytest.mark.parametrize("flag", ["-h", "--help"])
@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_with_an_example(verb, flag, capsys):
    assert main([verb, flag]) == 0
    out, err = capsys.readouterr()
    assert f"Usage: linear-ik {verb}" in out and f"  linear-ik {verb} " in out.split("Example")[1]
    assert not err


@pytest.mark.parametrize("arguments", [[], ["-h"], ["--help"]])
def test_the_command_alone_lists_the_verbs(arguments, capsys):
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert all(f"  {verb} " in out for verb in VERBS)
    assert not [line for line in out.splitlines()[1:] if line.endswith("...")]


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"linear-ik {linear_ik.__version__}\n"


@pytest.mark.parametrize(
    "arguments, said",
    [
        (["fti"], "Did you mean 'fit'"),
        (["fit"], "ELEMENT.yaml"),
        (["fit", "beam.yaml"], "SCAN"),
        (["fit", "beam.yaml", "scan.ply"], "-o"),
        (["fit", "beam.yaml", "scan.ply", "-o", "r.json", "--max-iterations", "many"], "--max-iterations"),
        (["fit", "beam.yaml", "scan.ply", "-o", "r.json", "--fast"], "--fast"),
        (["urdf", "beam.yaml", "scan.ply", "-o", "r.urdf"], "scan.ply"),
        (["view", "beam.yaml", "--port", "70000"], "--port"),
        (["view"], "FILE"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(arguments, said, capsys, here):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert err.startswith("error: linear-ik") and said in err and err.count("\n") == 1 and "--help)" in err
    assert not out and not list(here.iterdir())


def test_python_minus_m():
    done = subprocess.run([sys.executable, "-m", "linear_ik", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.split()[0]) == (0, "linear-ik")


# --- urdf and simulate ------------------------------------------------------------------


def test_urdf_is_what_the_package_generates(folder, tmp_path):
    target = tmp_path / "new" / "beam.urdf"
    assert main(["urdf", f"{folder}/beam.yaml", "-o", str(target)]) == 0
    assert target.read_text() == linear_ik.generate_urdf(linear_ik.load_element(folder / "beam.yaml"))


def test_simulate_writes_every_bit_and_the_truth(folder):
    element = linear_ik.load_element(folder / "beam.yaml")
    scan = linear_ik.simulate(element, bends=["3:y:12.5", "4:x:-5"], points=3000)
    assert np.array_equal(read_scan(folder / "scan.ply").points, scan.points)
    truth = json.loads((folder / "truth.json").read_text())
    assert np.array_equal(truth["nodes_m"], scan.nodes_m)
    assert np.array_equal(truth["joint_angles_rad"], scan.joint_angles_rad)
    assert truth["schema"] == "linear_ik/truth/1"


@pytest.mark.parametrize("name", ["scan.ply", "scan.PLY", "scan.xyz", "scan.txt"])
def test_simulate_picks_the_format_by_extension(folder, tmp_path, name):
    options = ["--points", "400", "--noise", "0.002", "--seed", "5", "--missing", "-y", "--missing", "+x"]
    assert main(["simulate", f"{folder}/beam.yaml", *options, "-o", str(tmp_path / name)]) == 0
    element = linear_ik.load_element(folder / "beam.yaml")
    expected = linear_ik.simulate(element, points=400, noise_m=0.002, seed=5, missing=["-y", "+x"])
    np.testing.assert_allclose(read_scan(tmp_path / name).points, expected.points, rtol=0, atol=6e-7)


# --- fit --------------------------------------------------------------------------------


def test_fit_finds_the_truth_and_writes_the_contract(folder, tmp_path, capfd):
    target = tmp_path / "new" / "result.json"
    files = [f"{folder}/beam.yaml", f"{folder}/scan.ply"]
    assert main(["fit", *files, "-o", str(target), "--urdf", f"{tmp_path}/b.urdf", "--glb", f"{tmp_path}/b.glb"]) == 0
    out, err = capfd.readouterr()
    assert not out
    lines = dict(line.split(maxsplit=1) for line in err.splitlines())
    truth = json.loads((folder / "truth.json").read_text())
    result = read_result(target)
    assert np.linalg.norm(result.nodes_m - truth["nodes_m"], axis=1).max() < 0.001
    assert result.status == lines["status"] == "converged"
    design = np.array(BEAM["placement"]["location"]) + [0, 0, BEAM["length"]]
    moved = 1000 * np.linalg.norm(np.array(truth["nodes_m"])[-1] - design)
    tip, band = (float(lines["tip"].split()[i]) for i in (0, 6))
    assert abs(tip - moved) < 1 and 0.05 < band < 2 and "95 %" in lines["tip"]
    assert lines["segments"] == "5 measured"
    assert "mm rms over" in lines["surface"] and "in" in lines["iterations"]
    assert lines["written"] == f"{target}, {tmp_path}/b.urdf, {tmp_path}/b.glb"
    assert (tmp_path / "b.glb").read_bytes()[:4] == b"glTF"
    assert "segment_05_x" in (tmp_path / "b.urdf").read_text()


def test_fit_takes_its_options(folder, tmp_path):
    target = tmp_path / "result.json"
    options = ["--search", "never", "--range-noise", "0.002", "--max-iterations", "3", "--solver", "osqp", "-q"]
    code = main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", f"{folder}/scan.ply", "-o", str(target), *options])
    result = read_result(target)
    assert code == 0
    assert result.settings == linear_ik.FitSettings(
        search="never", range_noise_m=0.002, max_iterations=3, solver="osqp"
    )


def test_max_iterations_are_the_most(folder, tmp_path):
    options = ["--max-iterations", "3", "-q", "-o", f"{tmp_path}/r.json"]
    assert main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", *options]) == 0
    result = read_result(tmp_path / "r.json")
    assert result.iterations <= 3 and result.status == "max_iterations"


def test_points_without_coordinates_are_counted(folder, tmp_path, capfd):
    points = read_scan(folder / "scan.ply").points
    np.savetxt(tmp_path / "scan.xyz", np.insert(points, [1, 5], np.nan, axis=0))
    options = ["--max-iterations", "3", "-o", f"{tmp_path}/r.json"]
    assert main(["fit", f"{folder}/beam.yaml", f"{tmp_path}/scan.xyz", *options]) == 0
    assert "\nleft out   2 points without usable coordinates, withheld or noise\n" in capfd.readouterr().err


def test_quiet_is_silent(folder, tmp_path, capfd):
    assert main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", "-q", "-o", f"{tmp_path}/r.json"]) == 0
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("stdout", ["-", "/dev/stdout"])
def test_json_on_stdout_is_nothing_but_json(folder, stdout):
    # A library that prints from Python and from C, at once and buffered, and again at its end.
    noisy = """
import atexit, ctypes, os, sys
import linear_ik.readers
real = linear_ik.readers.read_scan
def read_scan(*paths, **more):
    print("from Python"); os.write(1, b"from the kernel\\n"); ctypes.CDLL(None).printf(b"from C\\n")
    return real(*paths, **more)
linear_ik.readers.read_scan = read_scan
from linear_ik.cli import main
main()
"""
    done = run("fit", folder / "beam.yaml", folder / "scan.ply", "-o", stdout, code=noisy)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "converged"
    assert all(f"from {who}\n" in done.stderr for who in ("Python", "the kernel", "C"))
    assert "written" not in done.stderr


def test_not_scanned_is_exit_3_with_a_result(folder, tmp_path, monkeypatch, capfd):
    import dataclasses

    found = read_result(folder / "result.json")
    lost = dataclasses.replace(found, status="not_scanned", reasons=("No point lies on it.",))
    monkeypatch.setattr(sys.modules["linear_ik.fit"], "fit", lambda *_: lost)
    outputs = ["-o", f"{tmp_path}/r.json", "--urdf", f"{tmp_path}/r.urdf", "--glb", f"{tmp_path}/r.glb"]
    assert main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", *outputs]) == 3
    err = capfd.readouterr().err
    assert "not_scanned" in err and "No point lies on it." in err and "tip" not in err and "r.urdf" not in err
    assert read_result(tmp_path / "r.json").status == "not_scanned"
    assert os.listdir(tmp_path) == ["r.json"]


def test_a_scan_without_the_element_is_exit_3(folder, tmp_path):
    far = np.random.default_rng(0).normal(size=(2000, 3)) + np.array(BEAM["placement"]["location"]) + [40.0, 0.0, 0.0]
    linear_ik.write_scan(linear_ik.Scan(far), tmp_path / "elsewhere.ply")
    code = main(["fit", f"{folder}/beam.yaml", f"{tmp_path}/elsewhere.ply", "-q", "-o", f"{tmp_path}/r.json"])
    result = read_result(tmp_path / "r.json")
    assert code == 3 and result.status == "not_scanned" and result.reasons
