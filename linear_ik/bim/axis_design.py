"""Members that are drawn as lines: an axis and a material with a profile, and no body."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.placed_profile import PlacedProfile
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.sweep import Sweep, line_frame, seated
from linear_ik.bim.tessellation import curve_points
from linear_ik.errors import DesignError

Array = npt.NDArray[np.float64]

# IfcCardinalPointReference 1 to 9, in halves of the section: seen along the axis, with X to the left and Y up.
CARDINAL_POINTS = {i + 1: np.array([1 - i % 3, i // 3 - 1], dtype=np.float64) for i in range(9)}
MIDDLE = 5
REMARK = "it has no body: read from its axis and the profile of its material"


def sweep_of_axis(product: Any, profiles: ProfileReader) -> Sweep | None:
    """Return the section along the axis of a product, or None where it has no axis or no profile.

    The axis runs through the cardinal point of the section; the section's middle is where
    IFC's bounding box puts it.

    Raises:
        DesignError: an axis or a cardinal point that leaves the section's place open.
    """
    axis = _axis(product)
    usage = _usage(product)
    if axis is None or usage is None:
        return None
    points = curve_points(axis)
    if points is None or len(points) < 2:
        raise DesignError("its axis", "is not one line")
    along = points[-1] - points[0]
    off = np.linalg.norm(np.cross(points - points[0], along / np.linalg.norm(along)), axis=1).max()
    if off > 1e-6 or np.hypot(*along[:2]) > 1e-6 * np.linalg.norm(along):
        raise DesignError("its axis", "is not straight along its own Z, so that nothing turns its section")
    point = usage.CardinalPoint or MIDDLE
    if point not in CARDINAL_POINTS:
        raise DesignError("its axis", f"runs through cardinal point {point} of its section (1 to 9 are known)")
    placed = profiles.read(usage.ForProfileSet.MaterialProfiles[0].Profile)
    outline = placed.profile.outline() @ placed.R.T
    half = np.ptp(outline, axis=0) / 2
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    # The section moves so that its own cardinal point comes onto the axis.
    moved = PlacedProfile(placed.profile, placed.R, -middle - CARDINAL_POINTS[point] * half)
    T_line = line_frame(points[0], along, np.array([1.0, 0.0, 0.0]))
    if along[2] < 0:
        raise DesignError("its axis", "runs against its own Z")
    return Sweep(seated(T_line, moved), placed.profile, float(np.linalg.norm(along)))


def placement_of(product: Any, unit_m: float) -> Array:
    """Return where a product without a body is [4][4], metres."""
    import ifcopenshell.util.placement as placements

    T = np.array(placements.get_local_placement(product.ObjectPlacement), dtype=np.float64)
    T[:3, 3] *= unit_m
    return T


def _axis(product: Any) -> Any:
    shape = product.Representation
    found = [] if shape is None else [r for r in shape.Representations if r.RepresentationIdentifier == "Axis"]
    return found[0].Items[0] if found and len(found[0].Items) == 1 else None


def _usage(product: Any) -> Any:
    import ifcopenshell.util.element as elements

    material = elements.get_material(product)
    if material is None or not material.is_a("IfcMaterialProfileSetUsage"):
        return None
    profiles = material.ForProfileSet.MaterialProfiles
    return material if len(profiles) == 1 else None
