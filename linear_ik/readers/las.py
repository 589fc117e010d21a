"""LAS and LAZ, by laspy and lazrs.

laspy reads as many header records as the file claims, for hours if need be: their number is
checked here first, and what lazrs will allocate in laz_chunks. No LAS file says where a
scanner stood.
"""

from __future__ import annotations

import importlib
import logging
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Chunk, check_end, check_room
from linear_ik.readers.laz_chunks import check_chunks

SMALLEST_HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
RECORD_BYTES = 54
PARALLEL_CHUNK_POINTS = 1 << 20
WHOLE = "a complete LAS or LAZ file"


@dataclass(frozen=True)
class Header:
    """What the public header block of LAS 1.0 to 1.5 promises.

    Attributes:
        start: byte where the points begin.
        end: byte where they must have ended.
        points: how many there are.
        point_bytes: the length of one, uncompressed.
    """

    start: int
    end: int
    points: int
    point_bytes: int


def read(path: Path, chunk_points: int) -> Iterator[Chunk]:
    """Yield the points.

    Raises:
        ScanError: no LAS, damaged or incomplete data, or laspy isn't installed.
    """
    header = read_header(path)
    laspy = _needed(path, "laspy")
    # Without a handler of its own laspy's log goes to stderr.
    logging.getLogger("laspy").addHandler(logging.NullHandler())
    count = 0
    try:
        fields = laspy.DecompressionSelection.base().decompress_z()
        with laspy.open(path, read_evlrs=False, decompression_selection=fields) as file:
            scales, offsets = file.header.scales, file.header.offsets
            if not np.isfinite([scales, offsets]).all() or not scales.all():
                raise ScanError(path, f"scales {scales} and offsets {offsets}", "finite scales, not 0")
            if file.header.are_points_compressed:
                record = file.header.vlrs[file.header.vlrs.index("LasZipVlr")].record_data
                largest_chunk = check_chunks(path, _needed(path, "lazrs"), record, header.start, header.points)
                # The parallel reader allocates whole chunks, whatever is asked for.
                parallel = largest_chunk <= PARALLEL_CHUNK_POINTS
                file.laz_backend = laspy.LazBackend.LazrsParallel if parallel else laspy.LazBackend.Lazrs
            else:
                check_room(path, header.points, header.point_bytes, header.end - header.start)
                rest = header.end - header.start - header.points * header.point_bytes
                check_end(path, header.points, header.point_bytes, rest)
            for points in file.chunk_iterator(chunk_points):
                count += len(points)
                yield Chunk(np.column_stack([points.x, points.y, points.z]))
    except ScanError:
        raise
    except BaseException as error:
        # lazrs panics are no Exceptions.
        if isinstance(error, Exception) or type(error).__name__ == "PanicException":
            raise ScanError(path, f"cannot be read: {error}", WHOLE) from error
        raise
    if count != header.points:
        raise ScanError(path, f"ends after {count} of {header.points} points", WHOLE)


def read_header(path: Path) -> Header:
    """Read and check the numbers on which laspy relies.

    Raises:
        ScanError: no LAS header, or one that doesn't fit the file.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        raw = file.read(max(SMALLEST_HEADER_BYTES.values()))
    if not raw.startswith(b"LASF"):
        raise ScanError(path, "no LAS file: it doesn't begin with LASF", WHOLE)
    major, minor = raw[24:26] if len(raw) > 25 else (1, 0)
    if major != 1 or minor not in SMALLEST_HEADER_BYTES:
        raise ScanError(path, f"LAS version {major}.{minor}", "1.0 to 1.5")
    smallest = SMALLEST_HEADER_BYTES[minor]
    if len(raw) < smallest:
        raise ScanError(path, "ends inside the LAS header", WHOLE)
    header_bytes, start, records, _, point_bytes, points = struct.unpack_from("<HIIBHI", raw, 94)
    ends = [size]
    if minor >= 3:
        ends += struct.unpack_from("<Q", raw, 227)
    if minor >= 4:
        first_evlr, evlrs, points = struct.unpack_from("<QIQ", raw, 235)
        ends += [first_evlr] if evlrs else []
    if not smallest <= header_bytes <= start <= size or not point_bytes:
        raise ScanError(path, f"the header says that points begin at byte {start} of {size}", WHOLE)
    check_room(path, records, RECORD_BYTES, start - header_bytes, "header records")
    return Header(start, min(end for end in ends if end >= start), points, point_bytes)


def _needed(path: Path, module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ScanError(path, f"reading it needs {module}", 'pip install "linear_ik[scan]"') from None
