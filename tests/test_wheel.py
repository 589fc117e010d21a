"""The wheel stands on its own: built, installed in an empty environment, used far from the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ELEMENT = """
name: wheel test
profile: {type: rectangle, x_dim: 0.2, y_dim: 0.4}
length: 3.0
segments: 4
"""


def run(*command: object, cwd: Path) -> str:
    # Neither the checkout nor its environment may be found by way of the surroundings.
    env = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=env, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, made from the source distribution as a packager makes it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment that holds the wheel, and borrows nothing but the wheel's dependencies."""
    folder = tmp_path_factory.mktemp("clean") / "venv"
    venv.create(folder)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index", wheel, cwd=folder)
    borrowed = [path for path in sys.path if "site-packages" in path]
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "borrowed.pth").write_text("\n".join(borrowed) + "\n")
    return folder


def test_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    sources = (path for path in (ROOT / "linear_ik").rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    package = {str(path.relative_to(ROOT)) for path in sources}
    templates = {f"linear_ik/urdf_templates/{path.name}" for path in (ROOT / "urdf_templates").glob("*.j2")}
    assert templates
    assert names == package | templates
    assert "linear_ik/py.typed" in names


def test_wheel_carries_its_licence(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (name,) = (name for name in archive.namelist() if name.endswith("licenses/LICENSE"))
    assert archive.read(name) == (ROOT / "LICENSE").read_bytes()


def test_installed_wheel_makes_a_urdf_from_its_own_templates(environment: Path, tmp_path: Path) -> None:
    where = run(environment / "bin" / "python", "-c", "import linear_ik; print(linear_ik.__file__)", cwd=tmp_path)
    installed = Path(where.strip()).parent
    assert environment in installed.parents

    (tmp_path / "element.yaml").write_text(ELEMENT)
    command = (environment / "bin" / "linear-ik", "urdf", "element.yaml", "-o", "element.urdf")
    run(*command, cwd=tmp_path)
    urdf = (tmp_path / "element.urdf").read_text()
    assert "segment_04_x" in urdf

    # A mark in the installed template shows whether the text comes from there.
    template = installed / "urdf_templates" / "element.urdf.j2"
    template.write_text(template.read_text().rstrip("\n") + "\n<!-- from the wheel -->\n")
    run(*command, cwd=tmp_path)
    assert (tmp_path / "element.urdf").read_text().rstrip("\n") == urdf.rstrip("\n") + "\n<!-- from the wheel -->"
