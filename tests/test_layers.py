"""The house: a room imports only rooms below it, and heavy guests come only when called."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import grimp
import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "linear_ik"
# Each takes a tenth of a second to import, or seconds.
HEAVY = {
    "ifcopenshell",
    "laspy",
    "matplotlib",
    "meshcat",
    "open3d",
    "pye57",
    "qpsolvers",
    "rich",
    "shapely",
    "trimesh",
    "yourdfpy",
}


def module_level_imports(path: Path) -> Iterator[str]:
    """The top packages that a file imports as soon as it is imported."""
    waiting: list[ast.AST] = [ast.parse(path.read_text())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0]
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        elif isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            waiting.extend(node.orelse)
            continue
        waiting.extend(ast.iter_child_nodes(node))


def test_a_room_imports_only_rooms_below_it(capsys: pytest.CaptureFixture[str]) -> None:
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert code == 0, capsys.readouterr().out


def test_only_the_chain_knows_pinocchio() -> None:
    graph = grimp.build_graph("linear_ik", include_external_packages=True, cache_dir=None)
    assert graph.find_modules_that_directly_import("pinocchio") == {"linear_ik.chain"}


def test_heavy_libraries_are_imported_where_they_are_used() -> None:
    found = {
        f"{path.relative_to(ROOT)} imports {name}"
        for path in PACKAGE.rglob("*.py")
        for name in HEAVY.intersection(module_level_imports(path))
    }
    assert not found


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, linear_ik; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY.intersection(done.stdout.split())
