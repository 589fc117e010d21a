"""Free space: a fitted segment in the way of a ray to a point behind it is not where the fit says."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from captured import element_of, needs_captured_scans, scan_of
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import SAMPLES
from truth import node_errors_m

import linear_ik
from linear_ik import (
    Circle,
    Element,
    FitSettings,
    Placement,
    Rectangle,
    RectangleHollow,
    Scan,
    SimulatedScan,
    scan_virtually,
)
from linear_ik.chain import Pose
from linear_ik.problem import Problem
from linear_ik.scene import neighbour, wall
from linear_ik.seen_through import (
    BEAM_M,
    MARGIN,
    MOST_RAYS,
    Crossings,
    Rays,
    crossings,
    in_company,
    rays_near,
    refuter,
    seen_through,
)
from linear_ik.startup import Hypothesis, Startup

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
from benchlib.random_scenes import scene  # noqa: E402

NOISE_M = 0.0015
STATIONS = np.array([[4.0, 1.0, 1.6], [3.0, -2.5, 1.7]])
WALL = wall((-0.6, 0.0, 1.0), (1.0, 0.0, 0.0))
OPEN = ("i_shape", "i_shape_fillet", "l_shape", "u_shape", "t_shape")


def scanned(element: Element, stations: np.ndarray = STATIONS, **given: object) -> SimulatedScan:
    """A scan of the element in front of a wall."""
    given = {"bends": ["4:y:9"], "others": [WALL], "margin_m": 0.8, "points": 3000, **given}
    return scan_virtually(element, stations=stations, range_noise_m=NOISE_M, seed=1, **given)


def posed(element: Element, scan: SimulatedScan, shift_m: object = (0.0, 0.0, 0.0)) -> tuple[Problem, Pose]:
    """The chain at the truth, moved by ``shift_m`` in the element's frame."""
    problem = Problem.of(element, scan)
    x = problem.chain.with_q(scan.q)
    x[:3] = shift_m
    return problem, problem.chain.pose(x)


def counted(element: Element, scan: SimulatedScan, shift_m: object = (0.0, 0.0, 0.0)) -> Crossings:
    problem, pose = posed(element, scan, shift_m)
    return crossings(problem, pose, rays_near(scan, problem, pose.nodes_m, 0), NOISE_M)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("name", SAMPLES)
def test_a_member_beside_its_place_is_contradicted_and_the_right_one_is_not(name: str, count: int) -> None:
    element = Element(name, SAMPLES[name], 2.5, 6)
    scan = scanned(element, STATIONS[:count])
    right = counted(element, scan)
    assert not right.contradicted.any()
    # Mixed pixels behind edges are all that passes: 1 % of all returns, here of an element's and a wall's.
    assert right.through.sum() < 0.1 * right.met.sum()
    assert counted(element, scan, (0.0, 0.08, 0.0)).contradicted.sum() >= 5


@pytest.mark.parametrize("name", OPEN)
def test_a_plate_30_mm_before_its_place_is_contradicted(name: str) -> None:
    element = Element(name, SAMPLES[name], 2.5, 6)
    assert counted(element, scanned(element, STATIONS[:1]), (0.03, 0.0, 0.0)).contradicted.any()


def test_a_rail_30_mm_beside_its_place_before_a_wall_is_contradicted() -> None:
    rail = Element("rail", RectangleHollow(0.06, 0.06, 0.004), 2.5, 6)
    scan = scanned(rail)
    assert counted(rail, scan, (0.0, 0.03, 0.0)).contradicted.all()
    assert not counted(rail, scan).contradicted.any()


def test_a_member_that_took_its_neighbour_s_surface_for_its_own_is_contradicted() -> None:
    element = Element("post", Rectangle(0.1, 0.1), 2.5, 6)
    # Its neighbour's face continues its own, 60 mm to the side: a lattice of two posts and a gap.
    beside = neighbour(element, (0.0, 0.16, 0.0))
    scan = scanned(element, bends=(), others=[WALL, beside])
    assert counted(element, scan, (0.0, 0.08, 0.0)).contradicted.all()
    assert not counted(element, scan).contradicted.any()
    assert not counted(element, scan, (0.0, 0.16, 0.0)).contradicted.any()  # where the neighbour is, nothing is empty


def test_a_member_behind_others_is_not_judged() -> None:
    element = Element("post", Rectangle(0.1, 0.1), 2.5, 6)
    scan = scanned(element, STATIONS[:1], bends=())
    found = counted(element, scan, (-1.5, 0.0, 0.0))  # behind the wall
    assert not found.met.any() and not found.through.any()


