"""Outlines: the corners of sections, and the checks of the numbers behind them."""

from __future__ import annotations

import math
import reprlib

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ElementError

Array = npt.NDArray[np.float64]

CIRCLE_CHORDS = 128  # 0.03 mm from a circle of 100 mm radius
FILLET_CHORDS = 6
SMALLEST_DIMENSION_M = 1e-5
LARGEST_DIMENSION_M = 100.0
SMALLEST_AREA_M2 = 1e-8


def check_dimension(name: str, value: object, zero: bool = False) -> float:
    """Return ``value`` as metres, or raise ElementError naming it."""
    expected = f"metres, {'0, or ' if zero else ''}{SMALLEST_DIMENSION_M:g} to {LARGEST_DIMENSION_M:g}"
    number = as_float(name, value, expected)
    if not (SMALLEST_DIMENSION_M <= number <= LARGEST_DIMENSION_M or (zero and number == 0.0)):
        raise ElementError(name, f"{number:g}", expected)
    return number


def check_outline(outline: object) -> tuple[tuple[float, float], ...]:
    """Return the corners of a simple polygon counter-clockwise, or raise ElementError."""
    expected = "at least three corners [x, y] in metres"
    if not isinstance(outline, (list, tuple, np.ndarray)):
        raise ElementError("outline", "not a list of number pairs", expected)
    rows = []
    for i, corner in enumerate(outline):
        if not isinstance(corner, (list, tuple, np.ndarray)) or len(corner) != 2:
            raise ElementError(f"outline[{i}]", "not a pair of numbers", expected)
        rows.append([_coordinate(f"outline[{i}]", v) for v in corner])
    # A corner given twice running has no edge, and so no normal.
    corners = np.array([c for i, c in enumerate(rows) if i == 0 or math.dist(c, rows[i - 1]) > 1e-9])
    if len(corners) > 1 and math.dist(corners[0], corners[-1]) <= 1e-9:
        corners = corners[:-1]
    if not 3 <= len(corners) <= 1000:
        raise ElementError("outline", f"{len(corners)} corners", "3 to 1000 corners [x, y] in metres")
    import shapely

    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or polygon.area < SMALLEST_AREA_M2:
        reason = f"an area of {polygon.area:g} m2" if polygon.is_valid else shapely.is_valid_reason(polygon)
        raise ElementError("outline", reason, f"edges that neither cross nor touch, around {SMALLEST_AREA_M2:g} m2")
    if not polygon.exterior.is_ccw:
        corners = corners[::-1]
    return tuple((float(x), float(y)) for x, y in corners)


def _coordinate(name: str, value: object) -> float:
    number = as_float(name, value, f"metres, up to {LARGEST_DIMENSION_M:g}")
    if not abs(number) <= LARGEST_DIMENSION_M:
        raise ElementError(name, f"{number:g}", f"metres, up to {LARGEST_DIMENSION_M:g}")
    return number


def as_float(name: str, value: object, expected: str) -> float:
    """Return ``value`` as a float, NaN and infinity included, or raise ElementError naming it."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ElementError(name, f"{reprlib.repr(value)} is not a number", expected)
    try:
        return float(value)
    except OverflowError:
        raise ElementError(name, "a number of more than 300 digits", expected) from None


def check_thinner(name: str, value: float, room: float, what: str) -> None:
    """Raise ElementError unless ``value`` is 0 or less than ``room`` by a micrometre.

    Without that margin, rounding decides whether an edge of no length is left.
    """
    if value > 0 and value > room - 1e-6:
        raise ElementError(name, f"{value:g}", f"less than {what}, {room:g}")


def box_outline(x_dim: float, y_dim: float) -> Array:
    """Return the four corners [4][2] of a centred rectangle, counter-clockwise from (-X, -Y)."""
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [x_dim / 2, y_dim / 2]


def ring_outline(radius: float) -> Array:
    """Return the corners [CIRCLE_CHORDS][2] of a regular polygon on a circle, counter-clockwise."""
    angle = np.arange(CIRCLE_CHORDS) * (2 * np.pi / CIRCLE_CHORDS)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rounded_outline(corners: list[tuple[float, float]], which: set[int], radius: float) -> Array:
    """Replace the right-angled corners in ``which`` by quarter circles of ``radius``."""
    points = np.array(corners)
    if radius == 0:
        return points
    out: list[Array] = []
    for i, corner in enumerate(points):
        if i not in which:
            out.append(corner[None])
            continue
        to_previous = np.sign(points[i - 1] - corner)
        to_next = np.sign(points[(i + 1) % len(points)] - corner)
        t = np.linspace(0, np.pi / 2, FILLET_CHORDS + 1)[:, None]
        centre = corner + radius * (to_previous + to_next)
        out.append(centre - radius * (np.cos(t) * to_next + np.sin(t) * to_previous))
    return np.concatenate(out)
