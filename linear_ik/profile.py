"""Profiles: the cross-sections of linear elements, named and measured as IFC does.

Every profile is drawn in its own plane, X to the right and Y up, in metres. The named
ones are centred on their bounding box (IfcParameterizedProfileDef); a polygon is used
as given. Fillets and circles become chords; `radius_m` says where the true shape is a
circle, so that nothing that measures needs the chords.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from linear_ik.outline import (
    box_outline,
    check_dimension,
    check_outline,
    check_thinner,
    ring_outline,
    rounded_outline,
)

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """A cross-section; its children hold the dimensions, all in metres."""

    type: ClassVar[str]

    def __post_init__(self) -> None:
        """Check every dimension, then that they make a section together."""
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "outline":
                object.__setattr__(self, f.name, check_dimension(f.name, value, zero=f.name == "fillet_radius"))
        self._check()

    def _check(self) -> None:
        """Raise ElementError when the dimensions contradict each other."""

    def outline(self) -> Array:
        """Return the outer outline [V][2], counter-clockwise, not closed."""
        raise TypeError(f"{type(self).__name__} has no outline of its own")

    def hole(self) -> Array | None:
        """Return the inner outline [V][2] of a hollow section, counter-clockwise, or None."""
        return None

    @property
    def radius_m(self) -> float | None:
        """Outer radius of a round section, None of any other."""
        return None


@dataclass(frozen=True)
class Rectangle(Profile):
    """IfcRectangleProfileDef."""

    type: ClassVar[str] = "rectangle"
    x_dim: float
    y_dim: float

    def outline(self) -> Array:
        """Four corners, counter-clockwise from (-X, -Y)."""
        return box_outline(self.x_dim, self.y_dim)


@dataclass(frozen=True)
class RectangleHollow(Profile):
    """IfcRectangleHollowProfileDef without its fillets."""

    type: ClassVar[str] = "rectangle_hollow"
    x_dim: float
    y_dim: float
    wall_thickness: float

    def _check(self) -> None:
        check_thinner("wall_thickness", self.wall_thickness, min(self.x_dim, self.y_dim) / 2, "half the smaller side")

    def outline(self) -> Array:
        """Four outer corners, counter-clockwise."""
        return box_outline(self.x_dim, self.y_dim)

    def hole(self) -> Array:
        """Four inner corners, counter-clockwise."""
        return box_outline(self.x_dim - 2 * self.wall_thickness, self.y_dim - 2 * self.wall_thickness)


@dataclass(frozen=True)
class Circle(Profile):
    """IfcCircleProfileDef."""

    type: ClassVar[str] = "circle"
    radius: float

    def outline(self) -> Array:
        """Corners of a regular polygon on the circle."""
        return ring_outline(self.radius)

    @property
    def radius_m(self) -> float:
        """The radius."""
        return self.radius


@dataclass(frozen=True)
class CircleHollow(Profile):
    """IfcCircleHollowProfileDef."""

    type: ClassVar[str] = "circle_hollow"
    radius: float
    wall_thickness: float

    def _check(self) -> None:
        check_thinner("wall_thickness", self.wall_thickness, self.radius, "the radius")

    def outline(self) -> Array:
        """Corners of a regular polygon on the outer circle."""
        return ring_outline(self.radius)

    def hole(self) -> Array:
        """Corners of a regular polygon on the inner circle."""
        return ring_outline(self.radius - self.wall_thickness)

    @property
    def radius_m(self) -> float:
        """The outer radius."""
        return self.radius


@dataclass(frozen=True)
class IShape(Profile):
    """IfcIShapeProfileDef: flanges along X, web along Y."""

    type: ClassVar[str] = "i_shape"
    overall_width: float
    overall_depth: float
    web_thickness: float
    flange_thickness: float
    fillet_radius: float = 0.0

    def _check(self) -> None:
        check_thinner("web_thickness", self.web_thickness, self.overall_width, "overall_width")
        check_thinner("flange_thickness", self.flange_thickness, self.overall_depth / 2, "half of overall_depth")
        room = min((self.overall_width - self.web_thickness) / 2, (self.overall_depth - 2 * self.flange_thickness) / 2)
        check_thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Twelve corners, the four inner ones rounded by fillet_radius."""
        x, y = self.overall_width / 2, self.overall_depth / 2
        w, f = self.web_thickness / 2, self.overall_depth / 2 - self.flange_thickness
        corners = [(-x, -y), (x, -y), (x, -f), (w, -f), (w, f), (x, f), (x, y), (-x, y), (-x, f), (-w, f), (-w, -f)]
        return rounded_outline([*corners, (-x, -f)], {3, 4, 9, 10}, self.fillet_radius)


