import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import yaml

import linear_ik
from linear_ik.cli import main
from linear_ik.cli.process import Outcome, Verb, stdout_aside
from linear_ik.exports.result_json import read_result
from linear_ik.readers import read_scan

VERBS = ("fit", "view", "demo", "urdf", "simulate")
BEAM = {
    "name": "beam",
    "profile": {"type": "rectangle", "x_dim": 0.1, "y_dim": 0.3},
    "length": 2.5,
    "segments": 5,
    "placement": {"location": [500000.0, 5400000.0, 10.0], "axis": [0, 0, 1], "ref_direction": [1, 0, 0]},
}


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """An element, its scan and the truth, made once by the commands themselves."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.yaml").write_text(yaml.safe_dump(BEAM))
    bend = ["--bend", "3:y:12.5", "--bend", "4:x:-5"]
    assert main(["simulate", f"{folder}/beam.yaml", *bend, "--points", "3000", "-o", f"{folder}/scan.ply",
                 "--truth", f"{folder}/truth.json"]) == 0  # fmt: skip
    assert main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", "-q", "-o", f"{folder}/result.json"]) == 0
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments, code="from linear_ik.cli import main; main()", **options):
    """The command in a process of its own; ``code`` may put something in a library's place first."""
    options = {"capture_output": True, "text": True, "timeout": 120, **options}
    return subprocess.run([sys.executable, "-c", code, *map(str, arguments)], **options)


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
def read_scan(*paths):
    print("from Python"); os.write(1, b"from the kernel\\n"); ctypes.CDLL(None).printf(b"from C\\n")
    return real(*paths)
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


# --- where it writes --------------------------------------------------------------------


def output_errors(folder, output, *more):
    return main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", "-o", str(output), *more])


@pytest.mark.parametrize("more", [["--urdf"], ["--glb"]])
def test_outputs_are_checked_before_the_work(folder, tmp_path, capsys, monkeypatch, more):
    monkeypatch.setattr("linear_ik.readers.read_scan", lambda *_: pytest.fail("worked before it checked"))
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
        (Path("/proc/nothing/r.json"), "cannot be written"),
        (tmp_path / ("x" * 300), "cannot be written"),
    ):
        for arguments in ([path], [tmp_path / "r.json", *more, str(path)]):
            assert output_errors(folder, *arguments) == 2, path
            out, err = capsys.readouterr()
            assert err.startswith(f"error: {path}: ") and said in err and err.count("\n") == 1 and not out
    assert output_errors(folder, tmp_path / "r.json", *more, str(tmp_path / "r.json")) == 2
    assert "two outputs" in capsys.readouterr().err
    assert sorted(os.listdir(tmp_path)) == before and (folder / "scan.ply").read_bytes() == scan


