"""LAS and LAZ, by laspy and lazrs.

lazrs allocates what a LAZ file's chunk table asks for and ends the process when it cannot, and
laspy reads as many header records as the file claims, for hours if need be: those numbers are
checked here first. No LAS file says where a scanner stood.
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
                largest_chunk = _check_chunk_table(path, header, file.header)
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


def _check_chunk_table(path: Path, header: Header, las_header: Any) -> int:
    """Check a LAZ file's table of chunks against its size; return the points of the largest chunk.

    Raises:
        ScanError: the table isn't in the file, or has more in it than the file.
    """
    if not header.points:
        return 0
    lazrs = _needed(path, "lazrs")
    vlr = lazrs.LazVlr(las_header.vlrs[las_header.vlrs.index("LasZipVlr")].record_data)
    with path.open("rb") as file:
        file.seek(header.start)
        table = int.from_bytes(file.read(8), "little", signed=True)
        if table == -1:
            # Written to a pipe: the offset is at the end.
            file.seek(-8, 2)
            table = int.from_bytes(file.read(8), "little", signed=True)
        data_bytes = table - header.start - 8
        if data_bytes < 0 or table + 8 > path.stat().st_size:
            raise ScanError(path, f"its chunk table is said to be at byte {table}", WHOLE)
        file.seek(table + 4)
        # Every chunk begins with a point that isn't compressed.
        check_room(path, int.from_bytes(file.read(4), "little"), header.point_bytes, data_bytes, "chunks")
        file.seek(header.start)
        chunks = lazrs.read_chunk_table(file, vlr)
    check_room(path, sum(size for _, size in chunks), 1, data_bytes, "compressed bytes")
    most = sum(points for points, _ in chunks)
    least = most if vlr.uses_variable_size_chunks() else most - vlr.chunk_size() + 1
    if not least <= header.points <= most:
        raise ScanError(path, f"the header says {header.points} points, the chunks hold {least} to {most}", WHOLE)
    return max(int(points) for points, _ in chunks)


def _needed(path: Path, module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ScanError(path, f"reading it needs {module}", 'pip install "linear_ik[scan]"') from None
