"""A site's scan handed to its elements: who gets what, and that it hangs on nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from site_samples import GUIDS, design, member

import linear_ik
from linear_ik.element import Element, Placement
from linear_ik.profile import Circle, Rectangle
from linear_ik.scan import Scan
from linear_ik.scene import box_mesh, element_mesh
from linear_ik.site.body import Body
from linear_ik.site.box_tree import BoxTree
from linear_ik.site.contest import Claimant, contest
from linear_ik.site.handout import hand_out, moved
from linear_ik.site.neighbourhood import STRETCHES, Neighbourhoods, boxes_of
from linear_ik.site.obstacles import ObstacleField, masked
from linear_ik.site.spill import Spill

CURVED = Element(
    "bend",
    Circle(0.05),
    1.0,
    8,
    Placement((1, 2, 3), (0, 1, 1)),
    start="free",
    axis_points=[[0, 0, 0], [0, 0, 0.5], [0.3, 0, 0.9]],
)


@pytest.fixture
def elements():
    return [m.element for m in design().members] + [CURVED]


def in_boxes(element, reach, points):
    boxes = boxes_of(element, reach)
    inside = np.zeros(len(points), dtype=bool)
    for R, origin, low, high in zip(boxes.R, boxes.origin_m, boxes.low_m, boxes.high_m, strict=True):
        local = (points - origin) @ R
        inside |= ((local >= low) & (local <= high)).all(axis=1)
    return inside


def test_the_grid_finds_the_same_points_as_looking_at_every_element(elements):
    points = np.random.default_rng(1).uniform((-1, -1, -1), (4, 4, 5), (20_000, 3))
    reach = [0.2, 0.15, 0.2, 0.1, 0.2, 0.25]
    pairs = Neighbourhoods.of(elements, reach).pairs(points)
    assert len(set(zip(pairs.row.tolist(), pairs.member.tolist(), strict=True))) == len(pairs.row)
    assert (np.diff(pairs.member) >= 0).all()
    for i, element in enumerate(elements):
        found = np.sort(pairs.row[pairs.member == i])
        assert np.array_equal(found, np.flatnonzero(in_boxes(element, reach[i], points))), element.name
    assert len(pairs.row) > 300


def test_a_neighbourhood_holds_all_that_is_within_reach_of_the_surface():
    for element in (design().members[0].element, CURVED):
        scan = linear_ik.simulate(element, points=2000, noise_m=0.0)
        away = scan.points + 0.1 * scan.surface_normals
        assert in_boxes(element, 0.101, away).all()


def test_points_nowhere_near_are_nobodys(elements):
    pairs = Neighbourhoods.of(elements, [0.2] * len(elements)).pairs(np.array([[500.0, 0, 0], [-9, 0, 0], [2, 2, 40]]))
    assert len(pairs.row) == 0


def test_stretches_count_along_the_element():
    element = design().members[0].element
    points = np.column_stack([np.zeros((50, 2)), np.linspace(0.001, 1.999, 50)])
    stretch = Neighbourhoods.of([element], [0.1]).pairs(points).stretch
    assert np.array_equal(stretch, (points[:, 2] / 2.0 * STRETCHES).astype(int))


def test_neighbours_are_those_that_come_near():
    members = design().members
    near = Neighbourhoods.of([m.element for m in members], [0.05] * len(members)).neighbours()
    assert near == {0: [1], 1: [0], 2: [3], 3: [2], 4: []}


def spilled(tmp_path, points, max_points, memory, chunk, order=None):
    element = design().members[0].element
    hoods = Neighbourhoods.of([element], [0.2])
    folder = tmp_path / f"{max_points}-{memory}-{chunk}-{order}"
    folder.mkdir()
    spill = Spill(folder, 1, max_points, memory)
    rows = np.arange(len(points)) if order is None else np.random.default_rng(order).permutation(len(points))
    pieces = (Scan(points[rows[at : at + chunk]]) for at in range(0, len(points), chunk))
    extent = hand_out(pieces, hoods, spill)
    assert extent.points == len(points)
    return spill, spill.load(0)


def test_what_is_kept_hangs_on_the_points_alone(tmp_path):
    scan = linear_ik.simulate(design().members[0].element, points=30_000)
    reference = spilled(tmp_path, scan.points, 2000, 1 << 30, 10_000)[1]
    for memory, chunk, order in ((20_000, 777, None), (1 << 30, 30_000, 5), (50_000, 5000, 6)):
        assert np.array_equal(spilled(tmp_path, scan.points, 2000, memory, chunk, order)[1], reference)


def test_every_stretch_has_an_equal_say(tmp_path):
    scan = linear_ik.simulate(design().members[0].element, points=40_000, noise_m=0.0)
    # As near a scanner: two thirds of the points in the lowest quarter.
    low = scan.points[:, 2] < 0.5
    points = scan.points[low | (np.arange(len(low)) % 6 == 0)]
    spill, records = spilled(tmp_path, points, 3200, 1 << 30, 10_000)
    assert spill.received[0] == len(points)
    assert np.array_equal(np.bincount(records["stretch"], minlength=STRETCHES), np.full(STRETCHES, 100))


def test_a_point_that_comes_twice_is_kept_once(tmp_path):
    points = linear_ik.simulate(design().members[0].element, points=500).points
    assert len(spilled(tmp_path, np.concatenate([points, points]), 100_000, 1 << 30, 300)[1]) == 500


def test_files_stay_small_whatever_comes(tmp_path):
    points = linear_ik.simulate(design().members[0].element, points=60_000).points
    spill, _ = spilled(tmp_path, points, 1000, 30_000, 3000)
    assert spill.path(0).stat().st_size < 8 * 1000 * 29


def test_stations_go_with_their_points_into_the_models_coordinates(tmp_path):
    T = np.array([[0.0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    element = design().members[0].element
    points = linear_ik.simulate(element, points=400).points
    in_scan = (points - T[:3, 3]) @ T[:3, :3]
    stations = np.array([[3.0, 0, 1], [0, 3.0, 1]])
    pieces = [
        Scan(in_scan[k::2], None, stations[k : k + 1], np.zeros(len(in_scan[k::2]), dtype=np.int32)) for k in (0, 1)
    ]
    (tmp_path / "s").mkdir()
    spill = Spill(tmp_path / "s", 1, 10_000, 1 << 20)
    extent = hand_out(moved(pieces, T), Neighbourhoods.of([element], [0.2]), spill)
    assert np.allclose(extent.stations, stations @ T[:3, :3].T + T[:3, 3])
    records = spill.load(0)
    for k in (0, 1):
        mine = records["xyz"][records["station"] == k]
        assert len(mine) == 200
        assert np.allclose(np.sort(mine[:, 2]), np.sort(points[k::2, 2]))


def test_a_body_measures_from_its_faces():
    element = design().members[1].element
    scan = linear_ik.simulate(element, bends=["2:y:3"], points=3000, noise_m=0.0)
    result = linear_ik.fit(element, linear_ik.simulate(element, bends=["2:y:3"], points=3000))
    outside = scan.points + 0.02 * scan.surface_normals
    signed, nearest, segment = Body.fitted(result).distances(outside)
    inner = (scan.segment > 1) & (scan.segment < 4)
    assert np.abs(signed - 0.02)[inner].max() < 0.002
    assert np.abs(nearest - 0.02)[inner].max() < 0.002
    assert (segment[inner] + 1 == scan.segment[inner]).mean() > 0.95
    assert len(Body.fitted(result).may_touch(outside, 0.03)) == len(outside)
    assert len(Body.fitted(result).may_touch(outside + [5, 0, 0], 0.03)) == 0


def test_deviations_are_from_the_same_face_however_thin_the_plate():
    column = design().members[0].element  # its web is 9 mm thick
    shift = np.eye(4)
    shift[:3, 3] = (0.025, 0.0, 0.3)
    scan = linear_ik.simulate(column, points=3000, noise_m=0.0, displacement=shift)
    bodies = Body(column, scan.base_pose, Body.designed(column).T_base_segment), Body.designed(column)
    deviation = bodies[0].deviations(scan.points, bodies[1])
    assert np.abs(deviation - scan.surface_normals @ [0.025, 0, 0]).max() < 1e-9
    assert np.abs(bodies[1].distances(scan.points)[0] - deviation).max() > 0.02


def test_points_on_a_plate_are_masked_those_of_the_element_are_not():
    beam = design().members[1].element
    on_beam = linear_ik.simulate(beam, points=2000).points
    plate = box_mesh((0.11, 0, 1.8), (0.02, 0.16, 0.26))
    far_plate = box_mesh((5, 5, 5), (1, 1, 1))
    rng = np.random.default_rng(0)
    on_plate = np.column_stack([np.full(500, 0.1), rng.uniform(-0.08, 0.08, 500), rng.uniform(1.67, 1.93, 500)])
    field = ObstacleField([(plate.vertices, plate.triangles), (far_plate.vertices, far_plate.triangles)])
    near = field.near(boxes_of(beam, 0.2))
    assert len(near.triangles) == len(plate.triangles)
    mask = masked(np.concatenate([on_beam, on_plate]), beam, near)
    assert not mask[:2000].any()
    outside = (np.abs(on_plate[:, 1]) > 0.075) | (np.abs(on_plate[:, 2] - 1.8) > 0.125)
    assert outside.sum() > 50
    assert mask[2000:][outside].all()


def test_without_obstacles_nothing_is_masked():
    beam = design().members[1].element
    assert not masked(np.zeros((5, 3)), beam, ObstacleField([]).near(boxes_of(beam, 0.2))).any()


@pytest.fixture(scope="module")
def two_pipes():
    """Two pipes 30 mm apart; the second was fitted to the points of the first as well as could be."""
    first, second = (m for m in design().members if m.guid in GUIDS[2:])
    scans = [linear_ik.simulate(m.element, points=1500, seed=i) for i, m in enumerate((first, second))]
    results = [linear_ik.fit(m.element, s.without_truth()) for m, s in zip((first, second), scans, strict=True)]
    return scans, results


def test_a_point_goes_to_the_neighbour_that_explains_it(two_pipes):
    scans, results = two_pipes
    own, rival = map(Claimant.of, results)
    verdict = contest(np.concatenate([s.points for s in scans]), own, [rival])
    assert not verdict.taken[:1500].any()
    assert verdict.taken[1500:].all()
    assert (verdict.lost, verdict.claimed) == (0, 1500)
    assert not verdict.calls_for_fit(results[0])


def test_an_element_that_moved_onto_its_neighbours_points_loses_them(two_pipes):
    scans, results = two_pipes
    at = member("0astray", "IfcPipeSegment", Circle(0.05), 1.5, (0.5, 1.13, 1.0), (1, 0, 0)).element
    shift = np.eye(4)
    shift[:3, 3] = at.placement.T_world_element[:3, :3].T @ np.array([0, -0.13, 0])
    astray = linear_ik.fit(
        replace(at, placement_tolerance=linear_ik.PlacementTolerance(0.2, 2.0)), scans[0].without_truth()
    )
    assert np.abs(astray.nodes_m[:, 1] - 1.0).max() < 0.01  # it sits on the other pipe
    verdict = contest(scans[0].points, Claimant.of(astray), [Claimant.of(results[0])])
    assert verdict.lost > 1400
    assert verdict.calls_for_fit(astray)


def test_what_is_not_in_the_scan_claims_nothing(two_pipes):
    scans, results = two_pipes
    absent = linear_ik.fit(results[0].element, Scan(np.full((1, 3), 500.0)))
    assert not Claimant.of(absent).claims.any()
    assert not contest(scans[0].points, Claimant.of(results[0]), [Claimant.of(absent)]).taken.any()


def test_an_obstacle_mesh_may_be_another_member():
    column = design().members[0].element
    mesh = element_mesh(column)
    assert len(
        ObstacleField([(mesh.vertices, mesh.triangles)]).near(boxes_of(design().members[1].element, 0.2)).triangles
    )
    box = Element("far", Rectangle(0.1, 0.1), 1.0, placement=Placement((50, 0, 0)))
    assert not len(ObstacleField([(mesh.vertices, mesh.triangles)]).near(boxes_of(box, 0.2)).triangles)


@pytest.mark.parametrize("count", [0, 1, 16, 17, 3000])
def test_a_tree_of_boxes_finds_those_that_meet_another(count):
    rng = np.random.default_rng(count)
    low = rng.uniform(0, 100, (count, 3))
    high = low + rng.exponential(2.0, (count, 3))
    tree = BoxTree(low, high)
    for _ in range(20):
        a = rng.uniform(-5, 100, 3)
        b = a + rng.uniform(0, 30, 3)
        assert np.array_equal(tree.meeting(a, b), np.flatnonzero(((low <= b) & (high >= a)).all(axis=1)))
