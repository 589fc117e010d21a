"""Own weight on beams: textbook formulas, a real section, sections rolled about their axis, tapers."""

from __future__ import annotations

import numpy as np
import pytest
from posed import BEAM, COLUMN

from linear_ik.elastic_sag import GRAVITY_M_S2, MATERIALS, Material, elastic_sag
from linear_ik.element import Element, Placement
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.profile import Circle, LShape, Rectangle
from linear_ik.section import section_properties
from linear_ik.section_names import section

STEEL = MATERIALS["steel"]
E, RHO, G = 210e9, 7850.0, 9.80665
FORMULAS = [
    # supports, factor of q L^4 / E I, where as a share of the length
    ("simple", 5 / 384, 0.5),
    ("clamped", 1 / 384, 0.5),
    ("cantilever", 1 / 8, 1.0),
    ("cantilever_end", 1 / 8, 0.0),
]


def beam(
    profile: object, length_m: float, segments: int = 10, roll_rad: float = 0.0, slope_rad: float = 0.0
) -> Element:
    """X and then Y of the section turned from the horizontal by the roll, the axis from it by the slope."""
    axis = np.array([np.cos(slope_rad), 0.0, np.sin(slope_rad)])
    up = np.array([-np.sin(slope_rad), 0.0, np.cos(slope_rad)])
    x = np.cos(roll_rad) * np.array([0.0, 1.0, 0.0]) + np.sin(roll_rad) * up
    return Element("beam", profile, length_m, segments, Placement((5e5, 5e6, 7.0), tuple(axis), tuple(x)))  # type: ignore[arg-type]


def world(element: Element, vectors: np.ndarray) -> np.ndarray:
    return vectors @ element.placement.T_world_element[:3, :3].T


@pytest.mark.parametrize(("supports", "factor", "share"), FORMULAS)
@pytest.mark.parametrize("segments", [2, 10, 100])
def test_textbook(supports: str, factor: float, share: float, segments: int) -> None:
    """5 q L^4 / 384 E I, q L^4 / 384 E I, q L^4 / 8 E I, downwards, at the place that they hold for."""
    member = beam(Rectangle(0.1, 0.2), 8.0, segments)
    q, second_m4 = RHO * G * 0.1 * 0.2, 0.1 * 0.2**3 / 12
    hand_m = factor * q * 8.0**4 / (E * second_m4)
    sag = elastic_sag(member, supports, STEEL)  # type: ignore[arg-type]
    fall = world(member, sag.displacement_m)
    np.testing.assert_allclose(fall[round(share * segments)], [0, 0, -hand_m], rtol=1e-9, atol=1e-15)
    assert np.abs(fall[:, 2]).max() == pytest.approx(hand_m, rel=1e-9)


