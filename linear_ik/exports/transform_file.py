"""A rigid motion as text: sixteen numbers, row by row, as CloudCompare reads and writes them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import write_atomically


def transform_text(T: npt.ArrayLike) -> str:
    """Return a matrix [4][4] as four lines; every number reads back as the same double."""
    return "".join(" ".join(repr(float(v) + 0.0) for v in row) + "\n" for row in np.asarray(T))


def write_transform(T: npt.ArrayLike, path: str | os.PathLike[str]) -> Path:
    """Write a matrix [4][4].

    Raises:
        OutputError: the file cannot be written.
    """
    return write_atomically(path, transform_text(T))
