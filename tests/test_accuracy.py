"""Accuracy over 24 seeds, against the Cramer-Rao bound that `truth` computes from the truth alone."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from samples import SAMPLES
from truth import cramer_rao, kinematics, node_errors_m

import linear_ik
from linear_ik import Element, simulate

SEEDS = range(1, 25)
NOISE_M = 0.001
MOST_OVER_BOUND = 1.3
CHI2_95_TWO = 5.991

CASES = {
    "rectangle": ("rectangle", "8:x:22.5", ()),
    "half its faces": ("rectangle", "8:x:22.5", ("+x", "+y")),
    "circle": ("circle", "8:x:22.5", ()),
    "angle": ("l_shape", "8:y:22.5", ()),
    "tee": ("t_shape", "8:y:22.5", ()),
}


class Campaign(NamedTuple):
    """24 fits of one case.

    errors_m [S][N][3] of the nodes but the first, across_m [S][N][2] the same across the
    true axis, covariance_m2 [S][N][2][2] as stated there; bound_m2 [N][3][3].
    """

    errors_m: np.ndarray
    across_m: np.ndarray
    covariance_m2: np.ndarray
    bound_m2: np.ndarray


@cache
def campaign(name: str) -> Campaign:
    profile, bend, missing = CASES[name]
    element = Element(name, SAMPLES[profile], 2.5)
    errors, across, covariance, bound = [], [], [], []
    for seed in SEEDS:
        scan = simulate(element, bends=[bend], missing=missing, noise_m=NOISE_M, seed=seed)
        result = linear_ik.fit(element, scan.without_truth())
        assert node_errors_m(result, scan).max() < 0.001, seed
        rotations, _ = kinematics(scan.base_pose, scan.joint_angles_rad, element.segment_length_m)
        errors.append((result.nodes_m - scan.nodes_m)[1:])
        across.append(np.einsum("kji,kj->ki", rotations, errors[-1])[:, :2])
        local = np.einsum("kji,kjl,klm->kim", rotations, result.nodes_covariance_m2[1:], rotations)
        covariance.append(local[:, :2, :2])
        # It varies by 5 % from sample to sample: the mean of six scans stands for the 24.
        if seed % 4 == 0:
            bound.append(cramer_rao(element, scan, NOISE_M)[1:])
    return Campaign(np.array(errors), np.array(across), np.array(covariance), np.mean(bound, axis=0))


def rms_m(errors_m: np.ndarray) -> float:
    """Root of the mean squared distance."""
    return float(np.sqrt((errors_m**2).sum(axis=-1).mean()))


def deviation_m(covariance_m2: np.ndarray) -> float:
    """The same of an error with this covariance, or with the mean of these."""
    return float(np.sqrt(np.trace(covariance_m2, axis1=-2, axis2=-1).mean()))


def test_the_bound_is_the_one_we_know():
    bound = campaign("rectangle").bound_m2
    assert deviation_m(bound[-1]) * 1e3 == pytest.approx(0.142, rel=0.05)
    # The figure known, 0.099, counts the start node too, which is known exactly.
    everywhere = np.concatenate([np.zeros((1, 3, 3)), bound])
    assert deviation_m(everywhere) * 1e3 == pytest.approx(0.099, rel=0.05)


@pytest.mark.parametrize("name", CASES)
def test_errors_are_near_the_bound(name):
    runs = campaign(name)
    assert rms_m(runs.errors_m[:, -1]) <= MOST_OVER_BOUND * deviation_m(runs.bound_m2[-1])
    assert rms_m(runs.errors_m) <= MOST_OVER_BOUND * deviation_m(runs.bound_m2)


@pytest.mark.parametrize("name", CASES)
def test_no_bias_hides_in_the_errors(name):
    runs = campaign(name)
    bias = np.linalg.norm(runs.errors_m.mean(axis=0), axis=-1)
    # The mean of 24 unbiased estimates deviates by a fifth of the bound.
    assert bias.max() < 3 * deviation_m(runs.bound_m2) / np.sqrt(len(SEEDS)) + 2e-5


@pytest.mark.parametrize("name", CASES)
def test_the_ellipsoids_hold_what_they_promise(name):
    runs = campaign(name)
    inverse = np.linalg.inv(runs.covariance_m2)
    distance = np.einsum("ski,skij,skj->sk", runs.across_m, inverse, runs.across_m)
    assert 0.88 <= np.mean(distance < CHI2_95_TWO) <= 1.0
    # Nor are they wide for safety's sake: stated and bound agree within a quarter.
    stated = deviation_m(runs.covariance_m2)
    assert 0.7 * deviation_m(runs.bound_m2) < stated < 1.25 * deviation_m(runs.bound_m2)