@pytest.mark.parametrize(
    ("supports", "shape"),
    [
        ("simple", lambda x: x * (1 - 2 * x**2 + x**3) / 24),
        ("clamped", lambda x: x**2 * (1 - x) ** 2 / 24),
        ("cantilever", lambda x: x**2 * (6 - 4 * x + x**2) / 24),
    ],
)
def test_textbook_along_the_length(supports: str, shape: object) -> None:
    member = beam(Rectangle(0.1, 0.2), 8.0, 16)
    x = np.linspace(0, 1, 17)
    hand_m = shape(x) * RHO * G * 0.02 * 8.0**4 / (E * 0.1 * 0.2**3 / 12)  # type: ignore[operator]
    sag = elastic_sag(member, supports, STEEL)  # type: ignore[arg-type]
    np.testing.assert_allclose(world(member, sag.displacement_m)[:, 2], -hand_m, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(world(member, sag.offset_m)[:, 2], -hand_m + x * hand_m[-1], rtol=1e-9, atol=1e-14)
    assert sag.largest_m == pytest.approx(np.abs(hand_m - x * hand_m[-1]).max(), rel=1e-9)


def test_a_rolled_section_of_a_table() -> None:
    """IPE 300, 12 m, 42.2 kg/m and 8356 cm^4 in the tables of EN 10365: 6.37 mm between two hinges."""
    hand_m = 5 / 384 * 42.2 * G * 12.0**4 / (E * 8356e-8)
    assert hand_m == pytest.approx(6.37e-3, abs=5e-6)
    upright = elastic_sag(beam(section("IPE300"), 12.0), "simple", STEEL)
    assert upright.largest_m == pytest.approx(hand_m, rel=0.003)
    # Lying on its side, 604 cm^4: fourteen times as much.
    flat = elastic_sag(beam(section("IPE300"), 12.0, roll_rad=np.pi / 2), "simple", STEEL)
    assert flat.largest_m == pytest.approx(5 / 384 * 42.2 * G * 12.0**4 / (E * 604e-8), rel=0.003)


def test_both_principal_axes_have_their_part() -> None:
    """A rolled rectangle and an angle: resolve gravity along the principal axes, bend about each, add up."""
    for profile, roll in ((Rectangle(0.1, 0.3), 0.5), (LShape(0.15, 0.1, 0.012), 0.0), (LShape(0.1, 0.1, 0.01), 0.3)):
        member = beam(profile, 6.0, roll_rad=roll)
        p = section_properties(profile)
        second, axes = np.linalg.eigh([[p.iyy_m4, p.ixy_m4], [p.ixy_m4, p.ixx_m4]])
        gravity = np.array([-np.sin(roll), -np.cos(roll)])
        hand_m = (
            5
            / 384
            * RHO
            * G
            * p.area_m2
            * 6.0**4
            / E
            * sum((gravity @ axis) / i * axis for i, axis in zip(second, axes.T, strict=True))
        )
        middle = elastic_sag(member, "simple", STEEL).displacement_m[5]
        np.testing.assert_allclose(middle, [*hand_m, 0.0], rtol=1e-9, atol=1e-15)
        sideways, down = world(member, middle)[1], -world(member, middle)[2]
        assert down > 0 and abs(sideways) > 0.1 * down


def test_a_round_or_square_section_sags_straight_down_however_it_is_rolled() -> None:
    for profile in (Circle(0.05), Rectangle(0.1, 0.1)):
        straight, rolled = (elastic_sag(beam(profile, 5.0, roll_rad=a), "clamped", STEEL).largest_m for a in (0.0, 0.7))
        assert rolled == pytest.approx(straight, rel=1e-12)


def test_a_slope_takes_its_part_and_a_column_none() -> None:
    level, steep = (elastic_sag(beam(Rectangle(0.1, 0.2), 5.0, slope_rad=a), "simple", STEEL) for a in (0.0, np.pi / 3))
    assert steep.largest_m == pytest.approx(0.5 * level.largest_m, rel=1e-9)
    column = Element("column", Rectangle(0.1, 0.2), 5.0, 10, COLUMN)
    assert elastic_sag(column, "cantilever", STEEL).largest_m < 1e-15


def test_a_taper() -> None:
    """A cantilever whose width falls to a third, against a fine sum of the same integral."""
    member = Element("arm", Rectangle(0.3, 0.2), 4.0, 8, BEAM, profile_end=Rectangle(0.1, 0.2))
    x = np.linspace(0.0, 4.0, 200_001)
    width = 0.3 - 0.05 * x
    load, second = RHO * G * width * 0.2, width * 0.2**3 / 12

    def summed(f: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum((f[1:] + f[:-1]) / 2 * np.diff(x))])

    shear = summed(load)[-1] - summed(load)
    moment = summed(shear)[-1] - summed(shear)
    fall = summed(summed(moment / (E * second)))
    sag = elastic_sag(member, "cantilever", STEEL)
    np.testing.assert_allclose(-world(member, sag.displacement_m)[:, 2], fall[::25_000], rtol=1e-6, atol=1e-12)


def test_figures_of_steel_and_of_others() -> None:
    assert (STEEL.elastic_modulus_gpa, STEEL.density_kg_m3, GRAVITY_M_S2) == (210.0, 7850.0, G)
    assert str(STEEL) == "steel: E 210 GPa, 7850 kg/m3" and "EN 1993-1-1" in STEEL.source
    member = beam(Rectangle(0.1, 0.2), 5.0)
    timber = elastic_sag(member, "simple", Material(11.0, 420.0)).largest_m
    assert timber / elastic_sag(member, "simple", STEEL).largest_m == pytest.approx(420 / 11 / (7850 / 210), rel=1e-9)


def test_what_cannot_be_computed_is_said() -> None:
    curved = Element("arc", Rectangle(0.1, 0.2), 2.0, 4, axis_points=((0, 0, 0), (0, 0, 2.0)))
    with pytest.raises(LinearIkError, match="curved by design"):
        elastic_sag(curved, "simple", STEEL)
    with pytest.raises(SettingsError, match="one of simple, clamped"):
        elastic_sag(beam(Rectangle(0.1, 0.2), 5.0), "hinged", STEEL)  # type: ignore[arg-type]
    for figures, named in (((0.0, 7850.0), "elastic_modulus_gpa"), ((210.0, float("nan")), "density_kg_m3")):
        with pytest.raises(SettingsError, match=named):
            Material(*figures)
