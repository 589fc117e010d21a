"""`linear-ik view`, `fit --view` and `demo`."""

import json
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from command import folder, here

import linear_ik
from linear_ik.cli import main
from linear_ik.readers.result_json import read_result

__all__ = ["folder", "here"]


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


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("name: beam", "name: girder", "name: 'beam', not 'girder'"),
        ("length: 2.5", "length: 2.6", "length: 2.5, not 2.6"),
        ("x_dim: 0.1", "x_dim: 0.2", "profile"),
        ("5400000.0", "5400001.0", "placement"),
    ],
)
def test_a_result_of_another_element_is_not_shown_with_this_one(folder, tmp_path, capsys, old, new, said):
    text = (folder / "beam.yaml").read_text()
    assert old in text
    (tmp_path / "other.yaml").write_text(text.replace(old, new))
    words = ["view", f"{tmp_path}/other.yaml", f"{folder}/result.json", "--html", f"{tmp_path}/p.html"]
    assert main(words) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"error: {folder}/result.json: is of another element: {said}") and err.count("\n") == 1
    assert not (tmp_path / "p.html").exists()


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
    assert main(["fit", *files, "--pairs"]) == 2
    assert capfd.readouterr().err == "error: --pairs: given without --view (--view)\n"


def test_demo_finds_its_truth_and_names_its_files(here, capfd):
    assert main(["demo"]) == 0
    out, err = capfd.readouterr()
    assert not out
    output = here / "linear_ik_demo"
    names = {path.name for path in output.iterdir()}
    for name in ("element.yaml", "scan.ply", "result.json", "result.urdf", "result.glb", "view.html", "report.html"):
        assert name in names, name
    for name in ("view.html", "report.html", "result.json", "result.glb", "result.urdf", "element.yaml"):
        assert f"linear_ik_demo/{name}" in err
    result, truth = read_result(output / "result.json"), json.loads((output / "truth.json").read_text())
    worst = 1000 * np.linalg.norm(result.nodes_m - truth["nodes_m"], axis=1).max()
    assert result.status == "converged" and worst < 1.0
    assert f"largest error {worst:.2f} mm" in err
    assert result.element == linear_ik.load_element(output / "element.yaml")
    # Its files are those that the other verbs read.
    assert main(["fit", "linear_ik_demo/element.yaml", "linear_ik_demo/scan.ply", "-q", "-o", "mine.json"]) == 0
    # In other last digits, so of another sample of the points: within what either knows.
    deviation_m = np.sqrt(np.diagonal(result.nodes_covariance_m2, axis1=1, axis2=2))
    assert (np.abs(read_result(here / "mine.json").nodes_m - result.nodes_m) <= deviation_m + 1e-9).all()


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


def test_fit_records_its_iterations_in_one_page(folder, tmp_path, capfd):
    command = ["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", "-o", f"{tmp_path}/r.json"]
    assert main([*command, "--record", f"{tmp_path}/new/page.html"]) == 0
    out, err = capfd.readouterr()
    assert not out and "page.html" in err
    page = (tmp_path / "new/page.html").read_text()
    assert "status: converged" in page and 'id="player"' in page and page.count("handle_command_bytearray(") > 10
    assert main([*command, "--record", f"{tmp_path}/r.json"]) == 2
    assert main([*command, "--record", f"{folder}/scan.ply"]) == 2
    assert capfd.readouterr().err.count("error: ") == 2


def test_nothing_of_the_viewer_is_imported_unless_asked_for(folder, tmp_path):
    code = (
        "import sys; from linear_ik.cli import main; code = main(sys.argv[1:]);"
        "print([m for m in sys.modules if m.split('.')[0] == 'meshcat' or 'viewer' in m or 'report' in m.split('.')])"
    )
    command = [sys.executable, "-c", code, "fit", folder / "beam.yaml", folder / "scan.ply", "-q", "-o", tmp_path / "r"]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=120, check=True)
    loaded = done.stdout.splitlines()[-1]
    # app.py names the verbs; what they need is imported when they run.
    assert [m for m in eval(loaded) if not m.startswith("linear_ik.cli.") and not m.startswith("open3d.")] == []
