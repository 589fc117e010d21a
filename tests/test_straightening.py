"""Bends that few points ask for are put back where the chain is more probable without them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from truth import across_errors_m

import linear_ik
from linear_ik import Element, IShape, simulate
from linear_ik.straightening import stiffest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))

from benchlib.scene_fits import staged  # noqa: E402


@pytest.mark.parametrize("seed", [208, 346])
def test_an_i_section_whose_web_is_hardly_seen_does_not_zigzag(seed):
    """Straight columns among clutter, 3 to 5 mm off before: some twenty points a segment tell where the web is."""
    scene = staged("random", seed)
    result = linear_ik.fit(scene.element, scene.scan.without_truth())
    assert across_errors_m(result, scene.scan).max() < 0.0015


def test_real_bends_stay():
    """Small ones in every joint, and a sharp one, of a member seen from one side: the search and what follows it."""
    element = Element("member", IShape(0.3, 0.3, 0.011, 0.019), 3.0)
    angles = np.radians(np.random.default_rng(4).uniform(-1.5, 1.5, (10, 3))) * [1, 1, 0]
    angles[6, 0] += np.radians(12.0)
    scan = simulate(element, joint_angles_rad=angles, missing=["+x"], seed=4)
    result = linear_ik.fit(element, scan.without_truth(), linear_ik.FitSettings(search="always"))
    assert np.abs(result.nodes_m - scan.nodes_m).max() < 0.0008


def test_the_stiffest_joint_makes_all_stiff_but_the_first():
    sd = np.arange(6 + 3 * 4, dtype=float) + 1.0
    stiff = stiffest(sd)
    np.testing.assert_array_equal(stiff[:9], sd[:9])
    np.testing.assert_array_equal(stiff[9:].reshape(-1, 3), np.tile(sd[9:12], (3, 1)))
