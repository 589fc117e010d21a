"""Section properties: area, centroid and second moments of a profile, and its extrusion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from linear_ik.profile import Circle, CircleHollow, Profile, Rectangle
from linear_ik.taper import between

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
    """Mass properties of a section extruded, tapering or not.

    Attributes:
        mass_kg: of the body.
        centre_m: centre of mass; z runs along the extrusion from 0.
        ixx, ixy, iyy, izz: inertia about the centre of mass in kg m^2, axes parallel to
            the section's.
        ixz, iyz: the same; 0 for a prism.
    """

    mass_kg: float
    centre_m: tuple[float, float, float]
    ixx: float
    ixy: float
    iyy: float
    izz: float
    ixz: float = 0.0
    iyz: float = 0.0


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


def body_inertia(
    profile: Profile, length_m: float, density_kg_m3: float, profile_end: Profile | None = None
) -> BodyInertia:
    """Return the mass properties of a profile extruded along Z from 0 to ``length_m``.

    Args:
        profile: the section, of a taper the one at 0.
        length_m: of the body.
        density_kg_m3: of the material.
        profile_end: the section at ``length_m``, where the body tapers.
    """
    if profile_end is not None:
        return _tapered_inertia(profile, profile_end, length_m, density_kg_m3)
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


def _tapered_inertia(start: Profile, end: Profile, length_m: float, density_kg_m3: float) -> BodyInertia:
    """Integrate over the sections along a taper.

    Their corners are linear in z, so area and moments are polynomials of at most the
    fourth degree in z, with z^2 of the sixth, which four points of Gauss integrate exactly.
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for node, weight in zip(nodes, weights, strict=True):
        share = (1.0 + node) / 2.0
        s = section_properties(between(start, end, share))
        slice_kg = density_kg_m3 * s.area_m2 * weight * length_m / 2.0
        centre = np.array([*s.centroid_m, share * length_m])
        total += slice_kg
        first += slice_kg * centre
        # Of x x', about the origin: the section's own moments over its area, and its centre's.
        own = np.array([[s.iyy_m4, s.ixy_m4, 0.0], [s.ixy_m4, s.ixx_m4, 0.0], [0.0, 0.0, 0.0]]) / s.area_m2
        second += slice_kg * (own + np.outer(centre, centre))
    centre = first / total
    spread = second - total * np.outer(centre, centre)
    inertia = np.trace(spread) * np.eye(3) - spread
    return BodyInertia(
        mass_kg=total,
        centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
        ixx=float(inertia[0, 0]),
        ixy=float(inertia[0, 1]),
        iyy=float(inertia[1, 1]),
        izz=float(inertia[2, 2]),
        ixz=float(inertia[0, 2]),
        iyz=float(inertia[1, 2]),
    )


def extruded_mesh(profile: Profile, length_m: float, profile_end: Profile | None = None) -> trimesh.Trimesh:
    """Return the closed surface of a profile extruded along Z from 0 to ``length_m``, where it may be another."""
    import shapely
    import trimesh

    if profile_end is not None:
        start, end = (outlines(p) for p in (profile, profile_end))
        z = np.repeat([0.0, length_m], sum(len(ring) for ring in start))
        return trimesh.Trimesh(np.column_stack([np.concatenate([*start, *end]), z]), prism_triangles(start, end))
    hole = profile.hole()
    polygon = shapely.Polygon(profile.outline(), [] if hole is None else [hole])
    return trimesh.creation.extrude_polygon(polygon, length_m, engine="earcut")


def outlines(profile: Profile) -> list[Array]:
    """Return the outer outline [V][2] of a profile and, of a hollow one, the inner."""
    return [ring for ring in (profile.outline(), profile.hole()) if ring is not None]


def prism_triangles(start: list[Array], end: list[Array]) -> npt.NDArray[np.int64]:
    """Return the triangles [T][3] of a closed body between two sections, counter-clockwise from outside.

    Args:
        start: outlines at one end, the outer one first; the body's first vertices.
        end: outlines at the other, corner for corner; its other vertices.
    """
    m = sum(len(ring) for ring in start)
    return np.concatenate([cap_triangles(start)[:, ::-1], cap_triangles(end) + m, side_triangles(start)])


def side_triangles(rings: list[Array]) -> npt.NDArray[np.int64]:
    """Return the triangles [T][3] between a section's corners and those of the next one, which follow them.

    Args:
        rings: outlines [V][2], the outer one first.
    """
    stops = np.cumsum([len(ring) for ring in rings])
    m = stops[-1]
    parts = []
    for i, ring in enumerate(rings):
        a = np.arange(len(ring)) + stops[i] - len(ring)
        b = np.roll(a, -1)
        sides = np.concatenate([np.column_stack([a, b, b + m]), np.column_stack([a, b + m, a + m])])
        parts.append(sides if i == 0 else sides[:, ::-1])
    return np.concatenate(parts)


def cap_triangles(rings: list[Array]) -> npt.NDArray[np.int64]:
    """Return the triangles [T][3] of a section, counter-clockwise."""
    import mapbox_earcut

    corners, stops = np.concatenate(rings), np.cumsum([len(ring) for ring in rings])
    cap = mapbox_earcut.triangulate_float64(corners, stops.astype(np.uint32)).reshape(-1, 3).astype(np.int64)
    a, b, c = corners[cap].transpose(1, 0, 2)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    cap[clockwise] = cap[clockwise, ::-1]
    return np.asarray(cap)


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
