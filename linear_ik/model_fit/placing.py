"""Placing: the scan into the model's coordinates, and what may be wrong where it is not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.coordinates import UNITS, how_to_say
from linear_ik.design_model import DesignModel
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.site_check import SiteCheck
from linear_ik.site_frames import CLEARLY

Array = npt.NDArray[np.float64]

NEAR_M = 1.0  # boxes of scan and design that come so near may belong together


def scan_to_model(model: DesignModel, options: ModelFitOptions) -> Array | None:
    """Return what takes the scan into the model's coordinates [4][4], or None where it is in them.

    Raises:
        SettingsError: the map's coordinates, and a design without map conversion.
    """
    if not options.map_coordinates:
        return options.T_model_scan
    if model.map_conversion is None:
        raise SettingsError("map_coordinates", f"{model.source} has no map conversion", "an IfcMapConversion")
    return np.asarray(np.linalg.inv(model.map_conversion.T_map_model))


def check_place(model: DesignModel, sample: Array, extent: dict[str, Any], scan: Path) -> None:
    """Refuse a scan that is beyond doubt in other coordinates: its fits would take their time and find nothing.

    Args:
        model: the design.
        sample: [P][3] some points of the scan; nothing is said where there are none.
        extent: what was read of the scan.
        scan: its file, for the error.

    Raises:
        LinearIkError: another unit or other axes, as `SiteCheck` sees it.
    """
    if not len(sample):
        return
    near = extent["in_a_neighbourhood"] / max(extent["points"], 1)
    # Where so many points are in their place no change brings clearly more; and a check samples all the model.
    if CLEARLY * near >= 1.0:
        return
    sentence = SiteCheck(model).sure_change(sample, near)
    if sentence:
        raise LinearIkError(scan, sentence, "the model's coordinates; --scan-unit m takes it as it is")


def why_nothing(model: DesignModel, scan_box_m: Array) -> str:
    """Return a sentence on why no point of the scan is near an element.

    Args:
        model: the design.
        scan_box_m: [2][3] least and largest coordinates of the scan, taken to be the model's.
    """
    starts = np.array([m.element.placement.T_world_element[:3, 3] for m in model.members])
    lengths = np.array([[m.element.length_m] for m in model.members])
    design = np.stack([(starts - lengths).min(axis=0), (starts + lengths).max(axis=0)])
    if model.map_conversion is not None:
        T = np.linalg.inv(model.map_conversion.T_map_model)
        corners = np.stack(np.meshgrid(*scan_box_m.T, indexing="ij"), axis=-1).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
        if _apart_m(np.stack([corners.min(axis=0), corners.max(axis=0)]), design) < NEAR_M:
            return "no point is near an element: the scan seems to be in the map's coordinates (--map)"
    apart_m = _apart_m(scan_box_m, design)
    if not _alike(scan_box_m, design):
        for unit, factor in UNITS.items():
            scaled = scan_box_m * factor
            if _alike(scaled, design) and _apart_m(scaled, design) < NEAR_M:
                return f"no point is near an element: the scan seems to be in {unit}{how_to_say(unit)}"
    if apart_m < NEAR_M:
        return "no point is near an element, though the scan is about where the design is (linear-ik align lays it on)"
    far = f"{apart_m / 1000:.0f} km" if apart_m >= 10_000 else f"{apart_m:.1f} m"
    return f"no point is near an element: the scan and the design are {far} apart (--transform; see linear-ik align)"


def _alike(a: Array, b: Array) -> bool:
    """Whether two boxes [2][3] are about as large as each other."""
    return bool(0.1 < np.ptp(a, axis=0).max() / max(np.ptp(b, axis=0).max(), 1e-9) < 10)


def _apart_m(a: Array, b: Array) -> float:
    """Return the distance between two boxes [2][3]; 0 where they overlap."""
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(a[0] - b[1], b[0] - a[1]))))
