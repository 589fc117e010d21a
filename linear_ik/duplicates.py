"""Duplicates: the same point twice is one measurement, whichever way it got into the scan twice.

A file given twice, or a cloud exported with the neighbour it overlaps, would halve the
covariance without a single new measurement. Only exact repeats count: two echoes a
tenth of a millimetre apart are two.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Keys = npt.NDArray[np.uint64]
Mask = npt.NDArray[np.bool_]

MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio, odd: multiplying by it loses nothing
HALF = np.uint64(32)
SAME_M = 1e-6


def point_keys(points: Array) -> Keys:
    """Return a key [P] of each point's coordinates, bit by bit: the same for equal points.

    Taken from the scan's own coordinates: moved into another frame, equal points may
    differ in their last bit, by their place in the matrix product.

    Args:
        points: [P][3] double precision, any frame.
    """
    # Zero has two signs, and so two keys, but for the sum with zero.
    bits = (np.ascontiguousarray(points, dtype=np.float64) + 0.0).view(np.uint64)
    keys = np.zeros(len(points), dtype=np.uint64)
    for column in bits.T:
        keys ^= column
        keys *= MIX
        keys ^= keys >> HALF
    return keys


def repeated(keys: Keys, points: Array) -> Mask | None:
    """Return which points [P] repeat an earlier one, or None where no point does.

    A sort of the keys tells that there is nothing to do; memory is 8 bytes a point, 16
    more where there is.

    Args:
        keys: [P] of the points, by `point_keys`.
        points: [P][3] the points, in any frame; keys that agree by accident don't make
            two points one.
    """
    ordered = np.sort(keys)
    if not (ordered[1:] == ordered[:-1]).any():
        return None
    del ordered
    order = np.argsort(keys)
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    del ordered
    earliest = np.repeat(np.minimum.reduceat(order, starts), np.diff(np.append(starts, len(keys))))
    later = order != earliest
    order, earliest = order[later], earliest[later]
    again = np.zeros(len(keys), dtype=bool)
    again[order] = (np.abs(points[order] - points[earliest]) < SAME_M).all(axis=1)
    return again
