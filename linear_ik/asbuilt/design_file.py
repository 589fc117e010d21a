"""The design file: opened to be changed, and written anew."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Any

from linear_ik.asbuilt.shape import AsBuiltError
from linear_ik.atomic import write_atomically

EXPECTED = "an IFC file (STEP), IFC2X3, IFC4 or IFC4X3"
# Names of drafts and first editions of IFC4X3, which have the same entities as far as they are used here.
EARLY_4X3 = (b"IFC4X3_RC1", b"IFC4X3_RC2", b"IFC4X3_RC3", b"IFC4X3_RC4", b"IFC4X3_ADD1", b"IFC4X3_TC1", b"IFC4X3")
LATEST_4X3 = b"IFC4X3_ADD2"
HEADER_BYTES = 65_536


def open_design(path: str | os.PathLike[str]) -> Any:
    """Return an IFC file as ifcopenshell's.

    Raises:
        AsBuiltError: no such file, or not one that can be read.
    """
    try:
        import ifcopenshell
    except ImportError:
        raise AsBuiltError("ifcopenshell", "is not installed", "pip install 'linear_ik[bim]'") from None
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise AsBuiltError(path, f"cannot be read: {error.strerror}", EXPECTED) from None
    content = content.removeprefix(b"\xef\xbb\xbf")
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise AsBuiltError(path, "is no STEP file", EXPECTED)
    head = content[:HEADER_BYTES]
    for name in EARLY_4X3:
        for quoted in (b"('%s')" % name, b"( '%s' )" % name):
            head = head.replace(quoted, b"('%s')" % LATEST_4X3)
    try:
        model = ifcopenshell.file.from_string((head + content[HEADER_BYTES:]).decode("latin-1"))
    except Exception as error:
        raise AsBuiltError(path, f"cannot be read: {error}", EXPECTED) from None
    if model is None or model.schema not in ("IFC2X3", "IFC4", "IFC4X3"):
        raise AsBuiltError(path, f"schema {getattr(model, 'schema', None)}", EXPECTED)
    return model


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
