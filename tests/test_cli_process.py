"""How the command starts, waits and ends."""

import os
import signal
import subprocess
import sys
import time

import pytest
from command import fit_to, folder, run

from linear_ik.cli.process import Outcome, Verb, stdout_aside
from linear_ik.readers.result_json import read_result

__all__ = ["folder"]

# --- how it ends ------------------------------------------------------------------------

WAITS = """
import signal, sys, time
# A shell that runs the tests in the background has it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
import linear_ik.readers
def read_scan(*paths, **more):
    print("ready", file=sys.stderr, flush=True); time.sleep(60)
linear_ik.readers.read_scan = read_scan
from linear_ik.cli import main
main()
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["Ctrl-C", "kill"])
def test_ctrl_c_is_one_line_and_leaves_nothing(folder, tmp_path, number, code):
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
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (code, "", "interrupted\n")
    assert not list(tmp_path.iterdir())


def test_ctrl_c_inside_a_compiled_module_is_still_ctrl_c(folder, tmp_path, monkeypatch, capsys):
    def read_scan(*paths, **more):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    monkeypatch.setattr("linear_ik.readers.read_scan", read_scan)
    assert fit_to(folder, tmp_path / "r.json") == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_an_unexpected_error_is_one_line(folder, tmp_path, monkeypatch, capsys):
    def broken(*paths, **more):
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("linear_ik.readers.read_scan", broken)
    (tmp_path / "r.json").write_text("mine")
    assert fit_to(folder, tmp_path / "r.json") == 1
    err = capsys.readouterr().err
    assert err.startswith("error: internal: ZeroDivisionError: two lines") and "LINEAR_IK_DEBUG=1" in err
    assert err.count("\n") == 1 and (tmp_path / "r.json").read_text() == "mine"
    monkeypatch.setenv("LINEAR_IK_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        fit_to(folder, tmp_path / "r.json")


def test_a_missing_system_library_is_named_with_the_line_to_type(folder, tmp_path, monkeypatch, capsys):
    def bare(*paths, **more):
        raise ImportError("libusb-1.0.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("linear_ik.readers.read_scan", bare)
    assert fit_to(folder, tmp_path / "r.json") == 1
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
from linear_ik.quick_open3d import defer_plots
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