@settings(max_examples=25, deadline=None)
@given(
    name=st.sampled_from(sorted(SAMPLES)),
    azimuth=st.floats(0.0, 6.28),
    away_m=st.floats(1.0, 30.0),
    bend_deg=st.floats(-40.0, 40.0),
    seed=st.integers(0, 10_000),
)
def test_a_ray_that_ends_on_the_surface_never_counts(
    name: str, azimuth: float, away_m: float, bend_deg: float, seed: int
) -> None:
    element = Element(name, SAMPLES[name], 2.0, 4)
    station = [[0.6 + away_m * np.cos(azimuth), away_m * np.sin(azimuth), 1.6]]
    bends = [f"3:x:{bend_deg}"]
    scan = scan_virtually(
        element, stations=station, bends=bends, points=800, range_noise_m=NOISE_M, mixed_pixels=0.0, seed=seed
    )
    found = counted(element, scan)
    assert not found.through.any()
    # Rays that graze a bent polygon may end beside the mesh that is met.
    assert found.met.sum() > 0.8 * len(scan)


def test_grazing_rays_do_not_count() -> None:
    element = Element("post", Rectangle(0.1, 0.1), 2.0, 4)
    problem, pose = posed(element, scan_virtually(element, stations=STATIONS, points=50))
    # From far away, so that rays are parallel; they end on a wall 1 m behind.
    y, z = np.linspace(-0.06, 0.06, 241), np.linspace(0.1, 1.9, 60)
    y, z = (grid.ravel() for grid in np.meshgrid(y, z))
    points = np.column_stack([np.full(y.size, -1.0), y, z])
    stations = points + [1e3, 0.0, 0.0]
    margin_m = MARGIN * NOISE_M + BEAM_M
    for k in (-1.0, 0.0):
        stations[:, 0] = 9.0 + k
        found = crossings(problem, pose, Rays(stations, points), NOISE_M)
        inside = np.abs(y) < 0.05
        assert found.met.sum() == inside.sum()
        clear = np.abs(y) < 0.05 - margin_m
        assert 0.9 * clear.sum() < found.through.sum() <= clear.sum()
    edge = (np.abs(y) > 0.05 - margin_m) & inside
    assert not crossings(problem, pose, Rays(stations[edge], points[edge]), NOISE_M).through.any()


def test_a_point_just_behind_the_body_does_not_count() -> None:
    element = Element("post", Rectangle(0.1, 0.1), 2.0, 4)
    problem, pose = posed(element, scan_virtually(element, stations=STATIONS, points=50))
    z = np.linspace(0.1, 1.9, 60)
    margin_m = MARGIN * NOISE_M + BEAM_M
    for behind_m, share in ((0.5 * margin_m, 0.0), (2.0 * margin_m, 1.0)):
        points = np.column_stack([np.full(60, -0.05 - behind_m), np.zeros(60), z])
        found = crossings(problem, pose, Rays(points + [5.0, 0.0, 0.0], points), NOISE_M)
        assert found.met.sum() == 60
        assert found.through.sum() == share * 60


def test_the_open_end_of_a_pipe_may_be_looked_into() -> None:
    pipe = Element("duct", RectangleHollow(0.4, 0.4, 0.005), 1.0, 4)
    scan = scan_virtually(pipe, stations=[[0.3, 0.2, 3.0]], points=3000, range_noise_m=NOISE_M, mixed_pixels=0.0)
    assert (scan.surface_normals[scan.on_element][:, 2] < 0.5).any()
    assert not counted(pipe, scan).through.any()


def test_rays_are_few_chosen_by_the_seed_and_lead_to_the_element(monkeypatch: pytest.MonkeyPatch) -> None:
    element = Element("post", Rectangle(0.1, 0.1), 2.5, 6, Placement((691_603.25, 5_334_760.5, 519.75)))
    here = Element("post", Rectangle(0.1, 0.1), 2.5, 6)
    scan = scanned(here, points=3000)
    scan = Scan(
        scan.points + element.placement.location, None, STATIONS + element.placement.location, scan.station_index
    )
    problem = Problem.of(element, scan)
    pose = problem.chain.pose(problem.designed)
    nodes_m = pose.nodes_m
    rays = rays_near(scan, problem, nodes_m, 0)
    stations, points = rays.stations, rays.points
    assert len(points) == MOST_RAYS < len(scan)
    # Element's frame, and each point with its own station.
    assert np.abs(np.concatenate([stations, points])).max() < 10.0
    for station in STATIONS:
        assert (np.abs(stations - station) < 1e-6).all(axis=1).sum() > 0.2 * len(stations)
    np.testing.assert_array_equal(rays_near(scan, problem, nodes_m, 0).points, points)
    assert not np.array_equal(rays_near(scan, problem, nodes_m, 1).points, points)
    # In many passes too; and what lies before the element tells nothing.
    monkeypatch.setattr("linear_ik.seen_through.POINTS_A_PASS", 1000)
    monkeypatch.setattr("linear_ik.seen_through.MOST_RAYS", 200)
    assert len(rays_near(scan, problem, nodes_m, 0).points) == 200
    near = Scan(scan.stations[0] + [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]], None, scan.stations, np.zeros(2, dtype=int))
    assert len(rays_near(near, problem, nodes_m, 0).points) == 0


