"""The pages: they build without a warning, and every command on the start pages works, offline, in their order."""

from __future__ import annotations

import csv
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
import typer
import yaml

from linear_ik.cli.app import app
from linear_ik.reason import CARRIED, NOTES, ReasonCode

ROOT = Path(__file__).parent.parent
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# test_examples.py runs these; the frame is what the pages stand on.
EXAMPLE = re.compile(r"python examples/(?!small_frame)\w+\.py$")
# test_bench_paper.py runs this, with its wrapper's command.
BENCHMARK = "scripts/bench_paper --quick --out paper"
BIN = Path(sys.executable).parent


def pages() -> list[Path]:
    """The start pages in the order of the site."""
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    start = next(entry["Ten minutes for"] for entry in nav if "Ten minutes for" in entry)
    return [ROOT / "docs" / path for entry in start for path in entry.values()]


def blocks(page: Path, *kinds: str) -> list[str]:
    return [text for kind, text in FENCE.findall(page.read_text(encoding="utf-8")) if kind in kinds]


def test_every_kind_of_user_has_a_page_with_commands() -> None:
    assert len(pages()) == 5
    for page in pages():
        assert blocks(page, "bash"), page
        # Whatever looks like a command is one that is run.
        assert not blocks(page, "sh", "shell", "console"), page


def test_examples_on_the_pages_have_their_test() -> None:
    tested = (ROOT / "tests" / "test_examples.py").read_text(encoding="utf-8")
    lines = [line for page in pages() for block in blocks(page, "bash") for line in block.splitlines()]
    named = [line.split("/")[-1] for line in lines if EXAMPLE.match(line)]
    assert len(named) >= 4 and BENCHMARK in lines
    quick = (ROOT / "tests" / "test_bench_paper.py").read_text(encoding="utf-8")
    assert '"benchlib.paper", "--quick"' in quick
    for name in named:
        assert (ROOT / "examples" / name).is_file() and f'"{name}"' in tested, name


def test_commands_of_the_start_pages(tmp_path: Path) -> None:
    # What the pages need of the checkout; the folder is another, so nothing is left in that.
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    nowhere = "http://127.0.0.1:9"  # whoever asks a proxy for the network is refused at once
    env = {
        **os.environ,
        "PATH": f"{BIN}:{os.environ['PATH']}",
        "http_proxy": nowhere,
        "https_proxy": nowhere,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    for page in pages():
        for block in blocks(page, "bash", *(["python"] if page.stem == "surveyor" else [])):
            if block.startswith("import "):
                block = f"python - <<'END'\n{block}END"
            lines = [line for line in block.splitlines() if not EXAMPLE.match(line) and line != BENCHMARK]
            block = "\n".join(lines)
            done = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", block],
                cwd=tmp_path,
                env=env,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=300,
                check=False,
            )
            assert done.returncode == 0, f"{page.name}:\n{block}\n{done.stdout}\n{done.stderr}"
            # A command may say that the beam is out of its tolerance, never that it could not be run.
            assert "error:" not in done.stderr and "Traceback" not in done.stderr, f"{block}\n{done.stderr}"
    check_files(tmp_path)


def check_files(folder: Path) -> None:
    """What the pages say is there afterwards is there."""
    surveyor = (folder / "frame" / "2024").iterdir()
    names = {path.name for path in surveyor}
    assert {"asbuilt.ifc", "elements.csv", "deviation.ply", "deviation.laz", "elements", "run.json"} <= names
    with (folder / "frame" / "moved.csv").open(encoding="utf-8", newline="") as file:
        verdicts = {row["tag"]: row["verdict"] for row in csv.DictReader(file)}
    assert verdicts["C2"] == "moved"
    assert "moved" not in [verdict for name, verdict in verdicts.items() if name != "C2"]
    with (folder / "moved.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["verdict"] == "moved"
    for name in ("frame/report.html", "beam_report.html", "arm.html", "iterations.html", "demo/report.html"):
        assert (folder / name).stat().st_size > 20_000, name
    for name in ("truth.json", "icpik.json", "bent_joints.json", "arm.urdf"):
        assert (folder / name).is_file(), name


def test_every_command_shown_anywhere_is_understood() -> None:
    """README's commands, those in tables and sentences left out: verbs, arguments and options exist."""
    verbs = typer.main.get_command(app)
    shown = [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
    lines = [line for page in shown for block in blocks(page, "sh", "bash") for line in block.splitlines()]
    commands = [shlex.split(line, comments=True) for line in lines if line.startswith("linear-ik ")]
    assert len(commands) > 20
    for _, verb, *arguments in commands:
        ends = [i for i, word in enumerate(arguments) if word in (">", "|", "&&")]
        verbs.commands[verb].make_context(verb, arguments[: min(ends, default=None)])


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    reference = (tmp_path / "site" / "reference" / "index.html").read_text(encoding="utf-8")
    for name in ("linear_ik.fit.fit", "linear_ik.result.FitResult", "linear_ik.deviation.Deviations"):
        assert f'id="{name}"' in reference


def test_the_citation_names_this_version() -> None:
    import linear_ik

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == linear_ik.__version__ and citation["license"] == "Apache-2.0"
    assert f"Version {linear_ik.__version__}." in (ROOT / "docs" / "cite.md").read_text(encoding="utf-8")


def test_every_code_of_a_reason_is_in_the_table() -> None:
    """The type of Reason.code lists all that the package can give; mypy holds it to that."""
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    table = text.split("### Reasons")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| .+ \| (\w*) ?\|$", table, re.MULTILINE)
    assert [code for code, _ in rows] == list(dict.fromkeys(code for code, _ in rows))
    assert {code for code, _ in rows} == set(get_args(ReasonCode))
    kinds = dict(rows)
    assert {code for code, kind in kinds.items() if kind == "note"} == NOTES
    assert {code for code, kind in kinds.items() if kind == "carried"} == CARRIED


def test_every_public_name_is_in_the_reference() -> None:
    import linear_ik

    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    listed = re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE)
    missing = []
    for name in linear_ik.__all__:
        if name == "__version__":
            continue
        made = getattr(linear_ik, name)
        module = getattr(made, "__module__", "")
        if f"{module}.{name}" not in listed and module not in listed:
            # Read by a name of the package, or a union of what is listed.
            missing += [] if any(entry.endswith(f".{name}") for entry in listed) else [name]
    assert missing in ([], ["Profile"])


@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/**/*.md")), ids=lambda page: page.stem)
def test_pages_show_only_pictures_that_are_there(page: Path) -> None:
    for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        picture = page.parent / target
        assert picture.is_file(), target
