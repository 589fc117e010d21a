"""Coordinates that are not what they should be: other units, or digits lost in single precision."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.errors import SettingsError

Array = npt.NDArray[np.float64]

SCAN_UNITS = {"m": 1.0, "mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048, "us-ft": 1200 / 3937}
"""What a scan file may be in, by what a person calls it: one of it in metres."""
NAMES = {"mm": "millimetres", "cm": "centimetres", "in": "inches", "ft": "feet", "us-ft": "US survey feet"}
UNITS = {**{NAMES[unit]: SCAN_UNITS[unit] for unit in NAMES}, "metres taken for feet": 1 / 0.3048}
MOST_POINTS = 100_000
LEAST_POINTS = 100
LEAST_EXTENT = 0.5  # of the element's length: a clump of points may come near by chance
REACH = 1.2  # lengths from the start
SHORT = 100.0  # times as long as all of the scan: no member, but a length in another unit
COARSE_STEP_M = 0.001  # finer steps drown in a scanner's noise


def metres_of(unit: str) -> float:
    """Return one of a scan's unit in metres.

    Raises:
        SettingsError: a unit that is not in SCAN_UNITS.
    """
    if unit not in SCAN_UNITS:
        raise SettingsError("unit", repr(unit), "one of " + ", ".join(SCAN_UNITS))
    return SCAN_UNITS[unit]


def how_to_say(name: str) -> str:
    """Return, in brackets, how a person says that a scan is in one of UNITS; nothing where it cannot be said."""
    return next((f" (--scan-unit {unit})" for unit, called in NAMES.items() if called == name), "")


def unit_hint(points: Array, T_world_element: Array, length_m: float) -> str | None:
    """Return a sentence that names the unit in which a scan would hold the element, or None.

    Asked only where no points are in reach: scaled to metres, at least 100 are, and they
    spread over half the element's length.

    Args:
        points: [P][3] in the scan's coordinates.
        T_world_element: [4][4] the element's placement.
        length_m: of the element.
    """
    some = points[:: max(1, len(points) // MOST_POINTS)]
    best, most = None, LEAST_POINTS - 1
    for unit, factor in UNITS.items():
        offset = some * factor - T_world_element[:3, 3]
        near = offset[np.einsum("ij,ij->i", offset, offset) <= (REACH * length_m) ** 2]
        if len(near) > most and np.ptp(near, axis=0).max() >= LEAST_EXTENT * length_m:
            said = f"the scan seems to be in {unit}: times {factor:.4g} it would be where the element is"
            best, most = said + how_to_say(unit), len(near)
    return best


def length_hint(points: Array, length_m: float) -> str | None:
    """Return a sentence where an element is a hundred times as long as all that a scan [P][3] spans, or None."""
    span_m = float(np.ptp(points, axis=0).max())
    if length_m < SHORT * span_m:
        return None
    return f"all of the scan spans {span_m:.3g} m, the designed length is {length_m:g} m: is it given in metres?"


def coarse_step_m(points: Array) -> float | None:
    """Return the step of coordinates that were once stored in single precision, or None where it is below 1 mm.

    Single precision has 24 bits: at 500 km a step is 31 mm, at 5000 km half a metre. Each
    axis is looked at by itself, and text files round what they hold to decimals.

    Args:
        points: [P][3] in the scan's coordinates.
    """
    some = points[:: max(1, len(points) // 1000)]
    step_m = np.spacing(np.abs(some).max(axis=0).astype(np.float32)).astype(np.float64)
    off_m = np.abs(some - some.astype(np.float32)).max(axis=0)
    # By chance a coordinate is within 0.3 steps of one in six cases out of ten; a hundred of them never are.
    stored = (step_m >= COARSE_STEP_M) & (off_m <= (0.3 if len(some) >= LEAST_POINTS else 0.0) * step_m)
    # But a thin member across that axis is near one step with all of its points, which then differ from each other.
    places = np.ptp(some, axis=0) / step_m + 2.0
    stored &= np.array([len(np.unique(column)) for column in some.T]) <= 2.0 * places
    return float(step_m[stored].max()) if stored.any() else None


def distance_hint(points: Array, T_world_element: Array) -> str:
    """Return a sentence on how far from the element's placement the nearest point of a scan [P][3] is."""
    some = points[:: max(1, len(points) // MOST_POINTS)]
    nearest_m = float(np.sqrt(((some - T_world_element[:3, 3]) ** 2).sum(axis=1).min()))
    far = f"{nearest_m / 1000:.0f} km" if nearest_m >= 10_000 else f"{nearest_m:.1f} m"
    return f"the nearest point of the scan is {far} from the element's placement"
