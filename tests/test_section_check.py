"""Section check: silent on the right section, right about a wrong one, silent where the scan cannot tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from samples import SAMPLES

from linear_ik.chain import Chain
from linear_ik.correspondence import Correspondences, Matcher
from linear_ik.element import Element
from linear_ik.profile import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Polygon,
    Profile,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)
from linear_ik.section_check import SectionMisfit, section_misfit
from linear_ik.simulate import simulate
from linear_ik.surface import Surface

NOISE_M = 0.001
THIN: dict[str, Profile] = {
    "thin_t": TShape(0.1, 0.1, 0.004, 0.004),
    "thin_l": LShape(0.08, 0.08, 0.005),
    "flat": Rectangle(0.006, 0.1),
    "small_tube": CircleHollow(0.03, 0.003),
}


def check(
    designed: Profile,
    built: Profile,
    seed: int = 0,
    missing: Sequence[str] = (),
    noise_m: float = NOISE_M,
    points: int = 6_000,
    moved_m: Sequence[float] = (0.0, 0.0),
) -> SectionMisfit | None:
    """The check of a built member's scan against the designed section, the fit off by ``moved_m``."""
    element = Element("e", built, 2.5, 10)
    scan = simulate(element, bends=["8:x:10"], points=points, noise_m=noise_m, seed=seed, missing=missing)
    surface, pairs = matched(element, designed, scan.points + [*moved_m, 0.0], scan.q)
    return section_misfit(surface, pairs, pairs.distance_m <= 4 * noise_m, noise_m)


def matched(element: Element, designed: Profile, points: np.ndarray, q: np.ndarray) -> tuple[Surface, Correspondences]:
    chain, surface = Chain.of(element), Surface.of(designed)
    return surface, Matcher(surface, chain.segment_length_m).match(chain.pose(chain.with_q(q)), points)


def stretched(profile: Profile, wider_m: float, deeper_m: float) -> Profile:
    """The same section, every dimension in proportion."""
    corners = profile.outline()
    return Polygon((corners * (1 + np.array([wider_m, deeper_m]) / np.ptp(corners, axis=0))).tolist())


def change_m(misfit: SectionMisfit | None, designed: Profile) -> np.ndarray:
    assert misfit is not None
    return (misfit.scale - 1) * np.ptp(designed.outline(), axis=0)


# the right section ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["rectangle", "circle", "i_shape_fillet", "l_shape", "u_shape", "t_shape", "polygon", *THIN]
)
def test_the_right_section_is_right_over_twenty_seeds(name: str) -> None:
    profile = (SAMPLES | THIN)[name]
    assert [check(profile, profile, seed) for seed in range(20)] == [None] * 20


@pytest.mark.parametrize("noise_m", [0.0002, 0.002, 0.003])
@pytest.mark.parametrize("name", ["rectangle", "i_shape", "u_shape_fillet", *THIN])
def test_no_noise_makes_it_wrong_not_even_one_as_wide_as_the_plate(name: str, noise_m: float) -> None:
    profile = (SAMPLES | THIN)[name]
    assert [check(profile, profile, seed, noise_m=noise_m) for seed in range(3)] == [None] * 3


@pytest.mark.parametrize("missing", [["+x"], ["+y"], ["+x", "+y"], ["-x", "+x"]])
@pytest.mark.parametrize("name", ["rectangle", "circle", "i_shape", "thin_t"])
def test_nor_do_missing_sides(name: str, missing: list[str]) -> None:
    profile = (SAMPLES | THIN)[name]
    assert [check(profile, profile, seed, missing=missing) for seed in range(3)] == [None] * 3


@pytest.mark.parametrize("name", ["rectangle", "i_shape", "circle", "t_shape"])
def test_nor_does_a_fit_that_is_a_little_off(name: str) -> None:
    profile = SAMPLES[name]
    assert check(profile, profile, moved_m=(0.0007, -0.0004)) is None


# a wrong section ------------------------------------------------------------------------------

OFF_M = [(0.001, 0.0), (0.0, -0.001), (-0.002, 0.003), (0.003, -0.002)]
OFF = pytest.mark.parametrize(("wider_m", "deeper_m"), OFF_M)


@OFF
@pytest.mark.parametrize(
    "profile",
    [Rectangle(0.1, 0.3), RectangleHollow(0.12, 0.12, 0.006), Rectangle(0.2, 0.14)],
    ids=["beam", "box", "timber"],
)
def test_a_box_is_measured_to_a_fifth_of_a_millimetre(profile: Profile, wider_m: float, deeper_m: float) -> None:
    for seed in range(3):
        misfit = check(profile, stretched(profile, wider_m, deeper_m), seed)
        np.testing.assert_allclose(change_m(misfit, profile), [wider_m, deeper_m], rtol=0, atol=0.0002)
        assert misfit is not None and misfit.plausible


@pytest.mark.parametrize("off_m", [-0.0015, -0.0005, 0.0005, 0.0015])
@pytest.mark.parametrize(("radius", "cls"), [(0.15, Circle), (0.0885, Circle), (0.06, CircleHollow)])
def test_a_radius_is_measured_to_a_tenth_of_a_millimetre(radius: float, cls: type, off_m: float) -> None:
    wall = (0.005,) if cls is CircleHollow else ()
    for seed in range(3):
        misfit = check(cls(radius, *wall), cls(radius + off_m, *wall), seed)
        assert misfit is not None and misfit.plausible
        np.testing.assert_allclose((misfit.scale - 1) * radius, off_m, rtol=0, atol=0.0001)