def test_a_write_protected_place_is_refused(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("linear_ik.cli.outputs.os.access", lambda path, mode: mode != os.W_OK)
    (tmp_path / "r.json").write_text("{}")
    assert output_errors(folder, tmp_path / "r.json") == 2
    assert "write-protected" in capsys.readouterr().err
    assert (tmp_path / "r.json").read_text() == "{}"


def test_links_are_followed_and_devices_left_alone(folder, tmp_path):
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    assert output_errors(folder, tmp_path / "link.json", "-q") == 0
    assert (tmp_path / "link.json").is_symlink() and read_result(tmp_path / "real.json").status == "converged"
    assert output_errors(folder, "/dev/null", "-q") == 0
    assert Path("/dev/null").is_char_device()


def test_stdout_is_no_place_for_a_file(folder, capsys):
    assert main(["urdf", f"{folder}/beam.yaml", "-o", "-"]) == 2
    assert capsys.readouterr().err == "error: -: is stdout (a file name)\n"


# --- how it ends ------------------------------------------------------------------------

WAITS = """
import sys, time
import linear_ik.readers
def read_scan(*paths):
    print("ready", file=sys.stderr, flush=True); time.sleep(60)
linear_ik.readers.read_scan = read_scan
from linear_ik.cli import main
main()
"""


def test_ctrl_c_is_one_line_and_leaves_nothing(folder, tmp_path):
    command = [
        sys.executable,
        "-c",
        WAITS,
        "fit",
        folder / "beam.yaml",
        folder / "scan.ply",
        "-o",
        tmp_path / "x" / "r",
    ]
    process = subprocess.Popen([str(c) for c in command], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_inside_a_compiled_module_is_still_ctrl_c(folder, tmp_path, monkeypatch, capsys):
    def read_scan(*paths):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    monkeypatch.setattr("linear_ik.readers.read_scan", read_scan)
    assert output_errors(folder, tmp_path / "r.json") == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_an_unexpected_error_is_one_line(folder, tmp_path, monkeypatch, capsys):
    def broken(*paths):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("linear_ik.readers.read_scan", broken)
    (tmp_path / "r.json").write_text("mine")
    assert output_errors(folder, tmp_path / "r.json") == 1
    err = capsys.readouterr().err
    assert err.startswith("error: internal: ZeroDivisionError: two lines") and "LINEAR_IK_DEBUG=1" in err
    assert err.count("\n") == 1 and (tmp_path / "r.json").read_text() == "mine"
    monkeypatch.setenv("LINEAR_IK_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        output_errors(folder, tmp_path / "r.json")


def test_a_missing_system_library_is_named_with_the_line_to_type(folder, tmp_path, monkeypatch, capsys):
    def bare(*paths):
        raise ImportError("libusb-1.0.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("linear_ik.readers.read_scan", bare)
    assert output_errors(folder, tmp_path / "r.json") == 1
    err = capsys.readouterr().err
    assert err.startswith("error: libusb-1.0.so.0: is missing (sudo apt-get install") and err.count("\n") == 1


@pytest.mark.parametrize("arguments", [["--help"], ["fit", "{0}/beam.yaml", "{0}/scan.ply", "-o", "-"]])
def test_a_reader_that_goes_away_is_not_complained_about(folder, arguments):
    read, write = os.pipe()
    os.close(read)
    done = run(*(a.format(folder) for a in arguments), "-q" if "fit" in arguments else "-h",
               stdout=write, stderr=subprocess.PIPE, capture_output=False)  # fmt: skip
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_closed_standard_streams(folder, tmp_path):
    code = f"{sys.executable} -m linear_ik fit {folder}/beam.yaml {folder}/scan.ply -o {tmp_path}/r.json <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", code], timeout=60).returncode == 0
    assert read_result(tmp_path / "r.json").status == "converged"


def test_stdout_comes_back(capfd):
    with stdout_aside():
        os.write(1, b"aside\n")
        print("aside too")
    os.write(1, b"back\n")
    out, err = capfd.readouterr()
    assert out == "back\n" and sorted(err.split("\n")) == ["", "aside", "aside too"]
    assert Verb.__mro__[1].__name__ == "TyperCommand" and Outcome() == Outcome(0, "")


# --- what a person who waits is told ----------------------------------------------------


def test_a_long_stage_says_so_without_a_terminal(monkeypatch, capsys):
    import threading

    from linear_ik.cli import progress

    monkeypatch.setattr(progress, "LINE_AFTER_S", 0.01)
    said = threading.Event()
    monkeypatch.setattr(progress, "print", lambda *a, **k: (print(*a, **k), said.set()), raising=False)
    with progress.Progress().stage("reading scan.e57"):
        assert said.wait(5)
    with progress.Progress(quiet=True).stage("fitting"), progress.Progress().stage("reading", judges_input=True):
        time.sleep(0.1)
    assert capsys.readouterr().err == "reading scan.e57 ...\n"


def test_a_terminal_gets_a_spinner_only_when_it_takes_long(folder, tmp_path):
    import pty

    def on_terminal(code):
        controller, terminal = pty.openpty()
        done = run("fit", folder / "beam.yaml", folder / "scan.ply", "-o", tmp_path / "r.json", code=code,
                   stderr=terminal, stdout=subprocess.DEVNULL, capture_output=False)  # fmt: skip
        os.close(terminal)
        shown = b""
        try:
            while part := os.read(controller, 65536):
                shown += part
        except OSError:
            pass
        os.close(controller)
        return done.returncode, shown.decode()

    setting = "import sys; from linear_ik.cli import main, progress; progress.SPINNER_AFTER_S = {}; main()"
    code, shown = on_terminal(setting.format(0.0))
    assert code == 0 and "fitting" in shown and "\x1b[" in shown
    code, shown = on_terminal(setting.format(1000.0))
    assert code == 0 and "fitting" not in shown and "converged" in shown


# --- view and demo ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "names, shows, hides",
    [
        (["beam.yaml"], ["designed: beam"], ["scanned", "fitted"]),
        (["scan.ply"], ["scanned: 3,000 points"], ["designed", "fitted"]),
        (["result.json"], ["designed: beam", "fitted", "status: converged"], ["scanned"]),
        (["scan.ply", "beam.yaml"], ["designed", "scanned"], ["fitted"]),
        (["result.json", "scan.ply", "beam.yaml"], ["designed", "blue on the fitted surface", "fitted"], []),
    ],
)
def test_view_takes_any_combination(folder, tmp_path, names, shows, hides, capfd):
    page = tmp_path / "page.html"
    assert main(["view", *(str(folder / name) for name in names), "--html", str(page)]) == 0
    caption = page.read_text().split('<div id="caption">')[1].split("</div>")[0]
    assert all(text in caption for text in shows) and not any(text in caption for text in hides)
    assert capfd.readouterr().out == ""


def test_view_tells_files_apart(folder, tmp_path, capsys):
    element = linear_ik.element_to_mapping(linear_ik.load_element(folder / "beam.yaml"))
    (tmp_path / "beam.json").write_text(json.dumps(element))
    assert main(["view", f"{tmp_path}/beam.json", "--html", f"{tmp_path}/p.html"]) == 0
    capsys.readouterr()
    for names, said in (
        ([folder / "beam.yaml", tmp_path / "beam.json"], "second element"),
        ([folder / "result.json", folder / "result.json"], "second result"),
        ([tmp_path / "none.json"], "none.json: "),
        ([tmp_path / "none.ply"], "none.ply: "),
        ([tmp_path / "none.yaml"], "none.yaml: "),
    ):
        assert main(["view", *map(str, names), "--no-wait"]) == 2
        err = capsys.readouterr().err
        assert said in err and err.count("\n") == 1


def serving(folder):
    """A process that serves the element, and the page's address."""
    command = [sys.executable, "-m", "linear_ik", "view", str(folder / "beam.yaml")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, **pipes, text=True)
    # A busy machine may be told first what takes its time.
    line = next(line for line in process.stderr if line.startswith("viewer"))
    assert process.stderr.readline() == "Press Enter to end.\n" and process.poll() is None
    return process, line.split()[1]


def test_view_serves_until_enter(folder):
    process, url = serving(folder)
    assert url.startswith("http://127.0.0.1:")
    assert b"<title>beam</title>" in urllib.request.urlopen(url, timeout=10).read()
    out, err = process.communicate("\n", timeout=30)
    assert (process.returncode, out, err) == (0, "", "")


def test_view_ends_quietly_at_ctrl_c(folder):
    process, _ = serving(folder)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (0, "", "")


def test_a_taken_port_is_one_line(folder, capsys):
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["view", f"{folder}/beam.yaml", "--port", str(port)]) == 2
    assert capsys.readouterr().err.startswith(f"error: --port: {port}: ")


