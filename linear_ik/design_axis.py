"""Design axis: the polyline that an element was designed along, and how a chain follows it.

The chain's segments are equally long chords: every node lies on the polyline, the first
at its start and the last at its end. Sections are carried along without twist (parallel
transport), so that a section's sides keep to the plane of a plane curve.
"""

from __future__ import annotations

import reprlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.directions import turn
from linear_ik.errors import ElementError
from linear_ik.outline import as_float

Array = npt.NDArray[np.float64]
Points = tuple[tuple[float, float, float], ...]

MOST_POINTS = 10_000
MOST_ROUNDS = 200
CLOSE = 1e-10  # of the length
SHARPEST_RAD = np.radians(89.0)  # at 90 degrees the joint's angles z, y, x are no longer unique


@dataclass(frozen=True, eq=False)
class DesignAxis:
    """A chain as designed, in the element's own frame.

    Attributes:
        nodes_m: [N+1][3].
        rotations: [N][3][3] orientation of each segment, R_element_segment.
        angles_rad: [N][3] about x, y, z, of each joint: R = Rz Ry Rx against the segment before.
        segment_length_m: of each segment.
    """

    nodes_m: Array
    rotations: Array
    angles_rad: Array
    segment_length_m: float


def check_axis_points(points: object) -> Points:
    """Return the points as tuples.

    Raises:
        ElementError: said of ``axis_points``: not a list of points, a start elsewhere than
            at the origin, a point twice running, a start that leads away from +Z.
    """
    name, expected = "axis_points", "at least two points [x, y, z] in metres, the first [0, 0, 0]"
    if not isinstance(points, (list, tuple, np.ndarray)) or not 2 <= len(points) <= MOST_POINTS:
        raise ElementError(name, reprlib.repr(points), expected)
    rows = []
    for i, point in enumerate(points):
        if not isinstance(point, (list, tuple, np.ndarray)) or len(point) != 3:
            raise ElementError(f"{name}[{i}]", reprlib.repr(point), "three numbers [x, y, z]")
        x, y, z = (as_float(f"{name}[{i}]", v, "metres") for v in point)
        if not all(abs(v) <= 1e5 for v in (x, y, z)):
            raise ElementError(f"{name}[{i}]", f"{[x, y, z]}", "metres, up to 1e5 each")
        rows.append((x, y, z))
    if max(abs(v) for v in rows[0]) > 1e-9:
        raise ElementError(f"{name}[0]", f"{list(rows[0])}", "[0, 0, 0], the placement's location")
    legs = np.diff(np.array(rows), axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    if lengths.min() < 1e-6:
        i = int(lengths.argmin()) + 1
        raise ElementError(f"{name}[{i}]", "the same as the point before", "points apart")
    if legs[0, 2] <= 0:
        raise ElementError(f"{name}[1]", f"{list(rows[1])} leads away from +Z", "a start along the placement's axis")
    return tuple(rows)


def polyline_length_m(points: Points) -> float:
    """Return the length of a polyline."""
    return float(np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum())


def straight_axis(length_m: float, segments: int) -> DesignAxis:
    """Return the chain along Z."""
    nodes = np.zeros((segments + 1, 3))
    nodes[:, 2] = length_m / segments * np.arange(segments + 1)
    rotations = np.tile(np.eye(3), (segments, 1, 1))
    return DesignAxis(nodes, rotations, np.zeros((segments, 3)), length_m / segments)


def follow(points: Points, segments: int) -> DesignAxis:
    """Return the chain of ``segments`` equal chords of a polyline.

    Raises:
        ElementError: said of ``axis_points``: it turns more tightly than the segments can.
    """
    corners, length_m = np.array(points), polyline_length_m(points)
    chord_m = length_m / segments
    for _ in range(MOST_ROUNDS):
        nodes, reached_m = _walk(corners, chord_m, segments)
        if abs(reached_m - length_m) <= CLOSE * length_m:
            break
        chord_m *= length_m / reached_m
    else:
        raise ElementError("axis_points", f"{segments} equal segments cannot follow its turns", "more segments")
    directions = np.diff(nodes, axis=0)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    R, rotations, angles = np.eye(3), [], []
    for k, direction in enumerate(directions):
        turn = _turn_to(R.T @ direction, k)
        R = R @ turn
        rotations.append(R)
        angles.append(_angles(turn))
    return DesignAxis(nodes, np.array(rotations), np.array(angles), chord_m)


def bulges_m(points: Points, axis: DesignAxis) -> Array:
    """Return how far [N][3] the polyline is from each chord of the chain that follows it, where it is farthest.

    In the segment's frame, from the chord to the polyline.
    """
    corners, out = np.array(points), np.zeros((len(axis.rotations), 3))
    for k, R in enumerate(axis.rotations):
        local = (corners - axis.nodes_m[k]) @ R
        away_m = np.hypot(local[:, 0], local[:, 1])
        # Other stretches of a line that turns back are no part of this one.
        beside = (local[:, 2] > 0.0) & (local[:, 2] < axis.segment_length_m) & (away_m < 0.5 * axis.segment_length_m)
        if beside.any():
            out[k, :2] = local[np.where(beside, away_m, -1.0).argmax(), :2]
    return out


def _walk(corners: Array, chord_m: float, steps: int) -> tuple[Array, float]:
    """Return the nodes [steps + 1][3] of equal chords from the start, and how far along the polyline they reach.

    Beyond the polyline's end its last leg goes on.
    """
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    begins = np.cumsum(lengths) - lengths
    nodes, leg = [corners[0]], 0
    along = 0.0
    for _ in range(steps):
        here = nodes[-1]
        # The distance from here is convex along a leg: it is left where the leg's end is beyond the chord.
        while leg < len(legs) - 1 and np.linalg.norm(corners[leg + 1] - here) < chord_m:
            leg += 1
        direction, offset = legs[leg] / lengths[leg], corners[leg] - here
        b = float(direction @ offset)
        t = -b + np.sqrt(max(b * b - float(offset @ offset) + chord_m**2, 0.0))
        nodes.append(corners[leg] + t * direction)
        along = float(begins[leg] + t)
    return np.array(nodes), along


def _turn_to(direction: Array, k: int) -> Array:
    """Return the rotation [3][3] that takes Z to a direction without twist."""
    cosine = float(direction[2])
    if cosine < np.cos(SHARPEST_RAD):
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        raise ElementError(
            "axis_points", f"segment {k + 1} is turned by {angle:.0f} degrees", "less than 89: more segments"
        )
    return turn(np.array([0.0, 0.0, 1.0]), direction)


def _angles(R: Array) -> Array:
    """Return the angles [3] about x, y, z of R = Rz Ry Rx."""
    return np.array([np.arctan2(R[2, 1], R[2, 2]), np.arcsin(-R[2, 0]), np.arctan2(R[1, 0], R[0, 0])]) + 0.0
