"""As-built model of a run: elements whose body cannot be written never stop the rest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from linear_ik.result import FitResult


def write_asbuilt(design: Path, results: Mapping[str, FitResult], path: Path) -> list[str]:
    """Write the design with the fitted elements as they were found; return a sentence for each that it could not be.

    Raises:
        OutputError: the file cannot be written.
    """
    from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc

    notes: list[str] = []
    write_asbuilt_ifc(
        design,
        results,
        path,
        on_left=lambda guid, what: notes.append(f"{guid} is as designed in {path.name}: {what}"),
    )
    return notes
