"""Ownership: whose files an output folder holds, so that a run writes over none but those of its design's runs."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from linear_ik.atomic import write_atomically
from linear_ik.errors import OutputError

SCHEMA = "linear_ik/run/1"
REPORT, STATE, ELEMENTS = "run.json", "run_state", "elements"
NOTE = "run.design"  # there from a run's beginning, when run.json is not yet


def check_ours(folder: Path, design: str, names: Sequence[str], overwrite: bool) -> None:
    """Refuse a folder with files that a run would replace and no run of this design has written.

    Args:
        folder: the output folder, or none yet.
        design: the name of the design's file.
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
    if earlier != design:
        raise OutputError(found[0], f"is of a run with {earlier}, and would be replaced", expected)


def note_design(folder: Path, design: str) -> None:
    """Note whose run is at work in a folder.

    Raises:
        OutputError: it cannot be written.
    """
    note: dict[str, Any] = {"schema": SCHEMA, "design": design}
    write_atomically(folder / STATE / NOTE, json.dumps(note) + "\n")


def _design_of(folder: Path) -> str | None:
    """Return the design of the last run in a folder, or None where none has been there."""
    for path in (folder / STATE / NOTE, folder / REPORT):
        try:
            said = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(said, dict) and said.get("schema") == SCHEMA and isinstance(said.get("design"), str):
            return str(said["design"])
    return None
