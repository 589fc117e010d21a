"""As-built model of a run: elements whose body cannot be written never stop the rest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from linear_ik.errors import LinearIkError
from linear_ik.result import FitResult


def write_asbuilt(design: Path, results: Mapping[str, FitResult], path: Path) -> list[str]:
    """Write the design with the fitted elements as they were found; return a sentence for each that it could not be.

    Raises:
        OutputError: the file cannot be written.
    """
    from linear_ik.asbuilt.shape import AsBuiltError
    from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc

    left, notes = dict(results), list[str]()
    while True:
        try:
            write_asbuilt_ifc(design, left, path)
            return notes
        except AsBuiltError as error:
            if error.subject not in left:
                raise LinearIkError(path, f"{error.subject}: {error.what}", error.expected) from None
            del left[error.subject]
            notes.append(f"{error.subject} is as designed in {path.name}: {error.what}")
