"""XYZ, TXT, CSV, ASC and PTS: one point a line, columns found by their names or taken as x y z.

A line with nothing but a whole number counts the points that follow (PTS); several such
clouds may stand one after another. Further columns (intensity, colour, normals) are not
read. No file of this kind says where the scanner stood.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Chunk, check_room, count_from
from linear_ik.readers.text import DECIMAL_COMMA, Lines, fields, is_number, not_a_number, rows

DELIMITERS = (";", ",", "\t", None)
NAMES = (
    ("x", "y", "z"),
    ("easting", "northing", "elevation"),
    ("easting", "northing", "height"),
    ("easting", "northing", "z"),
    ("east", "north", "height"),
    ("e", "n", "h"),
    ("e", "n", "z"),
    ("points:0", "points:1", "points:2"),
)
AFFIX = re.compile(r"^(?:pos|position|coord|coordinate|point)[ _.]|[ _](?:pos|coord|coordinate)$")
UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")
APART = re.compile(r"\s*" + UNIT.pattern)
# x_mm is x[mm].
TAIL = re.compile(r"(?<=\w)[ _](m|mm|cm|ft|in|us-?ft|inch|feet)$")
# A remark on the unit of the coordinates: "units: mm", "coordinates in feet"; not on that of anything else.
_WORD = r"\s*[\[(\"']?([a-z\x80-\xff][\w.\x80-\xff-]*(?:[ _](?:survey[ _])?(?:feet|foot|ft|us)\b)?)(?![\w/^*])"
OF_THE_FILE = re.compile(
    r"(?i)\bunits?(?:\s+of\s+(?:length|coordinates|measure(?:ment)?))?(?:\s*(?:[:=]|is\b|are\b|in\b))+" + _WORD
)
OF_COORDINATES = re.compile(r"(?i)\b(?:coordinates|coords|points|xyz)\s+(?:are\s+)?(?:given\s+)?in" + _WORD)
# Lengths that are no unit of a scan here: what names one is not in metres either. A micro sign has one byte or two.
OTHER_LENGTHS = re.compile(
    r"km|dm|(?:u|[\x80-\xff]{1,2})m|nm|microns?|mils?|yards?|yds?|miles?|(?:kilo|hecto|deca|deci|micro|nano)met(?:er|re)s?"
)
NAMED = {
    "m": ("m", "metre", "metres", "meter", "meters"),
    "mm": ("mm", "millimetre", "millimetres", "millimeter", "millimeters"),
    "cm": ("cm", "centimetre", "centimetres", "centimeter", "centimeters"),
    "in": ("in", "inch", "inches"),
    "ft": ("ft", "foot", "feet", "international feet", "international foot"),
    "us-ft": (
        *("us-ft", "usft", "ftus", "us ft", "us feet", "us foot", "foot us", "us survey feet", "us survey foot"),
        *("us survey ft", "survey feet", "survey foot"),
    ),
}
SMALLEST_ROW = len("0 0 0\n")
NEITHER = "a header with x, y and z, or numbers"


@dataclass(frozen=True)
class Layout:
    """Where a line keeps its point: the separator, the columns of x, y and z, and the unit that they name."""

    delimiter: str | None
    columns: tuple[int, int, int]
    unit: str = ""


def read(path: Path, chunk_points: int, remarks: bool = True) -> Iterator[Chunk]:
    """Yield the points of a text file.

    Args:
        path: of the file.
        chunk_points: most points of a chunk.
        remarks: comments that state a unit count; not where the person has said it. Names of columns always do.

    Raises:
        ScanError: a header without x, y and z, a unit that is not known, a decimal comma, a row
            that is no point, or not the number of points that the file states.
    """
    with path.open("rb") as file:
        if file.read(2) in (b"\xff\xfe", b"\xfe\xff"):
            raise ScanError(path, "UTF-16 text", "ASCII or UTF-8")
        file.seek(0)
        lines = Lines(path, file, chunk_points)
        layout, count = _preamble(lines, file, remarks)
        while True:
            for part in rows(lines, layout.columns, layout.delimiter, count):
                yield Chunk(part, unit=layout.unit)
            count = None if count is None else _next_count(lines, file)
            if count is None:
                return


def find_layout(
    path: Path, number: int, line: str, header: str, comments: Sequence[str], stated: Sequence[str] = ()
) -> Layout | None:
    """Return how ``line`` holds a point, or None if it doesn't.

    Args:
        path: the file, for errors.
        number: the line's number, for errors.
        line: the line that may be the first point.
        header: the line of names above it, or empty.
        comments: the comments above it that may name the columns.
        stated: units that other comments state.

    Raises:
        ScanError: a unit that is not known, a decimal comma.
    """
    commas = [DECIMAL_COMMA.fullmatch(token.rstrip(",;")) for token in re.split(r"[;\s]+", line)[:3]]
    if len(commas) == 3 and all(commas):
        raise not_a_number(path, number, re.split(r"[;\s]+", line)[0].rstrip(",;"))
    for delimiter in DELIMITERS:
        values = fields(line, delimiter)
        names, columns = [], (0, 1, 2)
        for text in [header] if header else comments:
            names = _split_names(text, delimiter, len(values))
            columns = _axes(names) or columns
            if names:
                break
        if header and not names:
            continue
        if len(values) > max(columns) and all(is_number(values[column]) for column in columns):
            named = [names[column] for column in columns] if names else []
            # A unit counts wherever it is named, in a comment too wide or too narrow for the columns as well.
            loose = [name for text in [header, *comments] for name in _axes_with_units(text)]
            unit = _unit(path, [*named, *loose, *(f"[{unit}]" for unit in stated)])
            return Layout(delimiter, columns, unit)
    return None


def _preamble(lines: Lines, file: BinaryIO, remarks: bool) -> tuple[Layout, int | None]:
    """Read on to the first point; return how it is laid out and how many the file says there are."""
    count, header, comments, stated = None, "", list[str](), list[str]()
    while True:
        start, before = file.tell(), lines.number
        line = lines.line()
        if line is None:
            raise ScanError(lines.path, f"ends after 0 of {count} points" if count else "no points", NEITHER)
        if not line:
            continue
        if line.startswith(("#", "//")):
            text = re.sub(r"^[#/\s]*(?:\w+\s*:(?!\d))?\s*", "", line)
            if _axes(_words(text)):
                comments.append(text)
            stated += _stated(lines, line) if remarks else []
            continue
        if line.isdigit() and not count:
            count = _count(lines, file, line)
            continue
        layout = find_layout(lines.path, lines.number, line, header, comments, stated)
        if layout is not None:
            file.seek(start)
            lines.number = before
            return layout, count
        if header or not _axes(_words(line)):
            raise _no_point(lines, line, header)
        header = line


def _stated(lines: Lines, comment: str) -> list[str]:
    """Return the units that a comment states of the coordinates.

    Raises:
        ScanError: a length that is no unit of a scan.
    """
    # "units: mm (accuracy), coordinates in m": what names the coordinates is about them.
    words = [word.lower().strip(".-") for word in OF_COORDINATES.findall(comment) or OF_THE_FILE.findall(comment)]
    other = next((word for word in words if OTHER_LENGTHS.fullmatch(word)), None)
    if other is not None:
        expected = f"a unit out of {', '.join(NAMED)}, or --scan-unit where it is about something else"
        raise ScanError(lines.path, f"line {lines.number} says that its unit is {ascii(other)}", expected)
    return [unit for word in words if (unit := _known(word))]


def _next_count(lines: Lines, file: BinaryIO) -> int | None:
    """Return how many points the next cloud of the file has, or None when there is none."""
    while (line := lines.line()) is not None:
        if line.isdigit():
            return _count(lines, file, line)
        if line and not line.startswith(("#", "//")):
            raise ScanError(lines.path, f"line {lines.number} comes after the stated number of points", "the end")
    return None


def _count(lines: Lines, file: BinaryIO, text: str) -> int:
    count = count_from(lines.path, text, f"line {lines.number}")
    # The last line may lack its end.
    check_room(lines.path, count, SMALLEST_ROW, lines.path.stat().st_size + 1 - file.tell())
    return count


def _split_names(header: str, delimiter: str | None, width: int) -> list[str]:
    """Return the header's names when it has one for each of ``width`` columns, else nothing."""
    # Of what stands apart from its name, `_axes_with_units` takes the unit.
    apart = [UNIT.sub("", word) for word in _words(header)]
    for names in (fields(header, delimiter), re.split(r"[,;\s]+", header.strip(",; ")), apart):
        if len(names) == width and _axes(names):
            return [_bracketed(name) for name in names]
    return []


