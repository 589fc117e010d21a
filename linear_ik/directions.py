"""Directions: unit vectors, what turns one into another, and what lies across one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def turn(start: Array, end: Array) -> Array:
    """Return the smallest rotation [3][3] from one unit vector to another."""
    cosine, axis = float(start @ end), np.cross(start, end)
    if cosine < -1.0 + 1e-12:
        side = across(start)[0]
        return np.asarray(2.0 * np.outer(side, side) - np.eye(3))
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + cosine))


def across(direction: Array) -> Array:
    """Return two unit vectors [2][3] across a direction."""
    first = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])
