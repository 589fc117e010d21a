"""PTX: gridded scans, one after another, each with the scanner's pose.

A scan is: columns, rows, the scanner's position, its three axes, a 4 x 4 matrix in the row
convention ([x y z 1] M = global coordinates), then columns x rows lines of x y z intensity
[r g b] in the scanner's frame. A line of 0 0 0 is a ray without an echo.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array, Chunk, check_room, count_from, posed
from linear_ik.readers.text import Lines, is_finite, not_a_number, rows

SMALLEST_ROW = len("0 0 0\n")


def read(path: Path, chunk_points: int) -> Iterator[Chunk]:
    """Yield the points of every scan of the file in global coordinates, with the station that saw them.

    Raises:
        ScanError: a header that is none, a matrix that isn't a pose, or not as many points as the grids have.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        lines = Lines(path, file, chunk_points)
        while (first := _line(lines)) is not None:
            grid = [count_from(path, text, f"line {lines.number}") for text in (first, _line(lines) or "")]
            station, T = _pose(lines)
            count = grid[0] * grid[1]
            # The last line may lack its end.
            check_room(path, count, SMALLEST_ROW, size + 1 - file.tell())
            for local in rows(lines, (0, 1, 2), None, count):
                echo = local[local.any(axis=1)]
                yield Chunk(posed(echo, T[:3, :3].T, T[3, :3]), station=station)


def _line(lines: Lines) -> str | None:
    """Return the next line that isn't blank."""
    while (line := lines.line()) == "":
        pass
    return line


def _pose(lines: Lines) -> tuple[Array, Array]:
    """Return the station [3] and the matrix [4][4], row convention."""
    position, *_ = (_vector(lines, 3) for _ in range(4))
    T = np.array([_vector(lines, 4) for _ in range(4)])
    if not np.array_equal(T[:, 3], [0, 0, 0, 1]):
        raise ScanError(lines.path, f"line {lines.number}: the matrix's last column is no 0 0 0 1", "a PTX pose")
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3):
        raise ScanError(lines.path, f"line {lines.number}: the matrix is no rotation", "a PTX pose")
    # Some programs leave the position at zero and fill in the matrix only.
    return (position if position.any() else T[3, :3]), T


def _vector(lines: Lines, length: int) -> Array:
    values = (_line(lines) or "").split()
    if len(values) != length:
        raise ScanError(lines.path, f"line {lines.number}: {len(values)} numbers", f"{length}, of a PTX header")
    for value in values:
        if not is_finite(value):
            raise not_a_number(lines.path, lines.number, value)
    return np.array(values, dtype=np.float64)
