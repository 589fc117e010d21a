"""BoxTree: upright boxes, found by where they are at a cost that hardly grows with their number."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

FAN = 16  # boxes under one of the next level
BITS = 10  # of a coordinate, for the order


class BoxTree:
    """Boxes in an order that keeps neighbours together, under boxes about sixteen of them each, and so on."""

    def __init__(self, low_m: Array, high_m: Array) -> None:
        """Take boxes by their least and largest x, y and z [B][3]."""
        self._order = _along_a_curve((low_m + high_m) / 2)
        low, high = low_m[self._order], high_m[self._order]
        self._levels = [(low, high)]
        while len(low) > FAN:
            first = np.arange(0, len(low), FAN)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
            self._levels.append((low, high))

    def meeting(self, low_m: Array, high_m: Array) -> Index:
        """Return the rows of the boxes that meet the box from ``low_m`` [3] to ``high_m`` [3], ascending."""
        nodes = np.arange(len(self._levels[-1][0]))
        for depth in range(len(self._levels) - 1, -1, -1):
            low, high = self._levels[depth]
            nodes = nodes[((low[nodes] <= high_m) & (high[nodes] >= low_m)).all(axis=1)]
            if depth:
                nodes = (nodes[:, None] * FAN + np.arange(FAN)).ravel()
                nodes = nodes[nodes < len(self._levels[depth - 1][0])]
        return np.sort(self._order[nodes])


def _along_a_curve(points: Array) -> Index:
    """Return the order of points [P][3] along Morton's curve."""
    if not len(points):
        return np.empty(0, dtype=np.intp)
    low = points.min(axis=0)
    size = max(float((points.max(axis=0) - low).max()), 1e-9)
    cell = ((points - low) / size * (2**BITS - 1)).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
