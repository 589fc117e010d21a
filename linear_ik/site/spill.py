"""Spill: the points of each element, on disk, so that a site's scan never has to fit in memory.

Of an element's points at most a set number is kept, every stretch of its length having an
equal say. Which ones hangs on the points alone (the lowest of a hash of their coordinates),
never on the order they came in, nor on how much memory there was.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import flush_to_disk, output_errors
from linear_ik.duplicates import point_keys
from linear_ik.errors import OutputError
from linear_ik.site.neighbourhood import STRETCHES

Array = npt.NDArray[np.float64]
Records = npt.NDArray[np.void]

RECORD = np.dtype([("xyz", "<f8", 3), ("station", "<i4"), ("stretch", "u1")])


class Spill:
    """A file of points for each element.

    Attributes:
        received: [E] how many points each element was given, before any were left out.
    """

    def __init__(self, folder: Path, elements: int, max_points: int, memory_bytes: int) -> None:
        """Start empty.

        Args:
            folder: an existing one, for the files.
            elements: how many there are.
            max_points: of an element.
            memory_bytes: of points that wait to be written.
        """
        self._folder, self._memory = folder, memory_bytes
        self._each = max(1, max_points // STRETCHES)
        self._waiting: list[list[Records]] = [[] for _ in range(elements)]
        self._waiting_bytes = 0
        self._on_disk = np.zeros(elements, dtype=np.int64)
        self.received = np.zeros(elements, dtype=np.int64)

    def add(self, element: int, points: Array, station: int, stretch: npt.NDArray[np.uint8]) -> None:
        """Take points [P][3] of an element, all seen from one station (-1: unknown), beside ``stretch`` [P]."""
        records = np.empty(len(points), dtype=RECORD)
        records["xyz"], records["station"], records["stretch"] = points, station, stretch
        self.received[element] += len(points)
        self._waiting[element].append(records)
        self._waiting_bytes += records.nbytes
        if self._waiting_bytes > self._memory:
            self.flush()

    def flush(self) -> None:
        """Write what waits.

        Raises:
            OutputError: the disk is full, or the folder is gone.
        """
        for element, parts in enumerate(self._waiting):
            if not parts:
                continue
            path = self.path(element)
            try:
                with path.open("ab") as file:
                    for part in parts:
                        file.write(part.tobytes())
                        self._on_disk[element] += len(part)
                parts.clear()
                # So that a file stays within a few times what is kept of it.
                if self._on_disk[element] > 3 * self._each * STRETCHES:
                    kept = self._kept(np.fromfile(path, dtype=RECORD))
                    kept.tofile(path)
                    self._on_disk[element] = len(kept)
            except OSError as error:
                raise OutputError(path, f"cannot be written: {error.strerror or error}", "room for points") from None
        self._waiting_bytes = 0

    def settle(self) -> list[int]:
        """Write what waits so that a power cut leaves it, and return `file_bytes`.

        Raises:
            OutputError: the disk is full, or the folder is gone.
        """
        self.flush()
        for element in np.flatnonzero(self._on_disk):
            with output_errors(self.path(int(element))):
                flush_to_disk(self.path(int(element)))
        return self.file_bytes()

    def file_bytes(self) -> list[int]:
        """Return how large each element's file is; 0 where there is none."""
        paths = [self.path(element) for element in range(len(self.received))]
        return [path.stat().st_size if path.exists() else 0 for path in paths]

    def load(self, element: int) -> Records:
        """Return an element's points, RECORDs, in an order that hangs on the points alone."""
        path = self.path(element)
        return self._kept(np.fromfile(path, dtype=RECORD) if path.exists() else np.empty(0, dtype=RECORD))

    def path(self, element: int) -> Path:
        """Return the file of an element."""
        return self._folder / f"{element}.points"

    def _kept(self, records: Records) -> Records:
        """Return each point once, of every stretch the ``_each`` with the lowest keys."""
        keys = point_keys(np.ascontiguousarray(records["xyz"]))
        order = np.lexsort((records["station"], keys, records["stretch"]))
        stretch, keys = records["stretch"][order], keys[order]
        once = np.ones(len(order), dtype=bool)
        once[1:] = (keys[1:] != keys[:-1]) | (stretch[1:] != stretch[:-1])
        order, stretch = order[once], stretch[once]
        counts = np.bincount(stretch, minlength=STRETCHES)
        nth = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
        return np.asarray(records[order[nth < self._each]])
