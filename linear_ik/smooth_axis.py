"""Smooth axis: the curve behind a fitted chain.

A member that sags is a curve; the chain is a polyline that fits it best, whose nodes lie outside the
curve by h^2 / (12 R) and whose middles inside by h^2 / (24 R), of segments h and a radius R. The curve
is a cubic spline c, smooth between kinks, with the values v_k at the nodes of which the chain is the
best fit: with the hat functions f_i of a polyline, ``sum_j <f_i, f_j> n_j = <f_i, c>``, linear in v, so
``v = D n``. At a start that is held the chain's node is the curve's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Chain
from linear_ik.directions import turn
from linear_ik.result import FitResult

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

TOLD = 0.3  # of a point's noise: what a fit of some hundred points a segment leaves of it at an end
# Ours. A sag's bends differ by less along three joints; of a corner below the angle, legs of 0.4 m are 1 mm off.
KINK_RATIO, LEAST_KINK_RAD = 4.0, np.radians(0.3)
ALIKE = 0.5  # most by which bends may jump, of their size; at random they jump by 1.2
NEIGHBOURS = 3  # joints each way that a bend is compared with; those next to it may share its kink
# Along a member: between two of them an arc's bow is missed by one part in 40^2 of it at most.
STATIONS = 40
GAUSS = 4  # points a segment; exact for a hat times a cubic


@dataclass(frozen=True, eq=False)
class SmoothAxis:
    """Points along a fitted member's axis, in the scan's coordinates.

    A kink is there twice, with the direction before it and the one after.

    Attributes:
        s_m: [K] distance from the start along the chain.
        points_m: [K][3].
        tangents: [K][3] unit directions, from start to end.
        rotations: [K][3][3] of the section: its X and Y, and the tangent, as columns.
        kinks: joints, counted as their nodes from 0, at which the axis is not smooth.
    """

    s_m: Array
    points_m: Array
    tangents: Array
    rotations: Array
    kinks: tuple[int, ...]


def smooth_axis(result: FitResult, pieces: int = 4) -> SmoothAxis:
    """Return the curve behind a fitted chain.

    Args:
        result: of a fit that found the element.
        pieces: into how many each segment is divided.
    """
    n = result.element.segments
    kinked = kinks(result)
    # About the first node: coordinates of a map would cost digits.
    values = curve_of(result, kinked) @ (result.nodes_m - result.nodes_m[0])
    h, rotations = result.fitted_element.segment_length_m, _segment_rotations(result)
    places, points, tangents, sections = [], [], [], []
    for first, last in _runs(n, kinked):
        curve = _spline(np.arange(first, last + 1.0), values[first : last + 1])
        t = np.linspace(first, last, pieces * (last - first) + 1)
        direction = curve(t, 1)
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        places.append(h * t)
        points.append(curve(t) + result.nodes_m[0])
        tangents.append(direction)
        sections.append(_sections(rotations[first:last], t - first, direction))
    return SmoothAxis(
        np.concatenate(places),
        np.concatenate(points),
        np.concatenate(tangents),
        np.concatenate(sections),
        tuple(int(k) for k in np.flatnonzero(kinked)),
    )


def kinks(result: FitResult) -> Mask:
    """Return at which nodes [N+1] the axis is not smooth.

    A kink bends four times as far as the joints around, those beside it apart. Between kinks, bends that
    jump from joint to joint are no curve's: then all of them are kinks, and the chain is its own axis.
    """
    along = _segment_rotations(result)[:, :, 2]
    bends = np.zeros((len(along) + 1, 3))
    bends[1:-1] = np.cross(along[:-1], along[1:])
    size, n = np.arcsin(np.minimum(np.linalg.norm(bends, axis=1), 1.0)), len(along)
    out = np.zeros(n + 1, dtype=bool)
    for k in range(1, n):
        around = [j for j in range(k - NEIGHBOURS, k + NEIGHBOURS + 1) if abs(j - k) > 1 and 1 <= j < n]
        usual = float(np.median(size[around])) if around else np.inf
        out[k] = size[k] > max(KINK_RATIO * usual, LEAST_KINK_RAD)
    for first, last in _runs(n, out):
        inner = bends[first + 1 : last]
        if len(inner) < 3:
            alike = (
                len(inner) == 2 and np.linalg.norm(inner[1] - inner[0]) <= ALIKE * np.linalg.norm(inner, axis=1).max()
            )
        else:
            jumps = inner[1:-1] - (inner[2:] + inner[:-2]) / 2
            alike = np.sqrt(np.mean(jumps**2)) <= ALIKE * np.sqrt(np.mean(inner**2))
        out[first + 1 : last] = not alike
    return out


def curve_of(result: FitResult, kinked: Mask | None = None) -> Array:
    """Return D [N+1][N+1] that takes a result's nodes to its curve at the nodes; ``kinked`` as `kinks` says."""
    element = result.element
    # An end that is held more tightly than points tell its place is on the curve itself.
    tight = element.end != "free" and element.end_tolerance_m < TOLD * result.range_noise_m
    held = (element.start != "free", tight)
    return node_operator(element.segments, kinks(result) if kinked is None else kinked, held)


