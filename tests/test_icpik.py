"""The paper's algorithm: its stop, its cap, its thresholds and weights, and what it shares with the default."""

from __future__ import annotations

import numpy as np
import pytest

import linear_ik
from linear_ik import icpik
from linear_ik.cloud_pairs import CloudPairs, ModelCloud
from linear_ik.element import Element
from linear_ik.problem import Problem
from linear_ik.profile import Rectangle
from linear_ik.scan import Scan
from linear_ik.settings import FitSettings
from linear_ik.simulate import simulate

BEAM = Element("beam", Rectangle(0.1, 0.3), 2.5)
PAPER = FitSettings(method="icpik")


def pairs_at(distance_m: list[float], counts: tuple[int, ...]) -> CloudPairs:
    starts = np.concatenate([[0], np.cumsum(counts)])
    d = np.array(distance_m)
    points = np.zeros((len(d), 3))
    return CloudPairs(starts, points, points + d[:, None] * [1.0, 0.0, 0.0], d)


def test_it_stops_where_all_pairs_are_within_a_millimetre(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = Problem.of(BEAM, simulate(BEAM, points=1000, seed=1)).chain
    monkeypatch.setattr(icpik, "MODEL_POINTS", 2_000)
    cloud = ModelCloud(Problem.of(BEAM, simulate(BEAM, points=1000, seed=1)).surface, chain.segment_length_m, 2_000, 0)
    result = linear_ik.fit(BEAM, Scan(cloud.at(chain.pose(np.zeros(chain.nv)))), PAPER)
    assert result.iterations == 1
    assert np.abs(result.nodes_m[-1] - [0, 0, 2.5]).max() < 1e-6


def test_independent_clouds_run_to_the_cap_and_say_so() -> None:
    scan = simulate(BEAM, bends=["8:x:9"], points=2_000, noise_m=0.001, seed=1)
    result = linear_ik.fit(BEAM, scan.without_truth(), FitSettings(method="icpik", max_iterations=1000))
    assert result.iterations == icpik.MOST_ITERATIONS == 100
    assert result.status == "max_iterations"


def test_the_threshold_opens_at_300_mm_and_shrinks() -> None:
    scan = simulate(BEAM, bends=["8:x:9"], points=1_000, noise_m=0.001, seed=1)
    result = linear_ik.fit(BEAM, scan.without_truth(), FitSettings(method="icpik", max_iterations=40))
    scales = [record.scale_m for record in result.history]
    assert scales[0] == icpik.OPENING_THRESHOLD_M == 0.3
    assert (np.diff(scales) < 0).all()


def test_it_brings_a_small_bend_to_a_centimetre() -> None:
    scan = simulate(BEAM, bends=["8:x:9"], points=10_000, noise_m=0.001, seed=1)
    result = linear_ik.fit(BEAM, scan.without_truth(), PAPER)
    assert np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1).max() < 0.010
    assert {record.phase for record in result.history} == {"icpik"}


def test_closer_pairs_and_richer_segments_weigh_more() -> None:
    pairs = pairs_at([0.0, icpik.QUARTER_WEIGHT_M, 0.3], (1, 2))
    weights = icpik.inverse_distance(pairs)
    assert weights[0] == 1.0 and weights[1] == pytest.approx(0.25) and weights[2] < 0.01
    assert icpik.segment_weights(pairs).tolist() == [0.5, 1.0, 1.0]
    assert len(icpik.segment_weights(pairs_at([], (0, 0)))) == 0


def test_a_held_end_counts_as_it_does_in_the_default() -> None:
    held = Element("beam", Rectangle(0.1, 0.3), 2.5, end="pinned", end_tolerance_m=1e-4)
    scan = simulate(BEAM, bends=["4:x:2"], points=2_000, noise_m=0.001, seed=1)
    settings = FitSettings(method="icpik", max_iterations=60)
    off = [
        np.linalg.norm(linear_ik.fit(e, scan.without_truth(), settings).nodes_m[-1] - [0, 0, 2.5]) for e in (BEAM, held)
    ]
    assert off[0] > 0.03 and off[1] < 0.6 * off[0]
