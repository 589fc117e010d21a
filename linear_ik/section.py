"""Section properties: area, centroid and second moments of a profile, and its extrusion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from linear_ik.profile import Circle, CircleHollow, Profile, Rectangle

if TYPE_CHECKING:
    import trimesh

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SectionProperties:
    """Integrals over a section.

    Attributes:
        area_m2: of the material, holes left out.
        centroid_m: (x, y) in the profile's plane.
        ixx_m4: integral of y^2 about the centroid.
        iyy_m4: integral of x^2 about the centroid.
        ixy_m4: integral of x y about the centroid (product of inertia).
    """

    area_m2: float
    centroid_m: tuple[float, float]
    ixx_m4: float
    iyy_m4: float
    ixy_m4: float


@dataclass(frozen=True)
class BodyInertia:
    """Mass properties of an extruded section.

    Attributes:
        mass_kg: of the body.
        centre_m: centre of mass; z runs along the extrusion from 0.
        ixx, ixy, iyy, izz: inertia about the centre of mass in kg m^2, axes parallel to
            the section's; ixz and iyz of a prism are 0.
    """

    mass_kg: float
    centre_m: tuple[float, float, float]
    ixx: float
    ixy: float
    iyy: float
    izz: float


def section_properties(profile: Profile) -> SectionProperties:
    """Return the integrals over a profile's section.

    Exact for rectangles, circles and rings; of every other profile the outline minus the
    hole is integrated exactly by Green's theorem, fillets being the outline's chords.
    """
    if isinstance(profile, (Circle, CircleHollow)):
        r = profile.radius
        inner = r - profile.wall_thickness if isinstance(profile, CircleHollow) else 0.0
        # a^4 - b^4 = (a^2 - b^2)(a^2 + b^2): no cancellation for thin walls.
        area = math.pi * (r - inner) * (r + inner)
        second = area * (r * r + inner * inner) / 4
        return SectionProperties(area, (0.0, 0.0), second, second, 0.0)
    if isinstance(profile, Rectangle):
        x, y = profile.x_dim, profile.y_dim
        return SectionProperties(x * y, (0.0, 0.0), x * y**3 / 12, y * x**3 / 12, 0.0)
    outline, hole = profile.outline(), profile.hole()
    # About a point of the section: a polygon far from its origin would lose its digits.
    origin = outline.mean(axis=0)
    moments = _polygon_moments(outline - origin)
    if hole is not None:
        moments = moments - _polygon_moments(hole - origin)
    area, sx, sy, xx, yy, xy = (float(m) for m in moments)
    cx, cy = sx / area, sy / area
    return SectionProperties(
        area_m2=area,
        centroid_m=(float(origin[0]) + cx, float(origin[1]) + cy),
        ixx_m4=yy - area * cy * cy,
        iyy_m4=xx - area * cx * cx,
        ixy_m4=xy - area * cx * cy,
    )


def body_inertia(profile: Profile, length_m: float, density_kg_m3: float) -> BodyInertia:
    """Return the mass properties of a profile extruded along Z from 0 to ``length_m``."""
    s = section_properties(profile)
    line = density_kg_m3 * length_m
    mass = line * s.area_m2
    across = mass * length_m**2 / 12
    return BodyInertia(
        mass_kg=mass,
        centre_m=(*s.centroid_m, length_m / 2),
        ixx=line * s.ixx_m4 + across,
        ixy=0.0 - line * s.ixy_m4,
        iyy=line * s.iyy_m4 + across,
        izz=line * (s.ixx_m4 + s.iyy_m4),
    )


def extruded_mesh(profile: Profile, length_m: float) -> trimesh.Trimesh:
    """Return the closed surface of a profile extruded along Z from 0 to ``length_m``."""
    import shapely
    import trimesh

    hole = profile.hole()
    polygon = shapely.Polygon(profile.outline(), [] if hole is None else [hole])
    return trimesh.creation.extrude_polygon(polygon, length_m, engine="earcut")


def _polygon_moments(outline: Array) -> Array:
    """Return the integrals of 1, x, y, x^2, y^2, x y over a counter-clockwise polygon (Green)."""
    x0, y0 = outline.T
    x1, y1 = np.roll(outline, -1, axis=0).T
    cross = x0 * y1 - x1 * y0
    return np.array(
        [
            cross.sum() / 2,
            (cross * (x0 + x1)).sum() / 6,
            (cross * (y0 + y1)).sum() / 6,
            (cross * (x0 * x0 + x0 * x1 + x1 * x1)).sum() / 12,
            (cross * (y0 * y0 + y0 * y1 + y1 * y1)).sum() / 12,
            (cross * (x0 * y1 + 2 * x0 * y0 + 2 * x1 * y1 + x1 * y0)).sum() / 24,
        ]
    )