@needs_captured_scans
def test_a_captured_pipe_is_contradicted_beside_its_place_only() -> None:
    element, scan = element_of("pipe_west"), scan_of("pipe_west")
    problem = Problem.of(element, scan)
    pose = problem.chain.pose(problem.designed)
    assert not crossings(problem, pose, rays_near(scan, problem, pose.nodes_m, 0), NOISE_M).through.any()
    x = problem.designed
    x[0] = 0.06
    assert seen_through(problem, scan, problem.chain.pose(x), NOISE_M, 0).any()


# in a fit --------------------------------------------------------------------------------

POST = Element("post", Circle(0.06), 2.5, 6)


def test_what_was_gone_when_the_second_station_looked_is_doubted() -> None:
    first = scanned(POST, STATIONS[:1], points=4000)
    y, z = (g.ravel() for g in np.meshgrid(np.linspace(-1.0, 1.0, 120), np.linspace(-0.5, 2.5, 180)))
    behind = np.column_stack([np.full(y.size, -0.6), y, z])
    both = Scan(
        np.concatenate([first.points, behind]),
        None,
        STATIONS,
        np.concatenate([first.station_index, np.ones(len(behind), dtype=np.int32)]),
    )
    result = linear_ik.fit(POST, both)
    assert result.status == "uncertain"
    assert "segments 1 to 6: the scanner saw through where they would be" in result.reasons
    alone = linear_ik.fit(POST, first.without_truth())
    assert alone.status == "converged" and not alone.reasons


def test_what_ends_before_its_designed_end_is_doubted_there() -> None:
    shorter = Element("short", Rectangle(0.1, 0.1), 1.5, 3)
    designed = Element("long", Rectangle(0.1, 0.1), 2.5, 5)
    scan = scanned(shorter, bends=(), margin_m=1.5)
    result = linear_ik.fit(designed, scan.without_truth())
    assert "segments 4 to 5: the scanner saw through where they would be" in result.reasons


def test_without_stations_nothing_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("computed")

    monkeypatch.setattr("linear_ik.seen_through.rays_near", refused)
    scan = scanned(POST)
    problem, pose = posed(POST, scan, (0.0, 0.08, 0.0))
    assert not seen_through(problem, Scan(scan.points), pose, NOISE_M, 0).any()
    with pytest.raises(AssertionError, match="computed"):
        seen_through(problem, scan, pose, NOISE_M, 0)
    assert refuter(problem, Scan(scan.points), NOISE_M, 0) is None
    assert linear_ik.fit(POST, Scan(scan.points)).status == "converged"


# in the choice between hypotheses --------------------------------------------------------


def startup(refuted: object) -> Startup:
    scan = scanned(POST, bends=())
    problem = Problem.of(POST, scan)
    return Startup(problem, problem.points[::10], NOISE_M, FitSettings(), None, None, refuted)


def test_what_is_seen_through_gives_way_to_what_is_not() -> None:
    right = np.zeros(6 + 3 * 6)
    bent = right.copy()
    bent[8] = 0.1
    first = {"right": right, "bent": bent}
    for seen in (), ("right",), ("right", "bent"):
        search = startup(lambda x, grown, seen=seen: any((x == first[name]).all() for name in seen))
        assert search.score(right) > search.score(bent)
        expected = bent if seen == ("right",) else right
        assert search.better([bent, right]) is expected
        ranked = [Hypothesis(right, 9.0, None, (5,)), Hypothesis(bent, 8.0, None, (5,))]
        assert search.best(ranked, 1)[0].x is expected


def test_a_chain_grown_so_far_is_judged_by_what_has_grown() -> None:
    scan = scanned(POST, bends=())
    problem = Problem.of(POST, scan)
    refuted = refuter(problem, scan, NOISE_M, 0)
    x = problem.designed
    x[6 + 3 * 3 + 1] = 0.3  # the fourth joint
    assert [refuted(x, grown) for grown in (1, 3, 4, 6)] == [False, False, True, True]
    assert not refuted(problem.designed, 6)


def test_the_neighbour_that_explains_more_points_is_not_taken_for_the_member() -> None:
    # Half of the column's faces are hidden, and its neighbour is seen as well as it: the search
    # went over to that across empty space, 100 mm off.
    there = scene(275).stage()
    result = linear_ik.fit(there.element, there.scan.without_truth())
    assert result.status == "converged"
    assert node_errors_m(result, there.scan).max() < 0.001


def test_rays_of_another_station_are_no_company() -> None:
    """Four lone rays of one station that end anywhere, and fifty of another that end on a wall."""
    alone = np.column_stack([[5.0, 50.0, 500.0, 20.0], [0.01, 0.02, 0.03, 0.04], np.zeros(4)])
    wall = np.column_stack([np.full(50, 10.0), np.linspace(-0.1, 0.1, 50), np.zeros(50)]) + [0.0, 30.0, 0.0]
    stations = np.repeat([[0.0, 0.0, 0.0], [0.0, 30.0, 0.0]], [4, 50], axis=0)
    found = in_company(Rays(stations, np.concatenate([alone, wall])), np.arange(54))
    assert not found[:4].any() and found[4:].all()
