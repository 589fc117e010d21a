"""PCD: ascii, binary and binary_compressed, in double precision.

Open3D's reader takes 8-byte coordinates for 4-byte ones (5000 km off at UTM coordinates, and
no word of it) and turns a corrupt file into an empty cloud, so numpy reads the records here.
VIEWPOINT is not taken for a station: nearly every program writes zeros there.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array, Chunk, check_end, check_room, count_from
from linear_ik.readers.lzf import LARGEST_RATIO, decompress
from linear_ik.readers.text import Lines, rows

KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
KINDS = ("F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8")
MOST_LINES = 1 << 10
LONGEST_LINE = 1 << 14


@dataclass(frozen=True)
class Field:
    """One field of a point: ``count`` values of ``kind`` (numpy's name of the type)."""

    name: str
    kind: str
    count: int

    @property
    def size_bytes(self) -> int:
        """The length of the field in a binary point."""
        return self.count * np.dtype(self.kind).itemsize


@dataclass(frozen=True)
class Header:
    """A PCD header.

    Attributes:
        fields: of every point, in file order.
        wanted: indices of the fields x, y, z, and after them of the normal if there is one.
        points: how many points the file has.
        encoding: ascii, binary or binary_compressed.
        lines: how many lines the header has.
    """

    fields: tuple[Field, ...]
    wanted: tuple[int, ...]
    points: int
    encoding: str
    lines: int

    @property
    def point_bytes(self) -> int:
        """The length of a binary point."""
        return sum(f.size_bytes for f in self.fields)


def read(path: Path, chunk_points: int) -> Iterator[Chunk]:
    """Yield the points, with their normals when they have any.

    Raises:
        ScanError: no PCD, no fields x, y and z, or not the number of points that the header says.
    """
    with path.open("rb") as file:
        header = read_header(path, file)
        tables = ENCODINGS[header.encoding]
        for table in tables(path, file, header, chunk_points):
            yield Chunk(table[:, :3], table[:, 3:] if len(header.wanted) == 6 else None)


def read_header(path: Path, file: BinaryIO) -> Header:
    """Read the header and leave ``file`` at the data.

    Raises:
        ScanError: no PCD header, or one that describes no points.
    """
    found: dict[str, list[str]] = {}
    number = 0
    while "DATA" not in found:
        raw = file.readline(LONGEST_LINE)
        number += 1
        words = raw.decode("latin-1").split()
        if words and not words[0].startswith("#"):
            if words[0] not in KEYS:
                raise ScanError(path, f"line {number} is no line of a PCD header: {ascii(words[0][:40])}", "PCD 0.7")
            found[words[0]] = words[1:]
        if not raw.endswith(b"\n") or number > MOST_LINES:
            raise ScanError(path, "the PCD header has no end", "a line DATA, and points after it")
    width, height = (_number(path, found, key, "1") for key in ("WIDTH", "HEIGHT"))
    points = _number(path, found, "POINTS", str(width * height))
    if "WIDTH" in found and points != width * height:
        raise ScanError(path, f"the header says {points} points, but {width} x {height}", "POINTS = WIDTH x HEIGHT")
    encoding = " ".join(found["DATA"]).lower()
    if encoding not in ENCODINGS:
        raise ScanError(path, f"DATA is {encoding[:40]!a}", ", ".join(ENCODINGS))
    return Header(*_fields(path, found), points, encoding, number)


def _number(path: Path, found: dict[str, list[str]], key: str, default: str) -> int:
    return count_from(path, " ".join(found.get(key, [default])), key)


def _fields(path: Path, found: dict[str, list[str]]) -> tuple[tuple[Field, ...], tuple[int, ...]]:
    names = [name.lower() for name in found.get("FIELDS", [])]
    if not {"x", "y", "z"} <= set(names):
        raise ScanError(path, "the PCD header has no fields x, y and z", "FIELDS x y z")
    wanted = [names.index(name) for name in "xyz"]
    if {"normal_x", "normal_y", "normal_z"} <= set(names):
        wanted += [names.index(f"normal_{axis}") for axis in "xyz"]
    kinds = [kind + size for kind, size in zip(found.get("TYPE", []), found.get("SIZE", []), strict=False)]
    counts = [count_from(path, count, "COUNT") for count in found.get("COUNT", ["1"] * len(names))]
    if not len(names) == len(kinds) == len(counts):
        raise ScanError(path, "FIELDS, SIZE, TYPE and COUNT differ in length", "one value a field")
    for name, kind, count in zip(names, kinds, counts, strict=True):
        if kind not in KINDS:
            raise ScanError(path, f"field {name[:40]!a} has TYPE and SIZE {kind[:9]!a}", ", ".join(KINDS))
        if count != 1 and names.index(name) in wanted:
            raise ScanError(path, f"field {name} has COUNT {count}", "1")
    # PCD's types are numpy's, but for the letter's case.
    fields = tuple(Field(n, f"<{k.lower()}", c) for n, k, c in zip(names, kinds, counts, strict=True))
    return fields, tuple(wanted)


def _text(path: Path, file: BinaryIO, header: Header, chunk_points: int) -> Iterator[Array]:
    columns = [0, *itertools.accumulate(f.count for f in header.fields)]
    # A value takes a digit and a separator, but for the last one of the file.
    check_room(path, header.points, 2 * columns[-1], path.stat().st_size + 1 - file.tell())
    lines = Lines(path, file, chunk_points, header.lines)
    yield from rows(lines, [columns[i] for i in header.wanted], None, header.points)
    while (line := lines.line()) is not None:
        if line:
            raise ScanError(path, f"line {lines.number} comes after all that the header counts", "the end")


def _binary(path: Path, file: BinaryIO, header: Header, chunk_points: int) -> Iterator[Array]:
    left = path.stat().st_size - file.tell()
    check_room(path, header.points, header.point_bytes, left)
    check_end(path, header.points, header.point_bytes, left - header.points * header.point_bytes)
    starts = [0, *itertools.accumulate(f.size_bytes for f in header.fields)]
    point = np.dtype(
        {
            "names": [f"f{i}" for i in header.wanted],
            "formats": [header.fields[i].kind for i in header.wanted],
            "offsets": [starts[i] for i in header.wanted],
            "itemsize": header.point_bytes,
        }
    )
    for first in range(0, header.points, chunk_points):
        part = np.fromfile(file, point, min(chunk_points, header.points - first))
        yield np.column_stack([part[name].astype(np.float64) for name in point.names or ()])


def _compressed(path: Path, file: BinaryIO, header: Header, chunk_points: int) -> Iterator[Array]:
    """Yield the points of a body that holds field after field, each of all points."""
    left = path.stat().st_size - file.tell() - 8
    if left < 0:
        raise ScanError(path, "ends before its points", "a complete file")
    packed, size = struct.unpack("<II", file.read(8))
    check_room(path, packed, 1, left, "compressed bytes")
    check_room(path, header.points, header.point_bytes, int(packed * LARGEST_RATIO))
    if size != header.points * header.point_bytes:
        raise ScanError(path, f"the header says {header.points} points, the body has {size} bytes", "both the same")
    try:
        body = decompress(file.read(packed), size)
    except ValueError as error:
        raise ScanError(path, f"the compressed points are damaged: {error}", "a complete file") from None
    starts = [0, *itertools.accumulate(f.size_bytes * header.points for f in header.fields)]
    columns = [np.frombuffer(body, header.fields[i].kind, header.points, starts[i]) for i in header.wanted]
    for first in range(0, header.points, chunk_points):
        yield np.column_stack([column[first : first + chunk_points].astype(np.float64) for column in columns])


ENCODINGS = {"ascii": _text, "binary": _binary, "binary_compressed": _compressed}
