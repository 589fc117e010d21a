"""The same point twice is one measurement."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from samples import SAMPLES

import linear_ik
from linear_ik import Element, Scan, simulate
from linear_ik.duplicates import point_keys, repeated
from linear_ik.element import Placement
from linear_ik.problem import in_reach

AT_MAP = Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2))


@pytest.mark.parametrize("method", ["default", "icpik"])
@pytest.mark.parametrize("placement", [Placement((0, 0, 0)), AT_MAP], ids=["origin", "map"])
def test_a_file_given_twice_changes_nothing(method: str, placement: Placement, tmp_path: Path) -> None:
    element = Element("e", SAMPLES["rectangle"], 2.5, placement=placement)
    scan = simulate(element, bends=["8:x:22.5"], points=3001).without_truth()
    path = linear_ik.write_scan(scan, tmp_path / "scan.ply")
    # The paper's method would go on for a hundred iterations, each of which could tell the two apart.
    most = 12 if method == "icpik" else 20_000
    settings = linear_ik.FitSettings(method=method, max_iterations=most)  # type: ignore[arg-type]
    once, twice = (linear_ik.fit(element, linear_ik.read_scan(*paths), settings) for paths in ([path], [path, path]))
    # Whether a point was moved with others above it or below may show in its last bit.
    far = max(1.0, np.abs(scan.points).max())
    np.testing.assert_allclose(twice.nodes_m, once.nodes_m, rtol=0, atol=1e-12 * far)
    np.testing.assert_allclose(twice.nodes_covariance_m2, once.nodes_covariance_m2, rtol=1e-6, atol=1e-20)
    assert (twice.status, twice.reasons) == (once.status, once.reasons)
    assert [s.points for s in twice.segments] == [s.points for s in once.segments]


def test_some_points_many_times_change_nothing() -> None:
    element = Element("e", SAMPLES["i_shape"], 2.5)
    scan = simulate(element, bends=["4:y:10"], points=5000)
    rng = np.random.default_rng(0)
    more = np.concatenate([scan.points, scan.points[rng.integers(0, 400, 20_000)]])
    once, often = (linear_ik.fit(element, Scan(points)) for points in (scan.points, more))
    np.testing.assert_allclose(often.nodes_m, once.nodes_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(often.nodes_covariance_m2, once.nodes_covariance_m2, rtol=1e-6, atol=1e-20)


def test_which_points_repeat_an_earlier_one() -> None:
    points = np.array([[1, 2, 3], [0.0, 2, 3], [1, 2, 3], [3, 2, 1], [-0.0, 2, 3], [1, 2, 3], [1, 2, 3 + 1e-15]])
    again = repeated(point_keys(points), points)
    assert again is not None and again.tolist() == [False, False, True, False, True, True, False]
    assert repeated(point_keys(points[:2]), points[:2]) is None
    nothing = np.empty((0, 3))
    assert repeated(point_keys(nothing), nothing) is None


def test_keys_that_agree_by_accident_make_no_duplicates() -> None:
    points = np.arange(12.0).reshape(4, 3)
    points[2] = points[0]
    again = repeated(np.full(4, 7, dtype=np.uint64), points)
    assert again is not None and again.tolist() == [False, False, True, False]


def test_keys_of_a_millimetre_grid_are_all_different() -> None:
    axis = np.arange(60) / 1000.0 + 500_000.0
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    assert len(np.unique(point_keys(points))) == len(points)


@pytest.mark.parametrize("copies", [1, 2])
def test_memory_stays_within_three_times_the_points(copies: int) -> None:
    points = np.tile(np.random.default_rng(0).uniform(-1, 1, (2_000_000 // copies, 3)), (copies, 1))
    tracemalloc.start()
    kept, _ = in_reach(points, np.eye(4), 2.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(kept) == 2_000_000 // copies and peak < 3 * points.nbytes