@dataclass(frozen=True)
class LShape(Profile):
    """IfcLShapeProfileDef: corner at (-X, -Y), depth along Y, width along X."""

    type: ClassVar[str] = "l_shape"
    depth: float
    width: float
    thickness: float
    fillet_radius: float = 0.0

    def _check(self) -> None:
        check_thinner("thickness", self.thickness, min(self.depth, self.width), "the shorter leg")
        room = min(self.depth, self.width) - self.thickness
        check_thinner("fillet_radius", self.fillet_radius, room, "the room between the legs")

    def outline(self) -> Array:
        """Six corners, the inner one rounded by fillet_radius."""
        x, y, t = self.width / 2, self.depth / 2, self.thickness
        return rounded_outline(
            [(-x, -y), (x, -y), (x, t - y), (t - x, t - y), (t - x, y), (-x, y)], {3}, self.fillet_radius
        )


@dataclass(frozen=True)
class UShape(Profile):
    """IfcUShapeProfileDef: web on the -X side, depth along Y, flanges towards +X."""

    type: ClassVar[str] = "u_shape"
    depth: float
    flange_width: float
    web_thickness: float
    flange_thickness: float
    fillet_radius: float = 0.0

    def _check(self) -> None:
        check_thinner("web_thickness", self.web_thickness, self.flange_width, "flange_width")
        check_thinner("flange_thickness", self.flange_thickness, self.depth / 2, "half of depth")
        room = min(self.flange_width - self.web_thickness, self.depth / 2 - self.flange_thickness)
        check_thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Eight corners, the two inner ones rounded by fillet_radius."""
        x, y = self.flange_width / 2, self.depth / 2
        w, f = self.web_thickness - x, y - self.flange_thickness
        return rounded_outline(
            [(-x, -y), (x, -y), (x, -f), (w, -f), (w, f), (x, f), (x, y), (-x, y)], {3, 4}, self.fillet_radius
        )


@dataclass(frozen=True)
class TShape(Profile):
    """IfcTShapeProfileDef: flange at +Y, web centred on X = 0."""

    type: ClassVar[str] = "t_shape"
    depth: float
    flange_width: float
    web_thickness: float
    flange_thickness: float
    fillet_radius: float = 0.0

    def _check(self) -> None:
        check_thinner("web_thickness", self.web_thickness, self.flange_width, "flange_width")
        check_thinner("flange_thickness", self.flange_thickness, self.depth, "depth")
        room = min((self.flange_width - self.web_thickness) / 2, self.depth - self.flange_thickness)
        check_thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Eight corners, the two inner ones rounded by fillet_radius."""
        x, y = self.flange_width / 2, self.depth / 2
        w, f = self.web_thickness / 2, y - self.flange_thickness
        return rounded_outline(
            [(-w, -y), (w, -y), (w, f), (x, f), (x, y), (-x, y), (-x, f), (-w, f)], {2, 7}, self.fillet_radius
        )


@dataclass(frozen=True, init=False)
class Polygon(Profile):
    """IfcArbitraryClosedProfileDef with straight edges, used as given (not centred)."""

    type: ClassVar[str] = "polygon"
    corners: tuple[tuple[float, float], ...]

    def __init__(self, outline: Sequence[Sequence[float]]) -> None:
        """Take the corners in either sense of rotation, the first one repeated or not."""
        object.__setattr__(self, "corners", check_outline(outline))

    def outline(self) -> Array:
        """The corners, counter-clockwise."""
        return np.array(self.corners)


PROFILES: dict[str, type[Profile]] = {
    p.type: p for p in (Rectangle, RectangleHollow, Circle, CircleHollow, IShape, LShape, UShape, TShape, Polygon)
}
