"""Ownership: whose files an output folder holds, so that a run writes over none but those of its design's runs."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from linear_ik.atomic import write_atomically
from linear_ik.errors import OutputError
from linear_ik.run_files import ELEMENTS, REPORT, STATE

SCHEMA = "linear_ik/run/1"
NOTE = "run.design"  # there from a run's beginning, when run.json is not yet


def check_ours(folder: Path, design: str, path: Path | None, names: Sequence[str], overwrite: bool) -> None:
    """Refuse a folder with files that a run would replace and no run of this design has written.

    Args:
        folder: the output folder, or none yet.
        design: the name of the design's file.
        path: of that file, or None for a model that is not from one.
        names: of the files that a run writes.
        overwrite: the person said that they may go.

    Raises:
        OutputError: there is such a file.
    """
    if overwrite:
        return
    found = [folder / name for name in names if os.path.lexists(folder / name)]
    found += sorted((folder / ELEMENTS).glob("*.json"))[:1]
    if not found:
        return
    earlier = _design_of(folder)
    expected = "another folder, or --overwrite"
    if earlier is None:
        raise OutputError(found[0], "was not written by a run of linear_ik, and would be replaced", expected)
    if earlier.name != design:
        raise OutputError(found[0], f"is of a run with {earlier.name}, and would be replaced", expected)
    # Designs of two projects may have the same name. Runs of earlier versions, and of models, noted no path.
    if path is not None and earlier.places and not set(earlier.places) & set(_places(folder, path)):
        raise OutputError(found[0], f"is of a run with {earlier.places[0]}, and would be replaced", expected)


def note_design(folder: Path, design: str, path: Path | None) -> None:
    """Note whose run is at work in a folder.

    Args:
        folder: the output folder.
        design: the name of the design's file.
        path: of that file, or None for a model that is not from one.

    Raises:
        OutputError: it cannot be written.
    """
    note: dict[str, Any] = {"schema": SCHEMA, "design": design}
    if path is not None:
        note["design_paths"] = _places(folder, path)
    write_atomically(folder / STATE / NOTE, json.dumps(note) + "\n")


class _Earlier(NamedTuple):
    """The design of an earlier run: its file's name, and where that was, if noted."""

    name: str
    places: list[str]


def _places(folder: Path, path: Path) -> list[str]:
    """Return where a design is: its path, and that from the folder, which holds when both are moved together."""
    at = path.resolve()
    try:
        return [str(at), os.path.relpath(at, folder.resolve())]
    except ValueError:  # another drive
        return [str(at)]


def _design_of(folder: Path) -> _Earlier | None:
    """Return the design of the last run in a folder, or None where none has been there."""
    for path in (folder / STATE / NOTE, folder / REPORT):
        try:
            said = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(said, dict) and said.get("schema") == SCHEMA and isinstance(said.get("design"), str):
            places = said.get("design_paths")
            return _Earlier(said["design"], [str(p) for p in places] if isinstance(places, list) else [])
    return None
