"""Slicing along the axis: centres of thin cross-sections, in a few lines of numpy.

The scan is cut across the design's axis, the middle of each slice's extent taken as a
point of the deformed axis (the middle, since the mean of the points follows their
density), and cut again across the line so found. Nodes lie on that line at their
distance along it.
"""

from __future__ import annotations

import numpy as np

from benchlib.methods.common import Array, Found, Solve, Task, tubes

SLICES_A_SEGMENT = 3
PASSES = 2


def slicing() -> Solve:
    """Return the slicing of a scan whose design axis is Z."""

    def solve(task: Task) -> Found:
        line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, task.element.length_m]])
        for _ in range(PASSES):
            line = centres(task, line)
        nodes = at_length(line, np.linspace(0.0, task.element.length_m, task.element.segments + 1))
        return Found(nodes, lambda: tubes(task.element, frames(nodes), nodes), PASSES)

    return solve


def centres(task: Task, line: Array) -> Array:
    """Return the line [S+1][3] through the middles of the slices across a line [M][3], from the start."""
    count = SLICES_A_SEGMENT * task.element.segments
    starts, along = line[:-1], np.diff(line, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    along /= lengths[:, None]
    ahead = np.einsum("pij,ij->pi", task.points[:, None] - starts, along)
    # A point belongs to the last piece that begins before it.
    piece = np.maximum((ahead > 0.0).cumsum(axis=1).argmax(axis=1), 0)
    s = np.cumsum(lengths)[piece] - lengths[piece] + ahead[np.arange(len(piece)), piece]
    slice_of = np.floor(np.clip(s / task.element.length_m, 0.0, 1.0 - 1e-9) * count).astype(int)
    middles = [np.zeros(3)]
    for k in range(count):
        own = task.points[slice_of == k]
        if len(own) >= 4:
            direction = along[np.bincount(piece[slice_of == k]).argmax()]
            across = np.linalg.svd(direction[None])[2][1:]
            offsets = own @ across.T
            middle = (offsets.min(axis=0) + offsets.max(axis=0)) / 2.0
            middles.append(middle @ across + (own @ direction).mean() * direction)
    return np.array(middles)


def at_length(line: Array, lengths_m: Array) -> Array:
    """Return the points [K][3] at some lengths [K] along a line [M][3], its ends prolonged."""
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    stops = np.concatenate([[0.0], np.cumsum(pieces)])
    k = np.clip(np.searchsorted(stops, lengths_m, side="right") - 1, 0, len(pieces) - 1)
    share = (lengths_m - stops[k]) / pieces[k]
    return line[k] + share[:, None] * (line[k + 1] - line[k])


def frames(nodes_m: Array) -> Array:
    """Return orientations [N][3][3] of the segments between nodes, turned no more than they must be."""
    R, out = np.eye(3), []
    for z in np.diff(nodes_m, axis=0):
        z = z / np.linalg.norm(z)
        x = R[:, 0] - (R[:, 0] @ z) * z
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        out.append(R)
    return np.array(out)
