"""Profiles as IFC entities: the design's own where it is drawn as the element's, else a new one."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.asbuilt.draft import Draft
from linear_ik.profile import Polygon, Profile

Array = npt.NDArray[np.float64]

# What two programs make of one dimension differs by their rounding.
SAME_M = 1e-5

CLASSES = {
    "rectangle": "IfcRectangleProfileDef",
    "rectangle_hollow": "IfcRectangleHollowProfileDef",
    "circle": "IfcCircleProfileDef",
    "circle_hollow": "IfcCircleHollowProfileDef",
    "i_shape": "IfcIShapeProfileDef",
    "l_shape": "IfcLShapeProfileDef",
    "u_shape": "IfcUShapeProfileDef",
    "t_shape": "IfcTShapeProfileDef",
}


def profile_entity(draft: Draft, profile: Profile, designed: Any) -> Any:
    """Return an IfcProfileDef that shows ``profile`` in its own axes.

    Args:
        draft: the file.
        profile: the element's section.
        designed: the IfcProfileDef of the designed body, or None. It is taken as it is where its outline is the
            section's: with its name, its roundings and its holes.
    """
    if designed is not None and _shows(draft, designed, profile):
        return designed
    name = getattr(designed, "ProfileName", None)
    key = (profile, name)
    if key not in draft.profiles:
        draft.profiles[key] = _new(draft, profile, name)
    return draft.profiles[key]


def _new(draft: Draft, profile: Profile, name: str | None) -> Any:
    common = {"ProfileType": "AREA", "ProfileName": name}
    if profile.type not in CLASSES:
        corners = profile.outline()
        points = [draft.point(corner) for corner in corners]
        return draft.make(
            "IfcArbitraryClosedProfileDef", OuterCurve=draft.make("IfcPolyline", Points=[*points, points[0]]), **common
        )
    position = draft.make("IfcAxis2Placement2D", Location=draft.point((0.0, 0.0)))
    dimensions = {
        _attribute(f.name): draft.length(getattr(profile, f.name))
        for f in fields(profile)
        # A fillet of 0 is none: IFC wants it positive.
        if f.name != "fillet_radius" or profile.fillet_radius > 0  # type: ignore[attr-defined]
    }
    return draft.make(CLASSES[profile.type], Position=position, **common, **dimensions)


def _attribute(name: str) -> str:
    """Return IFC's spelling of a dimension: x_dim is XDim."""
    return "".join(part.capitalize() for part in name.split("_"))


def _shows(draft: Draft, entity: Any, profile: Profile) -> bool:
    """Say whether an IfcProfileDef is drawn as ``profile`` is."""
    if entity.ProfileType != "AREA":
        return False
    if isinstance(profile, Polygon):
        # With or without voids: the element knows the outer outline only.
        return bool(entity.is_a("IfcArbitraryClosedProfileDef")) and _same_outline(
            _polyline(draft, entity.OuterCurve), profile.outline()
        )
    if entity.is_a() != CLASSES.get(profile.type) or not _centred(entity.Position):
        return False
    for f in fields(profile):
        stated = getattr(entity, _attribute(f.name), None) or 0.0
        if abs(stated * draft.unit_m - getattr(profile, f.name)) > SAME_M:
            return False
    return True


def _centred(position: Any) -> bool:
    if position is None:
        return True
    ref = position.RefDirection
    turned = ref is not None and abs(ref.DirectionRatios[1]) > 1e-9 * abs(ref.DirectionRatios[0])
    reversed_x = ref is not None and ref.DirectionRatios[0] < 0
    return not (turned or reversed_x or any(abs(v) > 1e-9 for v in position.Location.Coordinates))


def _polyline(draft: Draft, curve: Any) -> Array | None:
    """Return the corners [V][2] of a closed polyline in metres, or None of another curve."""
    if curve.is_a("IfcPolyline"):
        rows = [p.Coordinates[:2] for p in curve.Points]
    elif curve.is_a("IfcIndexedPolyCurve") and not any(s.is_a("IfcArcIndex") for s in curve.Segments or ()):
        rows = list(curve.Points.CoordList)
    else:
        return None
    corners = np.array(rows, dtype=np.float64) * draft.unit_m
    return corners[:-1] if len(corners) > 1 and np.abs(corners[0] - corners[-1]).max() < SAME_M else corners


def _same_outline(given: Array | None, wanted: Array) -> bool:
    """Say whether two closed outlines are the same, whatever their first corner and sense of rotation."""
    if given is None or len(given) != len(wanted):
        return False
    for corners in (given, given[::-1]):
        first = int(np.abs(corners - wanted[0]).max(axis=1).argmin())
        if np.abs(np.roll(corners, -first, axis=0) - wanted).max() <= SAME_M:
            return True
    return False
