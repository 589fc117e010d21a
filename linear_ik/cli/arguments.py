"""Arguments and options that are files.

Whether a file can be read is said by who reads it, naming the file; typer's own check
comes first and names the option, so it is switched off.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer


def file_argument(metavar: str, about: str) -> Any:
    """Return a positional file."""
    return typer.Argument(metavar=metavar, help=about, readable=False)


def unit_option(about: str = "Of the files' numbers, which become metres; else m.") -> Any:
    """Return the unit of scan files."""
    return typer.Option("--scan-unit", metavar="m|mm|cm|in|ft|us-ft", help=about, callback=_known_unit)


def _known_unit(unit: str | None) -> str | None:
    from linear_ik.coordinates import metres_of
    from linear_ik.errors import SettingsError

    try:
        metres_of(unit or "m")
    except SettingsError as error:
        raise error.about("--scan-unit") from None
    return unit


def transform_option() -> Any:
    """Return the file of the motion that takes a scan into the model's coordinates."""
    about = "4 x 4 numbers that take the scan into the model's coordinates."
    return file_option("--transform", metavar="T.txt", about=about)


def inverse_option() -> Any:
    """Return whether that motion is given the other way round."""
    return typer.Option("--inverse", help="T.txt takes the model into the scan's.")


def map_option() -> Any:
    """Return whether the design's map conversion says how the scan lies."""
    return typer.Option("--map", help="The scan is in the map's coordinates (IfcMapConversion).")


def design_first(path: Path) -> None:
    """Raise LinearIkError where a scan, by its ending, stands in the design's place."""
    from linear_ik.errors import LinearIkError
    from linear_ik.readers.registry import READERS

    if path.suffix.lower() in READERS:
        raise LinearIkError(path, "is a scan; the design comes first", "the design, then its scans")


def file_option(*names: str, metavar: str, about: str) -> Any:
    """Return a file behind an option."""
    return typer.Option(*names, metavar=metavar, help=about, readable=False)
