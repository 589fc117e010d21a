"""PLY: text and both binary byte orders, in double precision, in chunks.

Open3D reads a PLY whole, prints what is wrong and gives an empty cloud; the libraries made
for the format read it whole as well. A vertex is a numpy record, so numpy reads it.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array, Chunk, check_end, check_room
from linear_ik.readers.ply_header import Element, Header, read_header
from linear_ik.readers.text import Lines, rows


def read(path: Path, chunk_points: int) -> Iterator[Chunk]:
    """Yield the vertices, with their normals when they have any.

    Raises:
        ScanError: no PLY, no vertices with x, y and z, or not the number of elements that the header says.
    """
    with path.open("rb") as file:
        header = read_header(path, file)
        vertex = next((e for e in header.elements if e.name == "vertex"), None)
        if vertex is None or not vertex.columns("x", "y", "z"):
            raise ScanError(path, "the PLY header has no vertex element with x, y and z", "points")
        columns = vertex.columns("x", "y", "z") + vertex.columns("nx", "ny", "nz")
        moved_by_lists = vertex.properties[: max(columns)] if header.is_ascii else vertex.properties
        if any(p.count_kind for p in moved_by_lists):
            raise ScanError(path, "the vertices hold lists", "numbers only")
        tables = _text if header.is_ascii else _binary
        for table in tables(path, file, header, columns, chunk_points):
            yield Chunk(table[:, :3], table[:, 3:] if len(columns) == 6 else None)


def _text(path: Path, file: BinaryIO, header: Header, columns: list[int], chunk_points: int) -> Iterator[Array]:
    size = path.stat().st_size
    lines = Lines(path, file, chunk_points, header.lines)
    for element in header.elements:
        # A value takes a digit and a separator, but for the last one of the file.
        smallest_row = 2 * len(element.properties)
        check_room(path, element.count, smallest_row, size + 1 - file.tell(), f"{element.name} rows")
        if element.name == "vertex":
            yield from rows(lines, columns, None, element.count)
        elif element.properties:
            for _ in rows(lines, [0], None, element.count):
                pass
    while (line := lines.line()) is not None:
        if line:
            raise ScanError(path, f"line {lines.number} comes after all that the header counts", "the end")


def _binary(path: Path, file: BinaryIO, header: Header, columns: list[int], chunk_points: int) -> Iterator[Array]:
    size, start = path.stat().st_size, file.tell()
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        starts = {}
        for element in header.elements:
            starts[element.name] = start
            start = _end(path, data, element, start)
    vertex = next(e for e in header.elements if e.name == "vertex")
    check_end(path, vertex.count, vertex.row.itemsize, size - start)
    file.seek(starts["vertex"])
    for first in range(0, vertex.count, chunk_points):
        records = np.fromfile(file, vertex.row, min(chunk_points, vertex.count - first))
        yield np.column_stack([records[f"f{c}"].astype(np.float64, copy=False) for c in columns])


def _end(path: Path, data: mmap.mmap, element: Element, start: int) -> int:
    """Return where the rows of a binary element end, walking through their lists."""
    what = f"{element.name} elements"
    check_room(path, element.count, element.smallest_row_bytes, len(data) - start, what)
    if not element.has_lists:
        return start + element.count * element.smallest_row_bytes
    sizes = [np.dtype(p.kind).itemsize for p in element.properties]
    counts = [p.count_kind and struct.Struct(p.count_kind[0] + np.dtype(p.count_kind).char) for p in element.properties]
    at = start
    try:
        for _ in range(element.count):
            for size, count in zip(sizes, counts, strict=True):
                at += count.size + max(count.unpack_from(data, at)[0], 0) * size if count else size
    except struct.error:
        at = len(data) + 1
    if at > len(data):
        raise ScanError(path, f"the header says {element.count} {what}, the file ends before", "a complete file")
    return at
