"""Files in, Scan out: which reader reads what, and what all of them have in common.

A new format is a module with a function ``read(path, chunk_points)`` that yields Chunks, and a
line in READERS.
"""

from __future__ import annotations

import difflib
import os
import stat
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from linear_ik.coordinates import metres_of
from linear_ik.errors import ScanError, SettingsError
from linear_ik.readers import e57, las, pcd, ply, ptx, xyz
from linear_ik.readers.chunk import Array, Chunk, Reader
from linear_ik.scan import Scan, Strays, merge

READERS: dict[str, Reader] = {
    ".asc": xyz.read,
    ".csv": xyz.read,
    ".e57": e57.read,
    ".las": las.read,
    ".laz": las.read,
    ".pcd": pcd.read,
    ".ply": ply.read,
    ".pts": xyz.read,
    ".ptx": ptx.read,
    ".txt": xyz.read,
    ".xyz": xyz.read,
}
# Readers that can leave out what is not wanted.
BY_BOUNDS = {".las": las.read, ".laz": las.read}
CHUNK_POINTS = 250_000
# How files of these formats begin, to name a file that has the wrong extension.
BEGINNINGS = {
    b"ply\n": ("PLY", (".ply",)),
    b"ply\r": ("PLY", (".ply",)),
    b"# .PCD": ("PCD", (".pcd",)),
    b"LASF": ("LAS", (".las", ".laz")),
    b"ASTM-E57": ("E57", (".e57",)),
    b"PK\x03\x04": ("zip", ()),
    b"\x1f\x8b": ("gzip", ()),
    b"ISO-10303-21": ("IFC", ()),
}


def read_scan(*paths: str | os.PathLike[str], unit: str | None = None) -> Scan:
    """Read one or more files as one scan.

    Args:
        paths: PLY, PCD, XYZ/TXT/CSV/ASC, PTS, PTX, LAS/LAZ or E57, told apart by extension.
        unit: of the files' numbers: m, mm, cm, in, ft or us-ft, whatever a comment in them says. None: metres, and a
            file that states another unit is refused. What is returned is in metres.

    Returns:
        All points in metres, in the files' global coordinates; stations where every file has them,
        normals likewise; ``left_out`` says how many had no finite coordinates up to 1e8 m, or were
        withheld or noise as a LAS file says.

    Raises:
        ScanError: about the file that is missing, unknown, damaged, without points or in another unit, as it says.
        SettingsError: another ``unit``.
    """
    return merge(part for path in paths for part in iter_scan(path, unit=unit))


def iter_scan(
    path: str | os.PathLike[str], chunk_points: int = CHUNK_POINTS, within: Array | None = None, unit: str | None = None
) -> Iterator[Scan]:
    """Read a file piece by piece, in file order; memory depends on ``chunk_points`` alone.

    (Of a binary_compressed PCD the body is decompressed as a whole.) A piece comes from one
    station, so its ``stations`` has one row or is None.

    Args:
        path: as for read_scan.
        chunk_points: most points of a piece.
        within: [B][2][3] least and largest x, y and z of boxes, metres. Points in none of them may be left out, and
            are where the file says what of it is where (COPC); some that show where the scan is stay.
        unit: as for read_scan.

    Raises:
        ScanError: at once for what can be seen from outside, later for what turns up inside.
        SettingsError: ``chunk_points`` below 1, another ``unit``.
    """
    if chunk_points < 1:
        raise SettingsError("chunk_points", str(chunk_points), "at least 1")
    one_m = metres_of(unit or "m")
    path = Path(path)
    reader = _reader(path)
    if within is not None and path.suffix.lower() in BY_BOUNDS:
        reader = partial(BY_BOUNDS[path.suffix.lower()], within=within / one_m)
    if unit is not None and reader is xyz.read:
        reader = partial(xyz.read, remarks=False)
    return _scans(path, reader, chunk_points, unit or "m")


