"""Directrix: the line that a swept disk follows, so smooth that a geometry kernel sweeps it whole.

A chain of hundreds of small kinks is a body that kernels fail at: they mitre each kink, the two
tubes meet at hardly any angle, and faces go missing. So each kink is an arc tangent to both
segments, as near to the node as the tube's radius allows. Only where a bend is so sharp that no
such arc stays near the node, the corner stays: there a kernel's mitre is sound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Nodes so near to a line are on it. A few times what the nodes are rounded to, far below what a fit can tell.
ON_A_LINE_M = 5e-6
# An arc passes its node this far away, unless the tube's radius asks for a larger arc.
FROM_NODE_M = 8e-6
# Of the tube's radius: an arc that is tighter than the tube folds its inside over.
LEAST_RADIUS = 1.1
# A kink of which the arc would pass its node farther away stays a corner,
MOST_FROM_NODE_M = 3e-4
# if it is no smaller: IfcOpenShell takes up to 8 degrees for smooth and sweeps them without a mitre.
LEAST_CORNER_RAD = math.radians(10.0)
# A smaller kink is none, and its arc would be lost in rounding.
STRAIGHT_RAD = 1e-8
# An arc takes at most this part of a segment; straight pieces between arcs keep them apart.
MOST_OF_SEGMENT = 0.45


@dataclass(frozen=True, eq=False)
class Directrix:
    """A line of straight pieces and arcs.

    Attributes:
        points_m: [P][3].
        runs: the points of each piece, one after the other, the last of one the first of the next: a straight
            piece has two or more, an arc its start, its middle and its end.
        arcs: whether each piece is an arc.
    """

    points_m: Array
    runs: tuple[tuple[int, ...], ...]
    arcs: tuple[bool, ...]


def smooth_directrix(nodes_m: Array, radius_m: float) -> Directrix:
    """Return the line along nodes [N+1][3] for a disk of a radius.

    It passes each node within 0.01 mm, at a kink that needs a larger arc within 0.3 mm; under 10 degrees the arc
    may pass by up to ``LEAST_RADIUS * radius * angle**2 / 8``.
    """
    nodes = nodes_m[_corners(nodes_m)]
    legs = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    along = legs / lengths[:, None]
    points: list[Array] = [nodes[0]]
    runs: list[tuple[int, ...]] = []
    arcs: list[bool] = []
    run = [0]
    for node, u, v, room in zip(nodes[1:-1], along[:-1], along[1:], np.minimum(lengths[:-1], lengths[1:]), strict=True):
        arc = _arc(node, u, v, MOST_OF_SEGMENT * float(room), radius_m)
        if arc is None:
            points.append(node)
            run.append(len(points) - 1)
            continue
        points += arc
        first = len(points) - 3
        runs += [(*run, first), (first, first + 1, first + 2)]
        arcs += [False, True]
        run = [first + 2]
    points.append(nodes[-1])
    return Directrix(np.array(points), (*runs, (*run, len(points) - 1)), (*arcs, False))


def _arc(node: Array, u: Array, v: Array, room_m: float, radius_m: float) -> list[Array] | None:
    """Return the arc that takes a corner's place, as three points; None where the corner stays.

    Args:
        node: [3] the corner.
        u: [3] unit vector of the leg before it.
        v: [3] that of the leg behind it.
        room_m: how much of each leg the arc may take.
        radius_m: of the disk.
    """
    angle = float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
    if angle < STRAIGHT_RAD:
        return None
    # Between its tangent points t before and behind the node, an arc has the radius t / tan(angle / 2) and passes
    # the node t * tan(angle / 4) away.
    half, quarter = math.tan(angle / 2), math.tan(angle / 4)
    tangent = min(room_m, max(FROM_NODE_M / quarter, LEAST_RADIUS * radius_m * half))
    away = tangent * quarter
    if angle > LEAST_CORNER_RAD and (away > MOST_FROM_NODE_M or tangent < radius_m * half):
        return None
    inward = (v - u) / np.linalg.norm(v - u)
    return [node - tangent * u, node + away * inward, node + tangent * v]


def _corners(nodes: Array) -> list[int]:
    """Return the nodes that a line through them needs: those between two of them are on the line that joins them."""
    kept, waiting = [0], [(0, len(nodes) - 1)]
    while waiting:
        a, b = waiting.pop()
        chord = nodes[b] - nodes[a]
        offsets = nodes[a + 1 : b] - nodes[a]
        part = np.clip(offsets @ chord / max(float(chord @ chord), 1e-18), 0.0, 1.0)
        off = np.linalg.norm(offsets - part[:, None] * chord, axis=1)
        if len(off) and off.max() > ON_A_LINE_M:
            middle = a + 1 + int(off.argmax())
            waiting += [(middle, b), (a, middle)]
        else:
            kept.append(b)
    return kept
