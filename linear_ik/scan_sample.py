"""ScanSample: some points of a scan of any size, taken while its pieces pass by."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from linear_ik.scan import Scan

Array = npt.NDArray[np.float64]

A_PIECE, MOST_PIECES = 2000, 200  # points of a piece, within a factor of two, and pieces


class ScanSample:
    """Evenly chosen points of evenly chosen pieces; their number never hangs on the scan's."""

    def __init__(self) -> None:
        """Start empty."""
        self._parts: list[Array] = []
        self._every = 1

    def of(self, pieces: Iterable[Scan]) -> Iterator[Scan]:
        """Yield the pieces as they come."""
        for i, piece in enumerate(pieces):
            if i % self._every == 0:
                # A view would keep the whole piece.
                self._parts.append(piece.points[:: max(1, len(piece) // A_PIECE)].copy())
            # However large the scan: every second of them, from then on too.
            if len(self._parts) > MOST_PIECES:
                self._parts, self._every = self._parts[::2], 2 * self._every
            yield piece

    @property
    def points(self) -> Array:
        """[P][3] what was taken so far."""
        return np.concatenate([np.empty((0, 3)), *self._parts])