def test_fit_shows_every_iteration_when_watched(folder, tmp_path, monkeypatch, capfd):
    from linear_ik.viewer import Viewer

    seen = []
    monkeypatch.setattr(Viewer, "on_iteration", lambda self, record: seen.append(record.iteration))
    files = [f"{folder}/beam.yaml", f"{folder}/scan.ply", "-o", f"{tmp_path}/r.json"]
    assert main(["fit", *files, "--view", "--no-wait"]) == 0
    assert seen == list(range(1, read_result(tmp_path / "r.json").iterations + 1))
    assert "viewer     http://127.0.0.1:" in capfd.readouterr().err


def test_demo_finds_its_truth_and_names_its_files(here, capfd):
    assert main(["demo"]) == 0
    out, err = capfd.readouterr()
    assert not out
    output = here / "linear_ik_demo"
    names = {path.name for path in output.iterdir()}
    for name in ("element.yaml", "scan.ply", "result.json", "result.urdf", "result.glb", "view.html"):
        assert name in names, name
    for name in ("view.html", "result.json", "result.glb", "result.urdf", "element.yaml"):
        assert f"linear_ik_demo/{name}" in err
    result, truth = read_result(output / "result.json"), json.loads((output / "truth.json").read_text())
    worst = 1000 * np.linalg.norm(result.nodes_m - truth["nodes_m"], axis=1).max()
    assert result.status == "converged" and worst < 1.0
    assert f"largest error {worst:.2f} mm" in err
    assert result.element == linear_ik.load_element(output / "element.yaml")
    # Its files are those that the other verbs read.
    assert main(["fit", "linear_ik_demo/element.yaml", "linear_ik_demo/scan.ply", "-q", "-o", "mine.json"]) == 0
    np.testing.assert_allclose(read_result(here / "mine.json").nodes_m, result.nodes_m, atol=2e-4)


