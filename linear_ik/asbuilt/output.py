"""The changed design file, written anew."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Any

from linear_ik.atomic import write_atomically


def write_model(model: Any, path: str | os.PathLike[str], when: datetime) -> Path:
    """Write a changed model, whole or not at all; the header keeps its author and says who changed it.

    Raises:
        OutputError: the file cannot be written.
    """
    from importlib.metadata import version

    name = model.header.file_name
    name.name = Path(path).name
    name.time_stamp = when.replace(microsecond=0, tzinfo=None).isoformat()
    name.preprocessor_version = f"linear_ik {version('linear_ik')}, IfcOpenShell {version('ifcopenshell')}"
    return write_atomically(path, model.to_string())
