"""Chunk: what every reader hands over, and the words they share for what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some of a file's points, seen from one place.

    Attributes:
        points: [P][3] metres, in the file's global coordinates; rows that are not finite are no points.
        normals: [P][3] of any length, or None.
        station: [3] metres, where the scanner stood, or None when the file doesn't say.
        unit: one of SCAN_UNITS that the file itself names for its numbers, or empty.
    """

    points: Array
    normals: Array | None = None
    station: Array | None = None
    unit: str = ""


Reader = Callable[[Path, int], Iterator[Chunk]]
"""A file format: path and the most points a chunk should hold -> chunks, in file order.

The path is a readable file that isn't empty. A reader raises ScanError about that path.
"""


def posed(local: Array, R: Array, t: Array) -> Array:
    """Return points [P][3] of a scanner's frame in global coordinates, R p + t."""
    x, y, z = local.T
    # What is no number stays none. Damaged files hold numbers whose products overflow: they
    # become no points. By columns, because a product of three columns is over before BLAS has woken its threads.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.column_stack([R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + t[i] for i in range(3)])


def count_from(path: Path, text: str, where: str) -> int:
    """Return a count that a header states.

    Raises:
        ScanError: ``text`` is no whole number from 0 up.
    """
    # int() takes signs and underscores, and refuses numbers of more than 4300 digits.
    if not (text.isascii() and text.isdigit() and len(text) < 20):
        raise ScanError(path, f"{where} is {text[:40]!r}", "a whole number")
    return int(text)


def check_room(path: Path, count: int, record_bytes: int, left_bytes: int, what: str = "points") -> None:
    """Refuse a count that the rest of the file cannot hold, before anything is allocated for it.

    Raises:
        ScanError: ``count`` records of ``record_bytes`` or more don't fit in ``left_bytes``.
    """
    if count * record_bytes > left_bytes:
        raise ScanError(
            path,
            f"the header says {count} {what}, the file has room for {left_bytes // record_bytes}",
            "a complete file",
        )


def check_end(path: Path, count: int, record_bytes: int, left_bytes: int) -> None:
    """Refuse data behind the stated number of points; less than a record is padding.

    Raises:
        ScanError: ``left_bytes`` hold at least one more record.
    """
    if left_bytes >= record_bytes:
        raise ScanError(
            path,
            f"the header says {count} points, the file goes on for {left_bytes} bytes more",
            "a header that counts all points",
        )