def test_demo_checks_its_folder_first(here, capfd, monkeypatch):
    monkeypatch.setattr("linear_ik.example.example_scan", lambda: pytest.fail("worked before it checked"))
    (here / "file").write_text("mine")
    for path in ("file", "file/below"):
        assert main(["demo", "-o", path]) == 2
        err = capfd.readouterr().err
        assert err.startswith(f"error: {path}: ") and "is no folder" in err and err.count("\n") == 1
    (here / "folder" / "scan.ply").mkdir(parents=True)
    assert main(["demo", "-o", "folder"]) == 2
    assert "scan.ply: is a folder" in capfd.readouterr().err


# --- start-up ---------------------------------------------------------------------------


def test_a_fit_imports_nothing_that_it_does_not_use(folder, tmp_path):
    code = "import sys; from linear_ik.cli.app import run; run(sys.argv[1:]); print(*sys.modules, file=sys.stderr)"
    done = run("fit", folder / "beam.yaml", folder / "scan.ply", "-q", "-o", tmp_path / "r.json", code=code)
    assert done.returncode == 0, done.stderr
    unused = {"rich", "yourdfpy", "trimesh", "meshcat", "matplotlib", "dash", "plotly", "laspy", "pye57", "IPython"}
    assert not unused & set(done.stderr.split())


def test_open3d_keeps_its_plots_for_those_who_call_them():
    code = """
import sys
from linear_ik.cli.quick_open3d import defer_plots
defer_plots(); defer_plots()
import open3d
assert "dash" not in sys.modules
try:
    open3d.visualization.draw_plotly(1)
except TypeError:
    pass
assert "dash" in sys.modules
assert "open3d.visualization.draw_plotly" in sys.modules
before = dict(sys.modules)
defer_plots()
assert sys.modules["open3d.visualization.draw_plotly"] is before["open3d.visualization.draw_plotly"]
"""
    done = run(code=code)
    assert done.returncode == 0, done.stderr


def test_public_names_are_all_there_and_imported_late():
    code = """
import sys
import linear_ik
assert not {"numpy", "pinocchio", "open3d"} & set(sys.modules)
for name in linear_ik.__all__:
    assert getattr(linear_ik, name) is not None, name
assert set(linear_ik.__all__) <= set(dir(linear_ik))
import linear_ik.fit, linear_ik.simulate
assert callable(linear_ik.fit) and callable(linear_ik.simulate)
from linear_ik import fit, simulate
assert fit.__name__ == "fit" and simulate.__name__ == "simulate"
try:
    linear_ik.nothing
except AttributeError as error:
    assert "nothing" in str(error)
"""
    done = run(code=code)
    assert done.returncode == 0, done.stderr