def node_operator(segments: int, kinked: Mask, held: tuple[bool, bool]) -> Array:
    """Return D [N+1][N+1] that takes the nodes of a best-fitting chain to the values of the curve there.

    Args:
        segments: N, equally long and equally well seen.
        kinked: [N+1] nodes at which the curve is not smooth.
        held: whether the first node and the last are on the curve, whatever fits best.
    """
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    z, w = (x + 1.0) / 2.0, w / 2.0
    hats = np.stack([1.0 - z, z])
    M, B = np.zeros((segments + 1, segments + 1)), np.zeros((segments + 1, segments + 1))
    for first, last in _runs(segments, kinked):
        curve = _spline(np.arange(first, last + 1.0), np.eye(last - first + 1))
        for k in range(first, last):
            M[k : k + 2, k : k + 2] += (hats * w) @ hats.T
            B[k : k + 2, first : last + 1] += (hats * w) @ curve(k + z)
    for node, on_curve in zip((0, segments), held, strict=True):
        if on_curve:
            M[node], B[node] = 0.0, 0.0
            M[node, node] = B[node, node] = 1.0
    return np.asarray(np.linalg.solve(B, M))


def between_nodes(segments: int, kinked: Mask) -> tuple[Array, Array]:
    """Return places [K] along a curve, in segments, and S [K][N+1] that takes the values at its nodes to those there.

    Every node is among them, and the middle of each segment.

    Args:
        segments: N.
        kinked: [N+1] nodes at which the curve is not smooth.
    """
    pieces = 2 * -(-STATIONS // (2 * segments))
    t = np.arange(pieces * segments + 1) / pieces
    S = np.zeros((len(t), segments + 1))
    for first, last in _runs(segments, kinked):
        rows = slice(pieces * first, pieces * last + 1)
        S[rows, first : last + 1] = _spline(np.arange(first, last + 1.0), np.eye(last - first + 1))(t[rows])
        S[pieces * first], S[pieces * last] = 0.0, 0.0  # the run before knows its last node as well
        S[pieces * first, first] = S[pieces * last, last] = 1.0
    return t, S


def _runs(segments: int, kinked: Mask) -> list[tuple[int, int]]:
    """Return first and last node of each part without a kink inside."""
    stops = [0, *(int(k) for k in np.flatnonzero(kinked) if 0 < k < segments), segments]
    return list(zip(stops[:-1], stops[1:], strict=True))


def _spline(t: Array, values: Array) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, values)


def _segment_rotations(result: FitResult) -> Array:
    """Return the orientation [N][3][3] of each segment in the scan's coordinates."""
    chain = Chain.of(result.fitted_element)
    return np.asarray(result.base_pose[:3, :3] @ chain.pose(chain.with_q(result.q)).rotations)


def _sections(rotations: Array, t: Array, tangents: Array) -> Array:
    """Return the section's orientation [K][3][3] at places t [K] of a run of segments, its Z along the tangents [K][3].

    It turns about the axis evenly from the middle of a segment to the middle of the next.
    """
    from scipy.spatial.transform import Rotation, Slerp

    n = len(rotations)
    if n == 1:
        between = np.tile(rotations[0], (len(t), 1, 1))
    else:
        turns = Slerp(np.arange(n) + 0.5, Rotation.from_matrix(rotations))
        between = turns(np.clip(t, 0.5, n - 0.5)).as_matrix()
    return np.stack([turn(R[:, 2], direction) @ R for R, direction in zip(between, tangents, strict=True)])