def _axes(names: Sequence[str]) -> tuple[int, int, int] | None:
    """Return the columns of x, y and z among names of columns."""
    plain = [_plain(name) for name in names]
    for x, y, z in NAMES:
        if x in plain and y in plain and z in plain:
            return plain.index(x), plain.index(y), plain.index(z)
    return None


def _plain(name: str) -> str:
    """Return a column's name without quotes, unit and affix."""
    return AFFIX.sub("", UNIT.sub("", _bracketed(name)).strip())


def _bracketed(name: str) -> str:
    """Return a column's name without quotes, lower case, its unit in brackets."""
    return TAIL.sub(r"[\1]", name.strip('" ').lower())


def _words(text: str) -> list[str]:
    """Return the words of a header or comment, each with the unit in brackets that follows it."""
    joined = APART.sub(lambda found: f"[{'_'.join(found[1].split())}]", text)
    return re.split(r"[,;\s]+", joined.strip(",; "))


def _axes_with_units(text: str) -> list[str]:
    """Return what a text calls its axes where it says their unit, lower case; a remark in brackets is none.

    Brackets that say the same of all three axes are taken as a unit, known or not.
    """
    words = [_bracketed(word) for word in _words(text)]
    axes = _axes(words)
    if axes is None:
        return []
    triple = {_plain(words[axis]) for axis in axes}
    named = [(word, bracket[1]) for word in words if _plain(word) in triple and (bracket := UNIT.search(word))]
    alike = len(named) >= len(axes) and len({unit for _, unit in named}) == 1
    return [word for word, unit in named if alike or _known(unit)]


