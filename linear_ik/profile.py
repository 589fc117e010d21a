"""Profiles: the cross-sections of linear elements, named and measured as IFC does.

Every profile is drawn in its own plane, X to the right and Y up, in metres. The named
ones are centred on their bounding box (IfcParameterizedProfileDef); a polygon is used
as given. Fillets and circles become chords; `radius_m` says where the true shape is a
circle, so that nothing that measures needs the chords.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ElementError

Array = npt.NDArray[np.float64]

CIRCLE_CHORDS = 128  # 0.03 mm from a circle of 100 mm radius
FILLET_CHORDS = 6
LARGEST_DIMENSION_M = 100.0


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
        return _box(self.x_dim, self.y_dim)


@dataclass(frozen=True)
class RectangleHollow(Profile):
    """IfcRectangleHollowProfileDef without its fillets."""

    type: ClassVar[str] = "rectangle_hollow"
    x_dim: float
    y_dim: float
    wall_thickness: float

    def _check(self) -> None:
        _thinner("wall_thickness", self.wall_thickness, min(self.x_dim, self.y_dim) / 2, "half the smaller side")

    def outline(self) -> Array:
        """Four outer corners, counter-clockwise."""
        return _box(self.x_dim, self.y_dim)

    def hole(self) -> Array:
        """Four inner corners, counter-clockwise."""
        return _box(self.x_dim - 2 * self.wall_thickness, self.y_dim - 2 * self.wall_thickness)


@dataclass(frozen=True)
class Circle(Profile):
    """IfcCircleProfileDef."""

    type: ClassVar[str] = "circle"
    radius: float

    def outline(self) -> Array:
        """Corners of a regular polygon on the circle."""
        return _ring(self.radius)

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
        _thinner("wall_thickness", self.wall_thickness, self.radius, "the radius")

    def outline(self) -> Array:
        """Corners of a regular polygon on the outer circle."""
        return _ring(self.radius)

    def hole(self) -> Array:
        """Corners of a regular polygon on the inner circle."""
        return _ring(self.radius - self.wall_thickness)

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
        _thinner("web_thickness", self.web_thickness, self.overall_width, "overall_width")
        _thinner("flange_thickness", self.flange_thickness, self.overall_depth / 2, "half of overall_depth")
        room = min(
            (self.overall_width - self.web_thickness) / 2, (self.overall_depth - 2 * self.flange_thickness) / 2
        )
        _thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Twelve corners, the four inner ones rounded by fillet_radius."""
        x, y = self.overall_width / 2, self.overall_depth / 2
        w, f = self.web_thickness / 2, self.overall_depth / 2 - self.flange_thickness
        corners = [(-x, -y), (x, -y), (x, -f), (w, -f), (w, f), (x, f), (x, y), (-x, y), (-x, f), (-w, f), (-w, -f)]
        return _rounded([*corners, (-x, -f)], {3, 4, 9, 10}, self.fillet_radius)


@dataclass(frozen=True)
class LShape(Profile):
    """IfcLShapeProfileDef: corner at (-X, -Y), depth along Y, width along X."""

    type: ClassVar[str] = "l_shape"
    depth: float
    width: float
    thickness: float
    fillet_radius: float = 0.0

    def _check(self) -> None:
        _thinner("thickness", self.thickness, min(self.depth, self.width), "the shorter leg")
        room = min(self.depth, self.width) - self.thickness
        _thinner("fillet_radius", self.fillet_radius, room, "the room between the legs")

    def outline(self) -> Array:
        """Six corners, the inner one rounded by fillet_radius."""
        x, y, t = self.width / 2, self.depth / 2, self.thickness
        return _rounded(
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
        _thinner("web_thickness", self.web_thickness, self.flange_width, "flange_width")
        _thinner("flange_thickness", self.flange_thickness, self.depth / 2, "half of depth")
        room = min(self.flange_width - self.web_thickness, self.depth / 2 - self.flange_thickness)
        _thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Eight corners, the two inner ones rounded by fillet_radius."""
        x, y = self.flange_width / 2, self.depth / 2
        w, f = self.web_thickness - x, y - self.flange_thickness
        return _rounded(
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
        _thinner("web_thickness", self.web_thickness, self.flange_width, "flange_width")
        _thinner("flange_thickness", self.flange_thickness, self.depth, "depth")
        room = min((self.flange_width - self.web_thickness) / 2, self.depth - self.flange_thickness)
        _thinner("fillet_radius", self.fillet_radius, room, "the room between web and flange")

    def outline(self) -> Array:
        """Eight corners, the two inner ones rounded by fillet_radius."""
        x, y = self.flange_width / 2, self.depth / 2
        w, f = self.web_thickness / 2, y - self.flange_thickness
        return _rounded(
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
    p.type: p
    for p in (Rectangle, RectangleHollow, Circle, CircleHollow, IShape, LShape, UShape, TShape, Polygon)
}


def check_dimension(name: str, value: object, zero: bool = False) -> float:
    """Return ``value`` as metres, or raise ElementError naming it."""
    expected = f"metres, above 0 and up to {LARGEST_DIMENSION_M:g}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ElementError(name, f"{value!r} is not a number", expected)
    number = float(value)
    if not math.isfinite(number) or not (1e-5 <= number <= LARGEST_DIMENSION_M or (zero and number == 0.0)):
        raise ElementError(name, f"{number:g}", expected)
    return number


def check_outline(outline: object) -> tuple[tuple[float, float], ...]:
    """Return the corners of a simple polygon counter-clockwise, or raise ElementError."""
    expected = "at least three corners [x, y] in metres"
    try:
        corners = np.array(outline, dtype=np.float64)
    except (TypeError, ValueError):
        raise ElementError("outline", "not a list of number pairs", expected) from None
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ElementError("outline", f"shape {corners.shape}", expected)
    if len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    if not 3 <= len(corners) <= 1000:
        raise ElementError("outline", f"{len(corners)} corners", "3 to 1000 corners [x, y] in metres")
    if not np.isfinite(corners).all() or np.abs(corners).max() > LARGEST_DIMENSION_M:
        raise ElementError("outline", "a coordinate out of range", f"metres, up to {LARGEST_DIMENSION_M:g}")
    import shapely

    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or polygon.area < 1e-8:
        reason = shapely.is_valid_reason(polygon) if not polygon.is_valid else "no area"
        raise ElementError("outline", reason, "edges that neither cross nor touch, around an area")
    if not polygon.exterior.is_ccw:
        corners = corners[::-1]
    return tuple((float(x), float(y)) for x, y in corners)


def _thinner(name: str, value: float, room: float, what: str) -> None:
    if value > 0 and value >= room:
        raise ElementError(name, f"{value:g}", f"less than {what}, {room:g}")


def _box(x_dim: float, y_dim: float) -> Array:
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [x_dim / 2, y_dim / 2]


def _ring(radius: float) -> Array:
    angle = np.arange(CIRCLE_CHORDS) * (2 * np.pi / CIRCLE_CHORDS)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _rounded(corners: list[tuple[float, float]], which: set[int], radius: float) -> Array:
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
