"""Curved axes: arcs, and the directrix of a swept disk, as polylines in metres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.errors import DesignError

Array = npt.NDArray[np.float64]

SAGITTA_M = 5e-5  # of the polyline below the curve
MOST_STEPS = 2000


def arc_points(start: Array, hub: Array, axis: Array, angle_rad: float) -> Array:
    """Return the points [P][3] that a point goes through when it turns about an axis.

    Args:
        start: [3].
        hub: [3] a point of the axis.
        axis: [3] direction; the turn is right-handed about it.
        angle_rad: by how much.

    Raises:
        DesignError: the point is on the axis, or doesn't turn.
    """
    axis = axis / np.linalg.norm(axis)
    centre = hub + ((start - hub) @ axis) * axis
    u = start - centre
    radius = float(np.linalg.norm(u))
    if radius < 1e-6 or abs(angle_rad) < 1e-6:
        raise DesignError("its revolution", "leaves the middle of its section where it is")
    v = np.cross(axis, u)
    a = np.linspace(0.0, angle_rad, _steps(radius, abs(angle_rad)) + 1)[:, None]
    return np.asarray(centre + np.cos(a) * u + np.sin(a) * v)


def directrix(disk: Any, unit_m: float) -> Array:
    """Return the line [P][3] that an IfcSweptDiskSolid follows, in metres.

    Raises:
        DesignError: it is not one run, or is trimmed beyond its ends.
    """
    from linear_ik.bim.tessellation import curve_points

    curve = disk.Directrix
    if curve.is_a("IfcPolyline"):
        points = _distinct(np.array([_xyz(p.Coordinates) for p in curve.Points]) * unit_m)
        whole: int | None = len(curve.Points) - 1
    elif curve.is_a("IfcIndexedPolyCurve"):
        points, whole = _indexed(curve, unit_m)
    else:
        drawn = curve_points(curve)
        if drawn is None:
            raise DesignError(f"its line ({curve.is_a()})", "cannot be drawn as one run")
        points, whole = drawn, None
    if len(points) < 2:
        raise DesignError("its line", "has no length")
    points = _trimmed(points, disk, curve, whole)
    fillet = getattr(disk, "FilletRadius", None)
    return _rounded(points, fillet * unit_m) if fillet else points


def _trimmed(points: Array, disk: Any, curve: Any, whole: int | None) -> Array:
    """Return the part of the line between the disk's parameters: on a polyline they count its points."""
    first, last = disk.StartParam, disk.EndParam
    if first in (None, 0.0) and (last is None or (whole is not None and abs(last - whole) < 1e-6)):
        return points
    if whole is None or not curve.is_a("IfcPolyline") or len(points) != whole + 1:
        # A writer that states the whole curve's own range trims nothing; the tessellation tells.
        return points
    lo, hi = (0.0 if first is None else first), (float(whole) if last is None else last)
    if not 0 <= lo < hi <= whole:
        raise DesignError("its line", f"is trimmed from {lo:g} to {hi:g} of 0 to {whole}")
    inner = np.arange(np.floor(lo) + 1, np.ceil(hi)).astype(int)
    ends = [_between(points, t) for t in (lo, hi)]
    return np.array([ends[0], *points[inner], ends[1]])


def _between(points: Array, t: float) -> Array:
    i = min(int(t), len(points) - 2)
    return np.asarray(points[i] + (t - i) * (points[i + 1] - points[i]))


def _indexed(curve: Any, unit_m: float) -> tuple[Array, int | None]:
    """Return an IfcIndexedPolyCurve as a polyline, arcs as chords, and its number of legs where all are straight."""
    nodes = np.array([_xyz(c) for c in curve.Points.CoordList]) * unit_m
    if not curve.Segments:
        return _distinct(nodes), len(nodes) - 1
    run: list[Array] = []
    for segment in curve.Segments:
        at = [i - 1 for i in segment.wrappedValue]
        run.append(nodes[at] if segment.is_a("IfcLineIndex") else _arc_through(*nodes[at]))
    return _distinct(np.concatenate(run)), None


def _arc_through(a: Array, b: Array, c: Array) -> Array:
    """Return the arc from a through b to c as points [P][3]."""
    u, v = b - a, c - a
    normal = np.cross(u, v)
    size = float(normal @ normal)
    if size < 1e-12 * float(u @ u) * float(v @ v):
        return np.array([a, b, c])
    centre = a + (np.cross(normal, u) * float(v @ v) + np.cross(v, normal) * float(u @ u)) / (2 * size)
    axis = normal / np.sqrt(size)
    x = a - centre
    y = np.cross(axis, x)
    angle = float(np.arctan2((c - centre) @ y, (c - centre) @ x)) % (2 * np.pi)
    return arc_points(a, centre, axis, angle)


def _rounded(points: Array, radius_m: float) -> Array:
    """Return a polyline with arcs of a radius in its corners (IfcSweptDiskSolidPolygonal)."""
    out = [points[:1]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        u, v = before - corner, after - corner
        room = min(np.linalg.norm(u), np.linalg.norm(v))
        u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
        half = np.arccos(np.clip(u @ v, -1.0, 1.0)) / 2
        tangent = radius_m / np.tan(half) if half > 1e-6 else np.inf
        if not tangent <= room + 1e-9 or half > np.pi / 2 - 1e-6:
            out.append(corner[None])
            continue
        middle = (u + v) / np.linalg.norm(u + v)
        nearest = corner + middle * (radius_m / np.sin(half) - radius_m)
        out.append(_arc_through(corner + tangent * u, nearest, corner + tangent * v))
    return _distinct(np.concatenate([*out, points[-1:]]))


def _steps(radius_m: float, angle_rad: float) -> int:
    step = 2 * np.arccos(max(1 - SAGITTA_M / radius_m, 0.0))
    return int(np.clip(np.ceil(angle_rad / step), 8, MOST_STEPS))


def _distinct(points: Array) -> Array:
    return np.asarray(points[np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6)])


def _xyz(coordinates: Any) -> tuple[float, float, float]:
    x, y, *rest = coordinates
    return float(x), float(y), float(rest[0]) if rest else 0.0
