"""Elastic sag: how own weight bends a member that is straight by design, by Euler and Bernoulli.

With the section's second moments J(s) about its centroid, the area A(s), the part g of gravity across
the axis and the deflection u(s), both vectors in the section's plane,

    (E J u'')'' = rho A g,    J = [[int x^2, int x y], [int x y, int y^2]],

so that both principal axes have their part, whichever way the section is rolled. The moments are
integrated exactly for prisms; of tapers at four points of Gauss a segment. Shear and torsion are left
out: a beam ten times as long as deep sags a few per cent more, a channel or an angle turns as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.section import SectionProperties, section_properties

Array = npt.NDArray[np.float64]
Supports = Literal["simple", "clamped", "cantilever", "cantilever_end"]

GRAVITY_M_S2 = 9.80665  # standard gravity (CGPM 1901)
# Of the sag, 95 %: E and the mass of rolled steel are known to some per cent. Ours; a person may state another.
SHARE_95 = 0.05
BAND_95 = 1.959964
UP = (0.0, 0.0, 1.0)
# How start and end are held.
HELD: dict[str, tuple[str, str]] = {
    "simple": ("pinned", "pinned"),
    "clamped": ("clamped", "clamped"),
    "cantilever": ("clamped", "free"),
    "cantilever_end": ("free", "clamped"),
}
# What is zero there: u, its slope, the moment, the shear force.
ZERO = {"pinned": ("u", "M"), "clamped": ("u", "slope"), "free": ("M", "V")}


@dataclass(frozen=True)
class Material:
    """What own weight needs of a material.

    Attributes:
        elastic_modulus_gpa: Young's modulus, along the member.
        density_kg_m3: of the material.
        name: in words; may be empty.
        source: where the figures stand; may be empty.

    Raises:
        SettingsError: a figure out of its range.
    """

    elastic_modulus_gpa: float
    density_kg_m3: float
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        """Check both figures."""
        for name, most in (("elastic_modulus_gpa", 2000.0), ("density_kg_m3", 30000.0)):
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not 0.0 < value <= most:
                raise SettingsError(f"material.{name}", f"{value!r}", f"a number above 0, up to {most:g}")

    def __str__(self) -> str:
        """Say what is taken: its name, and the figures."""
        figures = f"E {self.elastic_modulus_gpa:g} GPa, {self.density_kg_m3:g} kg/m3"
        return f"{self.name}: {figures}" if self.name else figures


MATERIALS = {"steel": Material(210.0, 7850.0, "steel", "EN 1993-1-1, 3.2.6; EN 1991-1-1, table A.4 (78.5 kN/m3)")}


@dataclass(frozen=True, eq=False)
class ElasticSag:
    """What own weight makes of a member.

    Attributes:
        displacement_m: [N+1][3] of each node from the unstressed shape, element's frame.
        offset_m: [N+1][3] the same relative to the chord between the ends.
        share95: half-width of its 95 % band as a share of it.
        largest_m: the largest of ``offset_m``.
        supports: as stated.
        material: as stated.
    """

    displacement_m: Array
    offset_m: Array
    share95: float
    supports: Supports
    material: Material

    @property
    def largest_m(self) -> float:
        """The largest of ``offset_m``, without sign."""
        return float(np.linalg.norm(self.offset_m, axis=1).max())

    @property
    def sd_m(self) -> Array:
        """Standard deviation [N+1][3] of the displacement, all nodes in step."""
        return np.asarray(self.share95 / BAND_95 * self.displacement_m)

    @property
    def said(self) -> str:
        """What it was computed for, in words."""
        held = {
            "simple": "simply supported",
            "clamped": "clamped at both ends",
            "cantilever": "cantilever held at its start",
            "cantilever_end": "cantilever held at its end",
        }
        return f"{held[self.supports]}, {self.material}"


def elastic_sag(
    element: Element,
    supports: Supports,
    material: Material,
    up: tuple[float, float, float] = UP,
    share95: float = SHARE_95,
) -> ElasticSag:
    """Return how own weight bends a member.

    Args:
        element: as designed; the slope of its axis takes its part of the weight.
        supports: simple (both ends turn freely), clamped (neither turns), cantilever (held at its start),
            cantilever_end (held at its end).
        material: of all of it.
        up: the vertical, in the scan's coordinates.
        share95: half-width of the sag's 95 % band, as a share of it.

    Raises:
        SettingsError: other supports.
        LinearIkError: a member that is curved by design.
    """
    if supports not in get_args(Supports):
        raise SettingsError("supports", f"{supports!r}", "one of " + ", ".join(get_args(Supports)))
    if element.axis_points is not None:
        raise LinearIkError(element.name, "is curved by design", "a straight member")
    n, length_m = element.segments, element.length_m
    vertical = np.asarray(up, dtype=np.float64) @ element.placement.T_world_element[:3, :3]
    g = -GRAVITY_M_S2 * vertical[:2] / np.linalg.norm(vertical)
    z, weights = _places(n)
    bend, unit = _flexibility(element, z, material.elastic_modulus_gpa * 1e9)
    # A taper's corners are linear in z, so its area is a polynomial of the second degree.
    areas = [section_properties(element.profile_at(share)).area_m2 for share in (0.0, 0.5, 1.0)]
    load = np.polynomial.Polynomial.fit([0.0, 0.5, 1.0], areas, 2).convert()
    # Lengths in shares of L: the moment's second derivative is L^2 times the load.
    moment = (load * (material.density_kg_m3 * length_m**2 / unit)).integ(2)

    # Unknown: a and b of the moment M = m(z) g + a + b z, c and d of u = c + d z + L^2 double integral of u''.
    double = np.maximum(np.arange(n + 1)[:, None] / n - z, 0.0) * (z < np.arange(n + 1)[:, None] / n) * weights
    single, eye, none = weights[None], np.eye(2), np.zeros((2, 2))

    def row(what: str, at: float) -> tuple[Array, Array]:
        """Return the coefficients [2][8] of the unknowns, and what the load alone gives [2]."""
        if what == "M":
            return np.hstack([eye, at * eye, none, none]), moment(at) * g
        if what == "V":
            return np.hstack([none, eye, none, none]), moment.deriv()(at) * g
        of = (double[-1:] if what == "u" else single) if at else np.zeros((1, len(z)))
        a, b = (np.einsum("p,pij->ij", of[0] * f, bend) for f in (np.ones(len(z)), z))
        ends = [eye, at * eye] if what == "u" else [none, eye]
        return np.hstack([a, b, *ends]), np.einsum("p,pij,j->i", of[0] * moment(z), bend, g)

    rows = [row(what, at) for at, held in zip((0.0, 1.0), HELD[supports], strict=True) for what in ZERO[held]]
    a, b, c, d = np.linalg.solve(np.vstack([r for r, _ in rows]), -np.concatenate([f for _, f in rows])).reshape(4, 2)
    curvature = np.einsum("pij,pj->pi", bend, np.outer(moment(z), g) + a + np.outer(z, b))
    share = np.arange(n + 1)[:, None] / n
    u = np.zeros((n + 1, 3))
    # Scaled by L^2 with the unit of the moments, so that u'' is per unit of z^2.
    u[:, :2] = (double @ curvature + c + share * d) * length_m**2
    return ElasticSag(u, u - (1.0 - share) * u[0] - share * u[-1], share95, supports, material)


def _places(n: int) -> tuple[Array, Array]:
    """Return places [4 n] along the unit length, four in each of n segments, and their weights (Gauss)."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    z = (np.arange(n)[:, None] + (1.0 + nodes) / 2.0) / n
    return z.ravel(), np.tile(weights / (2.0 * n), n)


def _flexibility(element: Element, z: Array, modulus_pa: float) -> tuple[Array, float]:
    """Return J^-1 [P][2][2] at each place in units of the stiffest direction of the start, and that E J in N m^2."""
    first = _second_moments(section_properties(element.profile))
    most_m4 = float(np.linalg.eigvalsh(first)[-1])
    if not element.is_tapered:
        bend = np.broadcast_to(np.linalg.inv(first / most_m4), (len(z), 2, 2))
    else:
        sections = [_second_moments(section_properties(element.profile_at(float(share)))) for share in z]
        bend = np.linalg.inv(np.stack(sections) / most_m4)
    return np.asarray(bend), modulus_pa * most_m4


def _second_moments(p: SectionProperties) -> Array:
    """Return J [2][2] of a section: the load along e bends it along J^-1 e."""
    return np.array([[p.iyy_m4, p.ixy_m4], [p.ixy_m4, p.ixx_m4]])
