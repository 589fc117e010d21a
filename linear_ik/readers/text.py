"""Text with numbers in columns: blocks of whole lines, parsed by numpy's C reader.

numpy.loadtxt takes 0.7 s for a million rows of three columns; nothing faster checks every row.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array

LONGEST_LINE = 1 << 16
COMMENT = re.compile(rb"(?m)^[ \t]*(?:#|//).*$")
BLANK = re.compile(rb"(?m)^[ \t\r]+$")
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
# Microsoft's C library writes these where others write nan.
ODD_NAN = re.compile(rb"(?i)[+-]?1\.#(?:ind|qnan|snan|inf)0*|[+-]?nan\(\w*\)")


class Lines:
    """A text file, line by line or in blocks of whole lines.

    Attributes:
        path: the file, for errors.
        number: lines handed out so far.
    """

    def __init__(self, path: Path, file: BinaryIO, chunk_points: int, number: int = 0) -> None:
        """Read ``file`` from where it stands, in blocks of about ``chunk_points`` lines."""
        self.path = path
        self.number = number
        self._file = file
        self._block_bytes = min(max(chunk_points * 32, 1 << 16), 1 << 24)

    def line(self) -> str | None:
        """Return the next line, stripped, or None at the end of the file."""
        raw = self._file.readline(LONGEST_LINE)
        if not raw:
            return None
        self._check(raw)
        if self.number == 0:
            raw = raw.removeprefix(b"\xef\xbb\xbf")
        self.number += 1
        return raw.decode("latin-1").strip()

    def block(self, most: int | None = None) -> bytes:
        """Return the next lines, ``most`` at most; empty at the end of the file."""
        start = self._file.tell()
        block = self._file.read(self._block_bytes)
        if block and not block.endswith(b"\n"):
            tail = self._file.readline(LONGEST_LINE)
            if tail:
                self._check(tail)
            block += tail
        self._check(block)
        count = block.count(b"\n")
        if most is not None and count > most:
            ends = np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n"))
            block = block[: int(ends[most - 1]) + 1]
            self._file.seek(start + len(block))
            count = most
        self.number += count + (not block.endswith(b"\n") and bool(block))
        return block

    def _check(self, text: bytes) -> None:
        if b"\0" in text:
            raise ScanError(self.path, f"binary data after line {self.number}", "ASCII or UTF-8 text")
        if len(text) >= LONGEST_LINE and b"\n" not in text:
            raise ScanError(self.path, f"line {self.number + 1} has more than {LONGEST_LINE} characters", "text")


def rows(
    lines: Lines, columns: Sequence[int], delimiter: str | None = None, count: int | None = None
) -> Iterator[Array]:
    """Yield the columns asked for, in blocks [P][C]; blank lines and comments are no rows.

    Args:
        lines: where to read on.
        columns: C indices of columns.
        delimiter: one character, or None for white space.
        count: rows to read, or None for all that follow.

    Raises:
        ScanError: a row lacks a column or holds something else than a number, or the file ends early.
    """
    left = count
    while left is None or left > 0:
        before = lines.number
        block = lines.block(left)
        if not block:
            if left:
                raise ScanError(lines.path, f"ends after {(count or 0) - left} of {count} points", "a complete file")
            return
        part = _parse(lines.path, block, before, columns, delimiter)
        if left is not None:
            left -= len(part)
        yield part


def fields(line: str, delimiter: str | None) -> list[str]:
    """Return the columns of a line, without quotes."""
    return [field.strip().strip('"').strip() for field in line.split(delimiter)]


def is_number(text: str) -> bool:
    """Return whether ``text`` is a number, nan included."""
    try:
        float(text)
    except ValueError:
        return ODD_NAN.fullmatch(text.encode("latin-1", "replace")) is not None
    return True


def is_finite(text: str) -> bool:
    """Return whether ``text`` is a number, and neither nan nor infinite."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def not_a_number(path: Path, number: int, text: str) -> ScanError:
    """Return the error for ``text`` at line ``number``, naming the decimal comma if it is one."""
    if DECIMAL_COMMA.fullmatch(text):
        return ScanError(path, f"line {number}: {text} has a decimal comma", "a decimal point")
    return ScanError(path, f"line {number}: {ascii(text[:40])} is not a number", "x, y and z")


def _parse(path: Path, block: bytes, before: int, columns: Sequence[int], delimiter: str | None) -> Array:
    text = COMMENT.sub(b"", block) if b"#" in block or b"//" in block else block
    if not text.strip():
        return np.empty((0, len(columns)))
    # Where the file ends inside a line, the line tells it by its missing columns.
    if not block.endswith(b"\n"):
        first, last = text.lstrip().split(b"\n", 1)[0], text.rsplit(b"\n", 1)[-1]
        width, last_width = (len(fields(line.decode("latin-1"), delimiter)) for line in (first, last))
        if last.strip() and last_width < width:
            raise ScanError(path, f"ends inside a line, after {last_width} of {width} columns", "a complete file")
    try:
        return _load(text, columns, delimiter)
    except ValueError as error:
        tidy = ODD_NAN.sub(b"nan", BLANK.sub(b"", text))
        if tidy != text:
            try:
                return _load(tidy, columns, delimiter)
            except ValueError:
                pass
        raise _first_bad_line(path, text, before, columns, delimiter, str(error)) from None


def _load(text: bytes, columns: Sequence[int], delimiter: str | None) -> Array:
    return np.loadtxt(
        io.BytesIO(text),
        dtype=np.float64,
        delimiter=delimiter,
        usecols=columns,
        comments=None,
        ndmin=2,
        encoding="latin-1",
        quotechar='"' if b'"' in text else None,
    )


def _first_bad_line(
    path: Path, text: bytes, before: int, columns: Sequence[int], delimiter: str | None, otherwise: str
) -> ScanError:
    for number, raw in enumerate(text.split(b"\n"), before + 1):
        if not raw.strip():
            continue
        values = fields(raw.decode("latin-1"), delimiter)
        if len(values) <= max(columns):
            return ScanError(path, f"line {number}: {len(values)} columns", f"at least {max(columns) + 1}")
        for column in columns:
            if not is_number(values[column]):
                return not_a_number(path, number, values[column])
    return ScanError(path, f"after line {before}: {otherwise}", "numbers in columns")
