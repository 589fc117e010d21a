"""A member that bends between two joints of its chain: its nodes there are off, and the fit says so."""

from dataclasses import replace

import numpy as np
import pytest
from samples import SAMPLES

import linear_ik
from linear_ik import CircleHollow, Element, Rectangle, simulate

PIPE = CircleHollow(0.084, 0.0045)


def kinked(profile, degrees: float, segments: int, seed: int):
    """Return a member of 10 segments with one kink, fitted with so many segments, and how far its nodes are off."""
    built = Element("member", profile, 6.0, segments=10, start="free")
    scan = simulate(built, bends=[f"4:y:{degrees}"], points=4000, noise_m=0.0015, seed=seed)
    result = linear_ik.fit(replace(built, segments=segments), scan.without_truth())
    there = np.linspace(0, 10, segments + 1)
    true = np.column_stack([np.interp(there, np.arange(11), column) for column in scan.nodes_m.T])
    return result, float(np.linalg.norm((result.nodes_m - true)[:, :2], axis=1).max())


@pytest.mark.parametrize("profile", [PIPE, Rectangle(0.1, 0.3)], ids=["pipe", "rectangle"])
def test_a_kink_between_two_joints_is_a_doubt_that_names_its_segment(profile):
    result, off_m = kinked(profile, 4.0, 12, seed=1)
    assert result.status == "uncertain" and "bends_between_joints" in result.reason_codes, result.reasons
    assert result.reasons[result.reason_codes.index("bends_between_joints")].startswith("segment 4:")
    if profile is PIPE:
        # What it is a doubt of.
        assert off_m > 0.002


@pytest.mark.parametrize(("degrees", "segments"), [(4.0, 10), (0.5, 12)], ids=["at a joint", "slight"])
def test_a_kink_at_a_joint_or_a_slight_one_is_none(degrees, segments):
    for seed in (1, 2, 3):
        result, off_m = kinked(PIPE, degrees, segments, seed)
        assert "bends_between_joints" not in result.reason_codes and off_m < 0.002, result.reasons


@pytest.mark.parametrize("name", ["i_shape", "rectangle_hollow"])
def test_sharp_bends_at_joints_of_other_sections_are_none(name):
    beam = Element("member", SAMPLES[name], 2.5)
    scan = simulate(beam, bends=["4:y:30", "7:x:-20"], points=4000, noise_m=0.002, seed=1, missing=["-x"])
    assert "bends_between_joints" not in linear_ik.fit(beam, scan.without_truth()).reason_codes
