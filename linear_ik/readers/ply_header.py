"""The header of a PLY file: which elements it has, how many of each, and their properties."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import count_from

FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
COUNTS = [name for name, kind in TYPES.items() if kind[0] in "iu"]
LONGEST_LINE = 1 << 12
MOST_LINES = 1 << 12


@dataclass(frozen=True)
class Property:
    """One value of an element, or a list of values with their count ahead.

    Attributes:
        name: in lower case.
        kind: numpy's name of the type, byte order included.
        count_kind: that of a list's count, or None when this is no list.
    """

    name: str
    kind: str
    count_kind: str | None = None


@dataclass(frozen=True)
class Element:
    """A table of the file: ``count`` rows of ``properties``."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @cached_property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(p.count_kind for p in self.properties)

    @cached_property
    def smallest_row_bytes(self) -> int:
        """The length of a binary row whose lists are empty."""
        return sum(np.dtype(p.count_kind or p.kind).itemsize for p in self.properties)

    @cached_property
    def row(self) -> np.dtype[np.void]:
        """A row without lists; the fields are f0, f1, ... because names may repeat."""
        return np.dtype([(f"f{i}", p.kind) for i, p in enumerate(self.properties)])

    def columns(self, *names: str) -> list[int]:
        """Return the columns of the named properties, or nothing unless all are there."""
        own = [p.name for p in self.properties]
        return [own.index(name) for name in names] if set(names) <= set(own) else []


@dataclass(frozen=True)
class Header:
    """A PLY header.

    Attributes:
        is_ascii: whether the data is text.
        elements: in file order.
        lines: how many lines the header has.
    """

    is_ascii: bool
    elements: tuple[Element, ...]
    lines: int


def read_header(path: Path, file: BinaryIO) -> Header:
    """Read the header and leave ``file`` at the data.

    Raises:
        ScanError: no PLY header, or one with an unknown format, type or line.
    """
    order: str | None = None
    elements: list[tuple[str, int, list[Property]]] = []
    for number in range(1, MOST_LINES):
        raw = file.readline(LONGEST_LINE)
        words = raw.decode("latin-1").split()
        if number == 1 and words != ["ply"]:
            raise ScanError(path, "no PLY file: it doesn't begin with ply", "a PLY header")
        if not raw.endswith(b"\n"):
            break
        match words:
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, count]:
                elements.append((name, count_from(path, count, f"the number of {name} elements"), []))
            case ["property", "list", count_kind, kind, name] if count_kind in COUNTS and kind in TYPES and elements:
                elements[-1][2].append(Property(name.lower(), TYPES[kind], TYPES[count_kind]))
            case ["property", kind, name] if kind in TYPES and elements:
                elements[-1][2].append(Property(name.lower(), TYPES[kind]))
            case ["end_header"]:
                if order is None:
                    raise ScanError(path, "the PLY header names no format", ", ".join(FORMATS))
                ordered = tuple(Element(n, c, tuple(_in_order(p, order) for p in ps)) for n, c, ps in elements)
                return Header(order == FORMATS["ascii"], ordered, number)
            case _:
                raise ScanError(path, f"line {number} is no line of a PLY header: {' '.join(words)[:60]!a}", "PLY 1.0")
    raise ScanError(path, "the PLY header has no end", "end_header")


def _in_order(p: Property, order: str) -> Property:
    return Property(p.name, order + p.kind, p.count_kind and order + p.count_kind)
