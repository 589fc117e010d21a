"""Scans as files: PLY in double precision, or plain text."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import numpy as np

from linear_ik.atomic import write_atomically
from linear_ik.errors import OutputError
from linear_ik.scan import Scan

FORMATS = (".ply", ".xyz", ".txt")


def check_scan_format(path: str | os.PathLike[str]) -> str:
    """Return the extension, in lower case.

    Raises:
        OutputError: a format that is not written.
    """
    extension = Path(path).suffix.lower()
    if extension not in FORMATS:
        raise OutputError(path, f"cannot write scans as {extension or 'a file without extension'}", ", ".join(FORMATS))
    return extension


def write_scan(scan: Scan, path: str | os.PathLike[str]) -> Path:
    """Write the points of a scan.

    Args:
        scan: its points are written, in metres; PLY keeps every bit, text micrometres.
        path: .ply (binary, double), .xyz or .txt.

    Raises:
        OutputError: another extension, or a file that cannot be written.
    """
    if check_scan_format(path) == ".ply":
        axes = "".join(f"property double {axis}\n" for axis in "xyz")
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(scan)}\n{axes}end_header\n"
        return write_atomically(path, header.encode("ascii") + scan.points.astype("<f8").tobytes())
    text = BytesIO()
    np.savetxt(text, scan.points, fmt="%.6f")
    return write_atomically(path, text.getvalue())
