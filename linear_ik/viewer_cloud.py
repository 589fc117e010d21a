"""Viewer, cloud: which of a scan's points are shown, and in which colours."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.viewer_shapes import axis_distances_m, reach_m

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

MOST_POINTS = 200_000  # 24 bytes each: some 6 MB of page
# Points of a whole site would drown the member: this share is kept for what is near it.
NEAR_SHARE = 0.75
NEAR_M = 1.0
SCANNED = (0.75, 0.78, 0.82)
# Distance to the fitted surface, as a share of the largest shown: blue, yellow, red; grey beyond ten times that.
COLOUR_STOPS = (0.0, 0.5, 1.0)
COLOURS = ((0.16, 0.38, 0.95), (0.98, 0.85, 0.25), (0.90, 0.15, 0.12))
ELSEWHERE = 10.0  # times the largest shown, thirty times a scanner's noise: such a point is another body's
LEAST_LARGEST_M = 0.003  # at the end of the colours: three times the noise of a good scanner


def rows_shown(points: Array, element: Element | None) -> Index:
    """Return the rows of points [P][3] to show: all, or a random choice with a preference for the member."""
    if len(points) <= MOST_POINTS:
        return np.arange(len(points))
    random = np.random.default_rng(0)
    if element is None:
        return np.sort(random.choice(len(points), MOST_POINTS, replace=False))
    is_near = near(points, element)
    inside, far = np.flatnonzero(is_near), np.flatnonzero(~is_near)
    n_near = min(len(inside), max(int(NEAR_SHARE * MOST_POINTS), MOST_POINTS - len(far)))
    n_far = min(len(far), MOST_POINTS - n_near)
    chosen = [random.choice(inside, n_near, replace=False), random.choice(far, n_far, replace=False)]
    return np.sort(np.concatenate(chosen))


def near(points: Array, element: Element) -> npt.NDArray[np.bool_]:
    """Return which of points [P][3] are within a metre of an element's design."""
    return np.asarray(axis_distances_m(element, points) < NEAR_M + reach_m(element))


def colours_of(share: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return the colour [P][3] of each distance, a share of the largest shown, and which of them are on the member."""
    colours = np.tile(SCANNED, (len(share), 1))
    on_element = share < ELSEWHERE
    mixed = [np.interp(share[on_element], COLOUR_STOPS, c) for c in zip(*COLOURS, strict=True)]
    colours[on_element] = np.column_stack(mixed)
    return colours, on_element


def largest_shown_m(noise_m: float) -> float:
    """Return the distance at the end of the colours: three times a scan's noise, in whole millimetres; NaN: unknown."""
    return max(LEAST_LARGEST_M, round(3 * noise_m, 3)) if np.isfinite(noise_m) else LEAST_LARGEST_M


def ramp() -> str:
    """Return the colours from 0 to the largest distance as CSS."""
    stops = ", ".join(f"rgb({', '.join(str(round(255 * c)) for c in colour)})" for colour in COLOURS)
    return f"linear-gradient(90deg, {stops})"
