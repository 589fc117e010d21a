"""IfcProfileDef -> PlacedProfile, in metres, in the plane of the swept area."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.broken import BROKEN, said
from linear_ik.bim.placed_profile import PlacedProfile, carried, centred
from linear_ik.bim.recognition import recognise
from linear_ik.errors import DesignError, ElementError
from linear_ik.profile import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Profile,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)

Array = npt.NDArray[np.float64]

# Slopes, in radians, of flanges and legs whose sides are then no rectangle's: 1 mm over 100 mm.
SLOPED = 0.01


class ProfileReader:
    """Reads the profiles of one file, each once.

    Args:
        unit_m: one of the file's length units.
        angle_rad: one of its angle units.
        tolerance_m: how far a drawn outline may be from the profile it is taken for.
    """

    def __init__(self, unit_m: float, angle_rad: float, tolerance_m: float) -> None:
        """Start with none."""
        self._unit_m = unit_m
        self._angle_rad = angle_rad
        self._tolerance_m = tolerance_m
        self._known: dict[int, PlacedProfile | str] = {}

    def stand_in(self, definition: Any, original: Any) -> None:
        """Read a definition from now on as another one that was read before."""
        self._known[definition.id()] = self.read(original)

    def read(self, definition: Any) -> PlacedProfile:
        """Return a profile.

        Raises:
            DesignError: said of the profile: no section can be made of it.
        """
        key = definition.id()
        if key not in self._known:
            try:
                self._known[key] = self._read(definition)
            except (DesignError, ElementError) as error:
                self._known[key] = f"{error.subject} {error.what}"
            except BROKEN as error:
                self._known[key] = f"cannot be read: {said(error)}"
        found = self._known[key]
        if isinstance(found, str):
            raise DesignError(f"its profile ({definition.is_a()})", found)
        return found

    def drawn(self, outline: Array, holes: tuple[Array, ...] = ()) -> PlacedProfile:
        """Return the profile that an outline in metres draws.

        Raises:
            ElementError: it draws none.
        """
        return recognise(outline, holes, self._tolerance_m)

    def _read(self, definition: Any) -> PlacedProfile:
        kind = definition.is_a()
        if definition.is_a("IfcDerivedProfileDef"):
            parent = self._read(definition.ParentProfile)
            # IfcMirroredProfileDef is one too; its operator is derived, and not written.
            linear, offset_m = (
                (np.diag([-1.0, 1.0]), np.zeros(2))
                if kind == "IfcMirroredProfileDef"
                else self._operator(definition.Operator)
            )
            moved = carried(parent, linear, offset_m)
            return self.drawn(parent.outline() @ linear.T + offset_m) if moved is None else moved
        profile = self._parameterised(kind, definition)
        if profile is None:
            return self._drawn_by_library(definition)
        return self._positioned(centred(profile), definition.Position)

    def _parameterised(self, kind: str, d: Any) -> Profile | None:
        """Return the package's own profile for IFC's, or None where it has none."""
        m = self._unit_m
        if kind == "IfcRectangleProfileDef":
            return Rectangle(d.XDim * m, d.YDim * m)
        if kind == "IfcRectangleHollowProfileDef":
            return RectangleHollow(d.XDim * m, d.YDim * m, d.WallThickness * m)
        if kind == "IfcCircleProfileDef":
            return Circle(d.Radius * m)
        if kind == "IfcCircleHollowProfileDef":
            return CircleHollow(d.Radius * m, d.WallThickness * m)
        if self._sloped(d):
            return None
        r = (getattr(d, "FilletRadius", None) or 0.0) * m
        if kind == "IfcIShapeProfileDef":
            return IShape(d.OverallWidth * m, d.OverallDepth * m, d.WebThickness * m, d.FlangeThickness * m, r)
        if kind == "IfcLShapeProfileDef":
            return LShape(d.Depth * m, (d.Width or d.Depth) * m, d.Thickness * m, r)
        if kind == "IfcUShapeProfileDef":
            return UShape(d.Depth * m, d.FlangeWidth * m, d.WebThickness * m, d.FlangeThickness * m, r)
        if kind == "IfcTShapeProfileDef":
            return TShape(d.Depth * m, d.FlangeWidth * m, d.WebThickness * m, d.FlangeThickness * m, r)
        return None

    def _sloped(self, d: Any) -> bool:
        slopes = (getattr(d, name, None) or 0.0 for name in ("FlangeSlope", "LegSlope", "WebSlope"))
        return any(abs(slope * self._angle_rad) > SLOPED for slope in slopes)

    def _positioned(self, placed: PlacedProfile, position: Any) -> PlacedProfile:
        if position is None:
            return placed
        x = np.array(position.RefDirection.DirectionRatios[:2] if position.RefDirection else (1.0, 0.0))
        x /= np.linalg.norm(x)
        R = np.array([[x[0], -x[1]], [x[1], x[0]]])
        moved = carried(placed, R, np.array(position.Location.Coordinates[:2]) * self._unit_m)
        assert moved is not None  # a rotation
        return moved

    def _operator(self, operator: Any) -> tuple[Array, Array]:
        """Return an IfcCartesianTransformationOperator2D as a linear map [2][2] and an offset [2] in metres."""
        first, second = operator.Axis1, operator.Axis2
        if first is not None:
            u = np.array(first.DirectionRatios[:2], dtype=np.float64)
            u /= np.linalg.norm(u)
            v = np.array([-u[1], u[0]])
            if second is not None and float(v @ np.array(second.DirectionRatios[:2])) < 0:
                v = -v
        else:
            v = np.array(second.DirectionRatios[:2] if second is not None else (0.0, 1.0), dtype=np.float64)
            v /= np.linalg.norm(v)
            u = np.array([v[1], -v[0]])
        scale = operator.Scale or 1.0
        scale_2 = getattr(operator, "Scale2", None) or scale
        return np.column_stack([scale * u, scale_2 * v]), np.array(operator.LocalOrigin.Coordinates[:2]) * self._unit_m

    def _drawn_by_library(self, definition: Any) -> PlacedProfile:
        """Return the profile as its boundary curves draw it, arcs as chords."""
        from linear_ik.bim.tessellation import profile_rings

        rings = profile_rings(definition)
        if not rings:
            raise DesignError("its outline", "is not closed")
        import shapely

        rings.sort(key=lambda ring: -shapely.Polygon(ring).area)
        return self.drawn(rings[0], tuple(rings[1:]))
