"""The scripts, with the installers they call replaced by ones that only take notes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = [ROOT / "scripts" / name for name in ("setup", "demo", "test")] + [ROOT / ".ci" / "run"]

# Passes for an interpreter: makes "environments" of itself, notes what it is asked to install.
FAKE_PYTHON = """#!/usr/bin/env bash
case "$*" in
*"-m venv --clear"*)
    mkdir -p "${@: -1}/bin"
    rm -f "${@: -1}/setup-stamp"
    cp "$0" "${@: -1}/bin/python"
    echo venv >>"$NOTES"
    ;;
*"-m pip --version"*) ;;
*"-m pip"*) echo pip >>"$NOTES" ;;
*"-m uv"*)
    echo uv >>"$NOTES"
    exit "${UV_EXIT:-0}"
    ;;
*"import open3d"*) exit "${IMPORT_EXIT:-0}" ;;
*"import ensurepip"*) ;;
*) exec PYTHON "$@" ;;
esac
"""


class Checkout:
    """A folder with nothing but what scripts/setup looks at, on a machine of our making."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "a checkout's folder"
        (self.root / "scripts").mkdir(parents=True)
        shutil.copy2(ROOT / "scripts" / "setup", self.root / "scripts")
        shutil.copy2(ROOT / "pyproject.toml", self.root)
        self.notes = folder / "notes"
        self.tools = folder / "tools"
        self.tools.mkdir()
        self.tool("fake-python", FAKE_PYTHON.replace("PYTHON", f'"{sys.executable}"', 1))
        self.tool("dpkg-query", "#!/bin/sh\necho installed\n")
        self.tool("apt-get", '#!/bin/sh\necho "apt $*" >>"$NOTES"\n')
        self.tool("uname", "#!/bin/sh\necho Linux\n")
        self.env = {
            "PATH": f"{self.tools}:{os.environ['PATH']}",
            "NOTES": str(self.notes),
            "PYTHON": str(self.tools / "fake-python"),
        }

    def tool(self, name: str, text: str) -> None:
        path = self.tools / name
        path.write_text(text)
        path.chmod(0o755)

    def setup(self, **env: str) -> tuple[int, list[str], str]:
        """Return the exit code, what was called, and what was said."""
        self.notes.write_text("")
        command = [str(self.root / "scripts" / "setup")]
        done = subprocess.run(
            command, env=self.env | env, cwd="/", capture_output=True, text=True, timeout=60, check=False
        )
        assert done.stdout == ""
        return done.returncode, self.notes.read_text().split("\n")[:-1], done.stderr


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_is_executable_bash(script: Path) -> None:
    assert os.access(script, os.X_OK)
    assert script.read_text().startswith("#!/usr/bin/env bash\n")
    subprocess.run(["bash", "-n", script], check=True)


def test_setup_twice_installs_once(checkout: Checkout) -> None:
    assert checkout.setup()[:2] == (0, ["venv", "pip", "uv"])
    start = time.monotonic()
    assert checkout.setup() == (0, [], "")
    assert time.monotonic() - start < 3.0


def test_setup_installs_again_after_a_change(checkout: Checkout) -> None:
    checkout.setup()
    with (checkout.root / "pyproject.toml").open("a") as file:
        file.write("# changed\n")
    assert checkout.setup()[:2] == (0, ["pip", "uv"])


def test_setup_starts_anew_after_an_interruption(checkout: Checkout) -> None:
    checkout.setup()
    (checkout.root / ".venv" / "setup-stamp").write_text("interrupted \n")
    assert checkout.setup()[:2] == (0, ["venv", "pip", "uv"])


def test_setup_starts_anew_in_a_moved_checkout(checkout: Checkout) -> None:
    checkout.setup()
    checkout.root = checkout.root.rename(checkout.root.with_name("moved"))
    assert checkout.setup()[:2] == (0, ["venv", "pip", "uv"])


def test_setup_falls_back_to_pip(checkout: Checkout) -> None:
    assert checkout.setup(UV_EXIT="1")[:2] == (0, ["venv", "pip", "uv", "pip"])


def test_setup_fails_when_a_library_does_not_load(checkout: Checkout) -> None:
    code, _, said = checkout.setup(IMPORT_EXIT="1")
    assert code == 1
    assert "does not load" in said
    code, called, _ = checkout.setup()
    assert (code, called) == (0, ["pip", "uv"]), "a failed check must not count as set up"


def test_setup_installs_missing_libraries_as_root(checkout: Checkout) -> None:
    checkout.tool("id", "#!/bin/sh\necho 0\n")
    checkout.tool("dpkg-query", '#!/bin/sh\ncase "$*" in *libegl1*) exit 1 ;; *) echo installed ;; esac\n')
    code, called, _ = checkout.setup()
    assert code == 0
    assert len(called) == 4
    assert called[0].endswith("install libegl1")


def test_setup_says_the_line_to_type_when_it_may_not_install(checkout: Checkout) -> None:
    checkout.tool("id", "#!/bin/sh\necho 1000\n")
    checkout.tool("sudo", "#!/bin/sh\nexit 1\n")
    checkout.tool("dpkg-query", '#!/bin/sh\ncase "$*" in *libegl1*) exit 1 ;; *) echo installed ;; esac\n')
    code, called, said = checkout.setup()
    assert (code, called) == (1, [])
    assert "sudo sh -c 'apt-get update && apt-get install -y --no-install-recommends libegl1'\n" in said


def test_setup_refuses_an_unsuitable_python(checkout: Checkout) -> None:
    checkout.tool("fake-python", "#!/bin/sh\nexit 1\n")
    code, called, said = checkout.setup()
    assert (code, called) == (1, [])
    assert "no CPython 3.10 to 3.14 found" in said
