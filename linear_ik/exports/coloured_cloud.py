"""Coloured clouds: points with a deviation, as PLY and LAZ, written bit by bit.

Programs that show scalars (CloudCompare, ParaView, laspy) find the deviation itself beside
the colour: ``scalar_deviation_m`` in a PLY, ``deviation_m`` in a LAZ.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from linear_ik.errors import OutputError

Array = npt.NDArray[np.float64]
Colours = npt.NDArray[np.uint8]

COUNT_DIGITS = 12
LAZ_STEP_M = 1e-4
RECORD = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3), ("deviation_m", "<f4"), ("element", "<i4")])
# Blue, pale grey, red: differences of lightness and of hue, told apart by the colour-blind too.
LOW, MIDDLE, HIGH = np.array([[33.0, 102.0, 172.0], [230.0, 230.0, 230.0], [178.0, 24.0, 43.0]])


def colours_of(deviation_m: Array, legend_m: float) -> Colours:
    """Return the colour [P][3] of deviations [P]: blue at -legend_m and below, grey at 0, red at +legend_m."""
    t = np.clip(deviation_m / legend_m, -1.0, 1.0)[:, None]
    return np.asarray(np.round(MIDDLE + np.where(t < 0, -t * (LOW - MIDDLE), t * (HIGH - MIDDLE))), dtype=np.uint8)


def laz_can_be_written() -> bool:
    """Say whether what LAZ needs is installed."""
    return all(importlib.util.find_spec(name) is not None for name in ("laspy", "lazrs"))


class CloudFile(Protocol):
    """A file that takes points bit by bit."""

    def write(self, points: Array, deviation_m: Array, colours: Colours, element: npt.NDArray[np.intp]) -> None:
        """Take points [P][3], their deviation [P], colour [P][3] and the number of their element [P], from 1."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


class PlyCloud:
    """Binary PLY, coordinates in double precision."""

    def __init__(self, path: Path, comments: list[str]) -> None:
        """Begin the file; how many points come is filled in at the end."""
        lines = ["ply", "format binary_little_endian 1.0", *(f"comment {text}" for text in comments)]
        head = "\n".join(lines).encode("ascii", "replace") + b"\nelement vertex "
        self._count_at, self._count = len(head), 0
        fields = [f"double {a}" for a in "xyz"] + [f"uchar {c}" for c in ("red", "green", "blue")]
        fields += ["float scalar_deviation_m", "int scalar_element"]
        rest = "".join(f"\nproperty {field}" for field in fields) + "\nend_header\n"
        self._file: BinaryIO = path.open("wb")
        self._file.write(head + b"0" * COUNT_DIGITS + rest.encode("ascii"))

    def write(self, points: Array, deviation_m: Array, colours: Colours, element: npt.NDArray[np.intp]) -> None:
        """Take some points."""
        records = np.empty(len(points), dtype=RECORD)
        records["xyz"], records["rgb"], records["deviation_m"], records["element"] = (
            points,
            colours,
            deviation_m,
            element,
        )
        self._file.write(records.tobytes())
        self._count += len(points)

    def close(self) -> None:
        """Fill in the count."""
        self._file.seek(self._count_at)
        self._file.write(f"{self._count:0{COUNT_DIGITS}d}".encode("ascii"))
        self._file.close()


class LazCloud:
    """LAZ in steps of 0.1 mm about an offset."""

    def __init__(self, path: Path, offset_m: Array) -> None:
        """Begin the file; `laz_can_be_written` says whether that will do."""
        import laspy
        import lazrs

        header = laspy.LasHeader(point_format=2, version="1.2")
        header.scales, header.offsets = np.full(3, LAZ_STEP_M), np.floor(offset_m)
        header.add_extra_dim(laspy.ExtraBytesParams("deviation_m", "f4", "signed, outside positive"))
        header.add_extra_dim(laspy.ExtraBytesParams("element", "u4", "row of elements.csv, from 1"))
        self._laspy, self._header, self._refusal = laspy, header, lazrs.LazrsError
        with self._said_as_others():
            self._file: Any = laspy.open(str(path), mode="w", header=header, do_compress=True)

    def write(self, points: Array, deviation_m: Array, colours: Colours, element: npt.NDArray[np.intp]) -> None:
        """Take some points.

        Raises:
            OutputError: they lie more than 200 km from the offset, which LAZ has no numbers for.
        """
        record = self._laspy.ScaleAwarePointRecord.zeros(len(points), header=self._header)
        try:
            record.x, record.y, record.z = points.T
        except OverflowError:
            raise OutputError("deviation.laz", "points too far apart for LAZ", "a site of up to 200 km") from None
        # LAS colours have 16 bits.
        record.red, record.green, record.blue = (colours.astype(np.uint16) * 257).T
        record.deviation_m, record.element = deviation_m.astype(np.float32), element.astype(np.uint32)
        with self._said_as_others():
            self._file.write_points(record)

    def close(self) -> None:
        """Finish the file."""
        with self._said_as_others():
            self._file.close()

    @contextmanager
    def _said_as_others(self) -> Iterator[None]:
        """Make an OSError of a full disk, as every other file does: lazrs has an error of its own for it."""
        try:
            yield
        except self._refusal as error:
            raise OSError(str(error)) from error