@OFF
@pytest.mark.parametrize("moved_m", [(0.0, 0.0), (0.0004, -0.0005)])
def test_a_section_is_told_from_a_shift(wider_m: float, deeper_m: float, moved_m: Sequence[float]) -> None:
    beam = Rectangle(0.1, 0.3)
    misfit = check(beam, stretched(beam, wider_m, deeper_m), moved_m=moved_m)
    np.testing.assert_allclose(change_m(misfit, beam), [wider_m, deeper_m], rtol=0, atol=0.0002)


@pytest.mark.parametrize(
    ("designed", "built", "axis", "off_m"),
    [
        (IShape(0.3, 0.3, 0.011, 0.019), IShape(0.3, 0.302, 0.011, 0.019), 1, 0.002),
        (IShape(0.3, 0.34, 0.012, 0.0215, 0.027), IShape(0.3, 0.337, 0.012, 0.0215, 0.027), 1, -0.003),
        (UShape(0.3, 0.1, 0.01, 0.016), UShape(0.302, 0.1, 0.01, 0.016), 1, 0.002),
    ],
    ids=["deeper H", "shallower H", "deeper channel"],
)
def test_depth_between_flanges(designed: Profile, built: Profile, axis: int, off_m: float) -> None:
    # Plates keep their thickness: the outer faces move as in a stretched section, the inner ones a little more.
    for seed in range(3):
        change = change_m(check(designed, built, seed), designed)
        assert change[axis] == pytest.approx(off_m, abs=0.0003)
        assert change[1 - axis] == 0


def test_with_one_direction_seen_from_both_sides_only_that_one_is_measured() -> None:
    beam, built = Rectangle(0.1, 0.3), Rectangle(0.102, 0.303)
    misfit = check(beam, built, missing=["+y"])
    np.testing.assert_allclose(change_m(misfit, beam), [0.002, 0], rtol=0, atol=0.0002)


@pytest.mark.parametrize("profile", [Rectangle(0.1, 0.3), RectangleHollow(0.12, 0.12, 0.006)], ids=["beam", "box"])
@pytest.mark.parametrize("missing", [["+x", "+y"], ["-x", "+y"]])
def test_from_one_side_only_nothing_is_said(profile: Profile, missing: list[str]) -> None:
    for off_m in (-0.003, 0.002):
        assert check(profile, stretched(profile, off_m, off_m), missing=missing) is None


def test_one_side_of_an_h_shows_both_its_flanges() -> None:
    designed, built = IShape(0.3, 0.3, 0.011, 0.019), IShape(0.3, 0.303, 0.011, 0.019)
    assert change_m(check(designed, built, missing=["+x", "+y"]), designed)[1] == pytest.approx(0.003, abs=0.0003)


def test_thicker_legs_are_not_taken_for_a_wider_angle() -> None:
    # Of an L's width only the thin end of a leg tells: too little to tell it from the rest.
    designed, thicker = LShape(0.15, 0.1, 0.012), LShape(0.15, 0.1, 0.013)
    assert [check(designed, thicker, seed) for seed in range(3)] == [None] * 3


def test_another_section_altogether_is_not_plausible() -> None:
    beam = Rectangle(0.1, 0.3)
    misfit = check(beam, Rectangle(0.108, 0.3), noise_m=0.002)
    assert misfit is not None and not misfit.plausible
    assert change_m(misfit, beam)[0] == pytest.approx(0.008, abs=0.001)


def test_a_tenth_of_a_millimetre_is_no_misfit() -> None:
    beam = Rectangle(0.1, 0.3)
    assert check(beam, Rectangle(0.1002, 0.3003), noise_m=0.0002) is None


def test_a_few_points_tell_nothing() -> None:
    beam = Rectangle(0.1, 0.3)
    assert check(beam, Rectangle(0.103, 0.303), points=100) is None


def test_points_that_are_not_used_do_not_count() -> None:
    beam = Rectangle(0.1, 0.3)
    element = Element("e", Rectangle(0.103, 0.303), 2.5, 10)
    scan = simulate(element, points=5000)
    surface, pairs = matched(element, beam, scan.points, scan.q)
    assert section_misfit(surface, pairs, np.zeros(5000, dtype=bool), NOISE_M) is None
    assert section_misfit(surface, pairs, np.ones(5000, dtype=bool), NOISE_M) is not None


# what is said ----------------------------------------------------------------------------------


def test_it_is_said_in_millimetres() -> None:
    misfit = SectionMisfit(np.array([1.02, 0.99]), True)
    said = misfit.sentence(Surface.of(Rectangle(0.1, 0.3)))
    assert said == "the section measures 102.0 x 297.0 mm where 100.0 x 300.0 mm was designed"
    said = SectionMisfit(np.array([1.02, 1.02]), True).sentence(Surface.of(Circle(0.1)))
    assert said == "the section's radius measures 102.0 mm where 100.0 mm was designed"
