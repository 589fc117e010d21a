"""Equal lengths have an equal say, however much denser the scan is at the near end."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
from samples import SAMPLES
from truth import cramer_rao, node_errors_m

import linear_ik
from linear_ik import Element, FitResult, Scan, SimulatedScan, scan_virtually, simulate
from linear_ik.chain import Pose
from linear_ik.problem import Problem
from linear_ik.sampling import equal_shares, nearest_stretch, stratified

fit_module = importlib.import_module("linear_ik.fit")

RATIO = 50.0
NEAR_AND_FAR = [[0.9, 0.7, 0.2], [-9.0, -7.0, 5.0]]


def thinning_out(element: Element, bends: list[str], seed: int) -> SimulatedScan:
    """Some 11,000 points, 50 times as dense on the first segment as on the last."""
    scan = simulate(element, bends=bends, points=100_000, seed=seed)
    share = 0.4 * RATIO ** (-(scan.segment - 1) / (element.segments - 1))
    keep = np.random.default_rng([seed, 1]).random(len(scan)) < share
    return replace(
        scan, points=scan.points[keep], segment=scan.segment[keep], surface_normals=scan.surface_normals[keep]
    )


def outvoted(problem: Problem, pose: Pose, count: int, rng: np.random.Generator) -> np.ndarray:
    """The sample as it would be without strata."""
    points = problem.points
    return points[np.sort(rng.choice(len(points), min(count, len(points)), replace=False))].astype(np.float64)


@pytest.mark.parametrize(
    ("name", "bends"), [("rectangle", ["3:x:5", "9:x:12"]), ("circle", ["3:x:5", "9:y:12"]), ("l_shape", ["9:x:12"])]
)
def test_a_sparse_end_is_believed_and_fitted_to_the_bound(
    name: str, bends: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    element = Element(name, SAMPLES[name], 2.5)
    squares, bounds = [], []
    for seed in range(1, 7):
        scan = thinning_out(element, bends, seed)
        result = linear_ik.fit(element, Scan(scan.points))
        assert result.status == "converged", result.reasons
        assert "search" not in result.timings_s  # enough of the sparse end was looked at
        assert node_errors_m(result, scan)[-3:].max() < 0.001
        assert all(s.coverage > 0.5 for s in result.segments)
        squares.append(node_errors_m(result, scan)[1:] ** 2)
        bounds.append(np.trace(cramer_rao(element, scan, 0.001), axis1=1, axis2=2)[1:])
    assert np.sqrt(np.mean(squares)) < 1.2 * np.sqrt(np.mean(bounds))
    # The same points without strata: eight of the last segment are too few, and a search follows.
    monkeypatch.setattr(fit_module, "sample", outvoted)
    assert "search" in linear_ik.fit(element, Scan(scan.points)).timings_s


def two_stations(name: str) -> tuple[SimulatedScan, FitResult]:
    element = Element(name, SAMPLES[name], 5.0)
    scan = scan_virtually(element, stations=NEAR_AND_FAR, bends=["3:x:3", "8:x:20"], points=20_000, seed=2)
    count = np.bincount(scan.segment[scan.segment > 0])[1:]
    assert count.max() > 40 * count.min()
    return scan, linear_ik.fit(element, Scan(scan.points))


@pytest.mark.parametrize("name", ["rectangle", "circle", "l_shape", "i_shape"])
def test_two_stations_at_very_different_distances(name: str) -> None:
    scan, result = two_stations(name)
    assert node_errors_m(result, scan).max() < 0.001
    # The near station looks straight at the faces, where the noise along its rays shows in
    # full; that is no other surface.
    assert result.status == "converged", result.reasons


# strata ---------------------------------------------------------------------------------------


def test_a_sample_is_as_equal_as_the_points_allow() -> None:
    rng = np.random.default_rng(0)
    counts = [4000, 30, 2000, 500]
    z = np.concatenate([k + rng.random(count) for k, count in enumerate(counts)])
    points = np.column_stack([rng.normal(size=(len(z), 2)), z]).astype(np.float32)
    nodes = np.column_stack([np.zeros((5, 2)), np.arange(5.0)])
    rows = stratified(points, nodes, 1000, np.random.default_rng(1))
    assert np.bincount(z[rows].astype(int)).tolist() == pytest.approx([323, 30, 323, 323], abs=2)
    assert len(rows) == 1000 and (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(rows, stratified(points, nodes, 1000, np.random.default_rng(1)))
    assert (rows != stratified(points, nodes, 1000, np.random.default_rng(2))).any()
    np.testing.assert_array_equal(stratified(points, nodes, 10_000, rng), np.arange(len(points)))


@pytest.mark.parametrize("segments", [1, 3, 500])
def test_a_sample_of_any_chain_has_the_size_asked_for(segments: int) -> None:
    nodes = np.column_stack([np.zeros((segments + 1, 2)), np.linspace(0, 1, segments + 1)])
    points = np.random.default_rng(0).uniform(-3, 3, (5000, 3))
    assert len(stratified(points, nodes, 701, np.random.default_rng(0))) == 701


def test_a_chain_that_turns_back_keeps_its_legs_apart() -> None:
    nodes = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 2], [0.5, 0, 2], [0.5, 0, 1], [0.5, 0, 0]])
    middle = (nodes[1:] + nodes[:-1]) / 2
    assert nearest_stretch(middle, nodes).tolist() == [0, 1, 2, 3, 4]


def test_shares_are_equal_and_add_up() -> None:
    assert equal_shares(np.array([100, 100, 100]), 30) == [10, 10, 10]
    assert equal_shares(np.array([2, 100, 0, 5]), 30) == [2, 23, 0, 5]
    assert equal_shares(np.array([3, 3]), 6) == [3, 3]
    assert sum(equal_shares(np.array([7, 9, 50, 50]), 77)) == 77
