"""Noise by side: what lies along the ray scatters less across a face seen at a slant."""

from __future__ import annotations

import numpy as np
import pytest

import linear_ik
from linear_ik.correspondence import Correspondences
from linear_ik.element import Element
from linear_ik.profile import Circle, Rectangle
from linear_ik.side_noise import LEAST_POINTS, MOST, sides, trust_of
from linear_ik.virtual_scanner import scan_virtually


def pairs_of(noise_m: list[float], points: int = 2000) -> Correspondences:
    """Matches facing +x, +y, -x and -y, each side with a noise of its own."""
    rng = np.random.default_rng(1)
    normals = np.repeat(np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), points, axis=0)
    residual = np.repeat(noise_m, points) * rng.standard_normal(4 * points)
    local = np.zeros((4 * points, 3))
    rows = np.arange(4 * points)
    return Correspondences(rows, np.array([0, len(rows)]), rows, local, residual, normals, np.abs(residual))


def test_sides_are_45_degrees_wide_about_the_axes() -> None:
    angles = np.radians([0, 20, 30, 90, 180, -180, -90, 337, 338])
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    assert sides(directions).tolist() == [0, 0, 1, 2, 4, 4, 6, 7, 0]


def test_a_side_of_less_noise_is_trusted_more_within_bounds() -> None:
    pairs = pairs_of([0.001, 0.001, 0.0005, 0.003])
    trust = trust_of(pairs, np.ones(8000), 0.001)
    assert trust is not None
    assert trust[0, [0, 2, 4]] == pytest.approx([1.0, 1.0, 4.0], rel=0.15)
    assert trust[0, 6] == 1 / MOST and (trust[0, 1::2] == 1.0).all()


def test_alike_sides_and_few_points_change_nothing() -> None:
    assert trust_of(pairs_of([0.001] * 4), np.ones(8000), 0.001) is None
    few = pairs_of([0.0001, 0.001, 0.001, 0.001], LEAST_POINTS - 1)
    assert trust_of(few, np.ones(len(few.order)), 0.001) is None
    unweighted = np.ones(8000)
    unweighted[4000:] = 0.0
    assert trust_of(pairs_of([0.001, 0.001, 0.0002, 0.01]), unweighted, 0.001) is None


def test_a_side_that_something_touches_in_one_segment_hardly_counts_there() -> None:
    rng, n, each = np.random.default_rng(2), 6, 200
    residual = 0.001 * rng.standard_normal((n, 4, each))
    residual[2, 1, :80] = rng.uniform(0.002, 0.008, 80)  # a bracket flush with the +y side
    residual[4, 2, :4] = 0.008  # some mixed pixels
    segment, quarter = (np.repeat(np.arange(k), each * m) for k, m in ((n, 4), (4, 1)))
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])[np.tile(quarter, n)]
    rows, starts = np.arange(residual.size), np.searchsorted(segment, np.arange(n + 1))
    flat = residual.ravel()
    pairs = Correspondences(rows, starts, rows, np.zeros((flat.size, 3)), flat, normals, np.abs(flat))
    trust = trust_of(pairs, np.ones(flat.size), 0.001)
    assert trust is not None
    assert np.argwhere(trust < 0.1).tolist() == [[2, 2]]
    assert trust[2, 0] == trust[1, 2] == 1.0


@pytest.mark.parametrize("profile", [Rectangle(0.1, 0.3), Circle(0.1)], ids=lambda p: p.type)
def test_nodes_of_virtual_scans_lie_within_what_is_said_of_them(profile) -> None:
    element = Element("member", profile, 3.0)
    inside = []
    for seed in range(1, 7):
        stations = [[4.0, 0.5 * seed - 2.0, 1.5], [-3.5, 1.0, 1.8]]
        scan = scan_virtually(element, stations=stations, bends=["7:x:9"], seed=seed, range_noise_m=0.0015)
        result = linear_ik.fit(element, scan.without_truth())
        assert result.status == "converged", result.reasons
        error = (result.nodes_m - scan.nodes_m)[1:, :2]
        spread = result.nodes_covariance_m2[1:, :2, :2]
        inside += (np.einsum("ki,kij,kj->k", error, np.linalg.inv(spread), error) < 5.99).tolist()
    assert np.mean(inside) > 0.8
