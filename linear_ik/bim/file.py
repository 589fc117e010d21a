"""IFC files in, whatever their header says: versions, byte order marks, zip archives."""

from __future__ import annotations

import os
import re
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from linear_ik.errors import DesignError

EXPECTED = "an IFC file: .ifc or .ifczip"
BOM = b"\xef\xbb\xbf"
BEGINNING = b"ISO-10303-21;"
END = b"END-ISO-10303-21"
HEADER_BYTES = 64 * 1024  # some writers tell their life's story before FILE_SCHEMA
TAIL_BYTES = 4096
LARGEST_BYTES = 4 << 30
# As a header may say it -> as the library knows it. IFC4X3's editions differ in what is no linear element.
READ_AS = (
    (re.compile(r"IFC2X3(_.+)?"), "IFC2X3"),
    (re.compile(r"IFC4(_.+)?"), "IFC4"),
    (re.compile(r"IFC4X3(_.+)?"), "IFC4X3_ADD2"),
)
_SCHEMA = re.compile(rb"FILE_SCHEMA\s*\(\s*\(\s*'([^']*)'", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class ModelFile:
    """An IFC file that has been read.

    Attributes:
        path: where it was.
        schema: as its header says it, such as IFC4X3_ADD1.
        model: ifcopenshell's file.
    """

    path: Path
    schema: str
    model: Any


def open_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read an IFC file.

    Args:
        path: .ifc, or .ifczip (a zip archive with one .ifc in it).

    Raises:
        DesignError: said of the file: missing, empty, no IFC, cut off, a version that is not read.
    """
    path = Path(path)
    library = import_library(path)
    data = _read(path)
    if data.startswith(b"PK\x03\x04"):
        data = _unpack(path, data)
    plain = data.removeprefix(BOM).lstrip()
    if not plain:
        raise DesignError(path, "is empty", EXPECTED)
    if not plain.startswith(BEGINNING):
        raise DesignError(path, "is not an IFC file", f"{EXPECTED}, which begins with {BEGINNING.decode()}")
    if END not in plain[-TAIL_BYTES:]:
        raise DesignError(path, "is cut off", f"a last line {END.decode()};")
    said = _SCHEMA.search(plain[:HEADER_BYTES])
    if said is None:
        raise DesignError(path, "does not name its version", "FILE_SCHEMA(('IFC4')) or the like in its header")
    schema = said.group(1).decode("ascii", "replace").strip().upper()
    known = next((name for pattern, name in READ_AS if pattern.fullmatch(schema)), None)
    if known is None:
        raise DesignError(path, f"is of version {schema or repr('')}", "IFC2X3, IFC4 or IFC4X3")
    # What the library reads by itself it reads fastest from where it is.
    as_it_is = path.suffix.lower() == ".ifc" and len(plain) == len(data) and said.group(1).decode() == known
    if not as_it_is:
        plain = plain[: said.start(1)] + known.encode() + plain[said.end(1) :]
    return ModelFile(path, schema, _parse(path, library, None if as_it_is else plain))


def import_library(path: Path) -> Any:
    """Return ifcopenshell.

    Raises:
        DesignError: said of the file that needs it: it is not installed.
    """
    try:
        import ifcopenshell
    except ImportError:
        raise DesignError(path, "reading it needs ifcopenshell", 'pip install "linear_ik[bim]"') from None
    return ifcopenshell


def _read(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise DesignError(path, "is a folder", EXPECTED)
        if path.exists() and not path.is_file():
            raise DesignError(path, "is no regular file", EXPECTED)
        if path.exists() and path.stat().st_size > LARGEST_BYTES:
            raise DesignError(path, "is larger than 4 GB", "a model of one building")
        return path.read_bytes()
    except FileNotFoundError:
        raise DesignError(path, "no such file", EXPECTED) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise DesignError(path, f"cannot be opened: {reason}", "a readable file") from None


def _unpack(path: Path, data: bytes) -> bytes:
    import io

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            inside = [i for i in archive.infolist() if not i.is_dir() and i.filename.lower().endswith(".ifc")]
            if len(inside) != 1:
                raise DesignError(path, f"holds {len(inside)} .ifc files", "a zip archive with one")
            if inside[0].file_size > LARGEST_BYTES:
                raise DesignError(path, "unpacks to more than 4 GB", "a model of one building")
            return archive.read(inside[0])
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError, EOFError) as error:
        raise DesignError(path, f"is a damaged zip archive: {error}", EXPECTED) from None


def _parse(path: Path, library: Any, data: bytes | None) -> Any:
    """Return the model in the file at ``path``, or in ``data`` where the file itself is not readable as it is."""
    try:
        if data is None:
            model = library.open(str(path))
        else:
            with tempfile.TemporaryDirectory(prefix="linear_ik-") as folder:
                mended = Path(folder) / "model.ifc"
                mended.write_bytes(data)
                model = library.open(str(mended))
    except (library.Error, OSError, RuntimeError, ValueError) as error:
        raise DesignError(path, f"cannot be read: {error}", EXPECTED) from None
    if not model.by_type("IfcProject"):
        raise DesignError(path, "holds no IfcProject", "a whole IFC model")
    return model
