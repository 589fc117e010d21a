"""Where stations are known: no point is given to a face that looks away from its station."""

from __future__ import annotations

import numpy as np
import pytest
from truth import node_errors_m

import linear_ik
from linear_ik import Circle, Element, Placement, Rectangle, Scan, TShape, scan_virtually
from linear_ik.correspondence import TURNED_AWAY, Matcher
from linear_ik.problem import Problem
from linear_ik.sights import Sights

STATIONS = np.array([[4.0, 1.0, 1.6], [-3.0, 2.5, 1.7]])
THIN = Element("thin", TShape(0.1, 0.1, 0.011, 0.011), 2.0, 6)


@pytest.mark.parametrize("count", [1, 2])
def test_stations_are_found_again_from_any_subset(count: int) -> None:
    rng = np.random.default_rng(0)
    # Millimetres, as many files have: coordinates repeat, points do not.
    points = rng.uniform(-2, 2, (5000, 3)).round(3)
    index = rng.integers(0, count, len(points)).astype(np.int32)
    sights = Sights.of(points, STATIONS[:count], index)
    some = rng.permutation(len(points))[:700]
    np.testing.assert_array_equal(sights.stations_of(points[some]), STATIONS[index[some]])
    assert sights.stations_of(points[:0]).shape == (0, 3)


def test_points_in_single_precision_are_found_again() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-2, 2, (1000, 3)).astype(np.float32)
    index = rng.integers(0, 2, len(points)).astype(np.int32)
    sights = Sights.of(points, STATIONS, index)
    np.testing.assert_array_equal(sights.stations_of(points.astype(np.float64)), STATIONS[index])


def test_no_point_is_given_to_a_face_that_looks_away() -> None:
    scan = scan_virtually(THIN, stations=STATIONS, range_noise_m=0.004, points=4000, seed=3)
    problem = Problem.of(THIN, scan)
    pose = problem.chain.pose(problem.designed)
    pairs = problem.matcher.match(pose, problem.points)
    normals = problem.surface.normals[pairs.face]
    sight = problem.matcher.sights.stations_of(problem.points[pairs.order]) - problem.points[pairs.order]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    assert (np.einsum("pi,pi->p", normals, sight[:, :2]) >= TURNED_AWAY - 1e-9).all()
    blind = Matcher(problem.surface, problem.chain.segment_length_m).match(pose, problem.points)
    moved = pairs.face != blind.face
    # Of a plate three deviations thick many points are nearer to the side that nobody sees.
    assert 0.02 < moved.mean() < 0.5
    np.testing.assert_array_equal(pairs.residual_m[~moved], blind.residual_m[~moved])
    assert (pairs.distance_m[moved] >= blind.distance_m[moved] - 1e-12).all()


def test_a_round_section_has_nothing_to_choose_from() -> None:
    element = Element("pipe", Circle(0.1), 2.0, 4)
    scan = scan_virtually(element, stations=STATIONS, points=500)
    assert Problem.of(element, scan).matcher.sights is None


@pytest.mark.parametrize("seed", [1, 2])
def test_a_plate_as_thin_as_its_noise_is_fitted_without_bias(seed: int) -> None:
    scan = scan_virtually(THIN, stations=STATIONS[:1], bends=["4:y:11"], range_noise_m=0.0045, points=6000, seed=seed)
    result = linear_ik.fit(THIN, scan.without_truth())
    assert node_errors_m(result, scan).max() < 0.0015


def test_it_is_the_same_at_map_coordinates() -> None:
    far = Placement((691_603.25, 5_334_760.5, 519.75))
    element = Element("thin", THIN.profile, 2.0, 6, far)
    scan = scan_virtually(
        element, stations=STATIONS + far.location, bends=["4:y:11"], range_noise_m=0.004, points=6000, seed=1
    )
    assert node_errors_m(linear_ik.fit(element, scan.without_truth()), scan).max() < 0.0015


def test_stations_that_cannot_have_seen_the_points_are_not_used() -> None:
    element = Element("beam", Rectangle(0.1, 0.3), 2.5)
    scan = scan_virtually(element, stations=STATIONS, bends=["5:y:9"], points=6000, seed=2)
    wrong = Scan(scan.points, None, scan.nodes_m[:1] - [3.0, 3.0, 0.0], np.zeros(len(scan.points), dtype=np.int32))
    result = linear_ik.fit(element, wrong)
    assert node_errors_m(result, scan).max() < 0.001
    assert result.status == "uncertain" and "stations were not used" in result.reasons[-1]
    assert [r.iteration for r in result.history] == list(range(1, result.iterations + 1))