def _known(unit: str) -> str | None:
    """Return the project's name of a unit."""
    plain = unit.replace("_", " ").replace(".", "")
    return next((name for name, words in NAMED.items() if plain in words), None)


def _unit(path: Path, names: Sequence[str]) -> str:
    """Return the unit that names of columns, in lower case, hold in brackets, or empty."""
    found = set[str]()
    for name in names:
        bracket = UNIT.search(name)
        if bracket is None or not bracket[1]:
            continue
        unit = _known(bracket[1])
        if unit is None:
            raise ScanError(path, f"column {name} is not in metres", "a unit out of " + ", ".join(NAMED))
        found.add(unit)
    if len(found) > 1:
        raise ScanError(path, f"it says that it is in {' and '.join(sorted(found))}", "one unit")
    return "".join(found)


def _no_point(lines: Lines, line: str, header: str) -> ScanError:
    """Return what is wrong with a line that is neither a point nor a header."""
    where = f"line {lines.number}"
    delimiter = max(DELIMITERS, key=lambda d: len(fields(line, d)))
    values = fields(line, delimiter)
    if header and not _split_names(header, delimiter, len(values)):
        return ScanError(lines.path, f"{where}: not as many columns as the header names", "one value a name")
    if is_number(values[0]) and len(values) < 3:
        return ScanError(lines.path, f"{where}: {len(values)} columns", "at least 3")
    if header or sum(map(is_number, values[:3])) > 1:
        wrong = next((value for value in values[:3] if not is_number(value)), values[0])
        return not_a_number(lines.path, lines.number, wrong)
    return ScanError(lines.path, f"{where}: {ascii(line[:40])} is neither a point nor a header", NEITHER)