def _reader(path: Path) -> Reader:
    """Return the reader for a file that can be opened and looks like its extension."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise ScanError(path, "is a folder", f"a scan file: {', '.join(READERS)}")
        # Opening a pipe or a device may wait for ever.
        if not stat.S_ISREG(mode):
            raise ScanError(path, "is no regular file", "a file")
        with path.open("rb") as file:
            head = file.read(16)
    except FileNotFoundError:
        raise ScanError(path, "no such file", _near(path)) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ScanError(path, f"cannot be opened: {reason}", "a readable file") from None
    suffix = path.suffix.lower()
    kind, suffixes = next((v for k, v in BEGINNINGS.items() if head.startswith(k)), ("", ()))
    if suffix not in READERS:
        nearest = difflib.get_close_matches(suffix, READERS, n=1, cutoff=0.7)
        guess = suffixes[:1] or tuple(nearest)
        expected = ", ".join(READERS) if not guess else f"{guess[0]}? one of {', '.join(READERS)}"
        raise ScanError(path, f"unknown extension {suffix!r}" if suffix else "no extension", expected)
    if not head:
        raise ScanError(path, "is empty", "points")
    if kind and suffix not in suffixes:
        raise ScanError(path, f"holds {kind} data", f"the contents of a {suffix} file")
    return READERS[suffix]


def _near(path: Path) -> str:
    """Return a hint at the file that may have been meant."""
    try:
        names = difflib.get_close_matches(path.name, os.listdir(path.parent), n=1, cutoff=0.75)
    except OSError:
        names = []
    return f"{names[0]}?" if names else "an existing file"


def _scans(path: Path, reader: Reader, chunk_points: int, unit: str) -> Iterator[Scan]:
    # One piece is kept back: points that are none may follow the last one that has any.
    kept, left_out, strays = None, 0, Strays()
    try:
        for chunk in reader(path, chunk_points):
            if chunk.unit and chunk.unit != unit:
                meant = "" if unit == "m" else f", not {unit}"
                what = "it says that it is not in metres" if unit == "m" else "it says that it is in another unit"
                raise ScanError(path, f"{what}: its numbers are in {chunk.unit}{meant}", f"--scan-unit {chunk.unit}")
            for first in range(0, len(chunk.points), chunk_points):
                rows = slice(first, first + chunk_points)
                scan = _scan(chunk, rows, metres_of(unit), strays)
                left_out += len(chunk.points[rows]) - (0 if scan is None else len(scan))
                if scan is None:
                    continue
                if kept is not None:
                    yield kept
                kept, left_out = replace(scan, left_out=left_out) if left_out else scan, 0
        strays.check()
    except OSError as error:
        raise ScanError(path, f"cannot be read: {error.strerror or error}", "a readable file") from error
    except ScanError as error:
        raise error if error.subject == str(path) else error.about(path) from None
    if kept is None:
        marked = " that is neither withheld nor noise" if path.suffix.lower() in BY_BOUNDS else ""
        raise ScanError(path, f"no point with finite coordinates{marked}", "at least one")
    yield replace(kept, left_out=kept.left_out + left_out) if left_out else kept


def _scan(chunk: Chunk, rows: slice, unit_m: float, strays: Strays) -> Scan | None:
    """Return the points of some rows in metres, without those that are none, or None when none is left."""
    # Times one is left out: it would cost a copy.
    points = chunk.points[rows] if unit_m == 1.0 else chunk.points[rows] * unit_m
    keep = strays.apart_from(points)
    if not keep.any():
        return None
    points = points[keep]
    has_station = chunk.station is not None
    return Scan(
        points=points,
        normals=None if chunk.normals is None else _unit(chunk.normals[rows][keep]),
        stations=None if chunk.station is None else chunk.station[None] * unit_m,
        station_index=np.zeros(len(points), dtype=np.int32) if has_station else None,
    )


def _unit(normals: Array) -> Array:
    """Return normals [P][3] of length 1; zeros where there is no direction."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    known = np.isfinite(length) & (length > 0)
    unit: Array = np.divide(normals, length, out=np.zeros_like(normals), where=known)
    return unit
