"""LAS and LAZ, by laspy and lazrs; COPC by bounds.

laspy reads as many header records as the file claims, for hours if need be: their number is
checked here first, and what lazrs will allocate in laz_chunks. No LAS file says where a
scanner stood. What it withholds is not to be processed (LAS 1.4, classification flags), and
noise has classes of its own: both are left out.
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
from linear_ik.readers import copc
from linear_ik.readers.chunk import Array, Chunk, check_end, check_room
from linear_ik.readers.laz_chunks import check_chunks

SMALLEST_HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
RECORD_BYTES = 54
NOISE = (7, 18)  # classes of low and of high points
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


def read(path: Path, chunk_points: int, within: Array | None = None) -> Iterator[Chunk]:
    """Yield the points.

    Args:
        path: the file.
        chunk_points: most points of a chunk.
        within: [B][2][3] least and largest x, y and z of boxes in the file's coordinates, or None. Of a COPC
            file points elsewhere are left out, but for a few that show where it is; another one is read whole.

    Raises:
        ScanError: no LAS, damaged or incomplete data, or laspy isn't installed.
    """
    header = read_header(path)
    laspy = _needed(path, "laspy")
    # Without a handler of its own laspy's log goes to stderr.
    logging.getLogger("laspy").addHandler(logging.NullHandler())
    count = 0
    try:
        fields = laspy.DecompressionSelection.base().decompress_z().decompress_classification().decompress_flags()
        with laspy.open(path, read_evlrs=False, decompression_selection=fields) as file:
            scales, offsets = file.header.scales, file.header.offsets
            if not np.isfinite([scales, offsets]).all() or not scales.all():
                raise ScanError(path, f"scales {scales} and offsets {offsets}", "finite scales, not 0")
            if file.header.are_points_compressed:
                record = file.header.vlrs[file.header.vlrs.index("LasZipVlr")].record_data
                chunks = check_chunks(path, _needed(path, "lazrs"), record, header.start, header.points)
                # The parallel reader allocates whole chunks, whatever is asked for.
                parallel = all(most <= PARALLEL_CHUNK_POINTS for most, _ in chunks)
                octree = None if within is None else copc.info_of(file.header)
                if within is not None and octree is not None:
                    slack = float(np.abs(scales).max())
                    runs = copc.runs_within(path, octree, header.start, chunks, within, slack, chunk_points)
                    for points in _decompressed(path, file.header, record, runs, fields):
                        yield _chunk(points)
                    return
                file.laz_backend = laspy.LazBackend.LazrsParallel if parallel else laspy.LazBackend.Lazrs
            else:
                check_room(path, header.points, header.point_bytes, header.end - header.start)
                rest = header.end - header.start - header.points * header.point_bytes
                check_end(path, header.points, header.point_bytes, rest)
            for points in file.chunk_iterator(chunk_points):
                count += len(points)
                yield _chunk(points)
    except ScanError:
        raise
    except BaseException as error:
        # lazrs panics are no Exceptions.
        if isinstance(error, Exception) or type(error).__name__ == "PanicException":
            raise ScanError(path, f"cannot be read: {error}", WHOLE) from error
        raise
    if count != header.points:
        raise ScanError(path, f"ends after {count} of {header.points} points", WHOLE)


def _chunk(points: Any) -> Chunk:
    """Return laspy's points; those that are withheld or noise are none."""
    xyz = np.column_stack([points.x, points.y, points.z])
    xyz[np.asarray(points.withheld, dtype=bool) | np.isin(points.classification, NOISE)] = np.nan
    return Chunk(xyz)


def _decompressed(path: Path, header: Any, record: bytes, runs: list[copc.Run], fields: Any) -> Iterator[Any]:
    """Yield the points of runs of chunks as laspy's records.

    laspy's own query holds all points of a box at once, and goes round for ever where a page of
    the octree leads to itself; a seek of lazrs 0.8 is wrong where chunks differ in length.
    """
    import laspy
    import lazrs

    with path.open("rb") as file:
        for run in runs:
            file.seek(run.offset)
            out = np.zeros(run.points * header.point_format.size, dtype=np.uint8)
            lazrs.decompress_points_with_chunk_table(file.read(run.bytes), record, out, run.chunks, fields.to_lazrs())
            raw = laspy.PackedPointRecord.from_buffer(out, header.point_format)
            yield laspy.ScaleAwarePointRecord(raw.array, raw.point_format, header.scales, header.offsets)


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
