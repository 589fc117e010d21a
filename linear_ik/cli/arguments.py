"""Arguments and options that are files.

Whether a file can be read is said by who reads it, naming the file; typer's own check
comes first and names the option, so it is switched off.
"""

from __future__ import annotations

from typing import Any

import typer


def file_argument(metavar: str, about: str) -> Any:
    """Return a positional file."""
    return typer.Argument(metavar=metavar, help=about, readable=False)


def file_option(*names: str, metavar: str, about: str) -> Any:
    """Return a file behind an option."""
    return typer.Option(*names, metavar=metavar, help=about, readable=False)
