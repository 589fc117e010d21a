"""What the tests of the command share: an element with its scan and result, and ways to run the command."""

import subprocess
import sys

import pytest
import yaml

from linear_ik.cli import main

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


def fit_to(folder, output, *more):
    return main(["fit", f"{folder}/beam.yaml", f"{folder}/scan.ply", "-o", str(output), *more])
