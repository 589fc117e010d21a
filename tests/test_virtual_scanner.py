"""The virtual scanner sees what can be seen from its stations, and says what it was."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh

from linear_ik import virtual_scanner
from linear_ik.bending import bend_element, rigid_motion
from linear_ik.element import Element, Placement
from linear_ik.errors import SettingsError
from linear_ik.profile import Circle, CircleHollow, IShape, LShape, Rectangle, RectangleHollow, UShape
from linear_ik.scene import box_mesh, element_mesh, floor, neighbour, segment_meshes, wall
from linear_ik.simulate import SimulatedScan
from linear_ik.virtual_scanner import scan_virtually

BEAM = Element("beam", Rectangle(0.1, 0.3), 2.5)
PIPE = Element("pipe", CircleHollow(0.1, 0.01), 2.5)
H = Element("h", IShape(0.3, 0.3, 0.011, 0.019, 0.027), 2.5)
UTM = Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2), ref_direction=(0, 0, 1))
AHEAD = [[3.0, 1.0, 1.2]]
AROUND = [[3.0, 1.0, 1.2], [-2.0, 3.0, 1.5], [-2.0, -2.0, 4.0]]
EXACT = {"range_noise_m": 0.0, "mixed_pixels": 0.0}


def in_segments(scan: SimulatedScan, element: Element, values: np.ndarray, vectors: bool = False) -> np.ndarray:
    """Points, or directions, in the frame of the segment they belong to."""
    bent = bend_element(element, joint_angles_rad=scan.joint_angles_rad)
    local = (values - (0 if vectors else scan.base_pose[:3, 3])) @ scan.base_pose[:3, :3]
    T = bent.T_base_segment[scan.segment - 1]
    return np.einsum("pij,pi->pj", T[:, :3, :3], local - (0 if vectors else T[:, :3, 3]))


def off_body(scan: SimulatedScan, element: Element) -> np.ndarray:
    """Distance of the element's points to their segment's faces (prolonged) and to the end caps."""
    local = in_segments(scan, element, scan.points)
    hole = element.profile.hole()
    section = shapely.Polygon(element.profile.outline(), [] if hole is None else [hole])
    distance = shapely.distance(section.boundary, shapely.points(local[:, :2]))
    for segment, end in ((1, 0.0), (element.segments, element.segment_length_m)):
        cap = (scan.segment == segment) & shapely.intersects_xy(section.buffer(1e-6), local[:, 0], local[:, 1])
        distance[cap] = np.minimum(distance[cap], np.abs(local[cap, 2] - end))
    return distance


@pytest.mark.parametrize(
    "profile",
    [
        Rectangle(0.1, 0.3),
        RectangleHollow(0.35, 0.35, 0.01),
        Circle(0.15),
        CircleHollow(0.1, 0.01),
        H.profile,
        LShape(0.15, 0.1, 0.012),
        UShape(0.2, 0.08, 0.008, 0.012),
    ],
    ids=lambda p: p.type,
)
def test_points_lie_on_the_bent_body(profile) -> None:
    element = Element("e", profile, 2.5)
    scan = scan_virtually(element, bends=["4:x:-20", "8:y:45"], stations=AROUND, points=5000, **EXACT)
    assert scan.on_element.all()
    # Outlines of circles and fillets are chords, up to 0.05 mm inside.
    assert off_body(scan, element).max() < 6e-5, "no ray slips through a joint into the inside"


def test_a_bend_opens_no_gap_and_the_body_is_closed() -> None:
    for element in (BEAM, PIPE, H):
        for mesh in segment_meshes(bend_element(element, ["3:x:30", "8:y:-45", "8:z:10"])):
            body = trimesh.Trimesh(*mesh)
            assert body.is_watertight and body.is_winding_consistent
            assert body.volume > 0
    straight = trimesh.Trimesh(*segment_meshes(bend_element(PIPE))[4])
    assert straight.volume == pytest.approx(np.pi * (0.1**2 - 0.09**2) * 0.25, rel=1e-3)


def test_round_sections_are_round() -> None:
    scan = scan_virtually(PIPE, stations=AHEAD, **EXACT)
    local = in_segments(scan, PIPE, scan.points)
    radius = np.linalg.norm(local[:, :2], axis=1)
    assert np.abs(radius - 0.1)[radius > 0.095].max() < 1e-5


@pytest.mark.parametrize("element", [BEAM, PIPE, H], ids=lambda e: e.name)
def test_no_point_on_a_face_turned_away(element) -> None:
    scan = scan_virtually(element, bends=["8:y:22.5"], stations=AROUND, points=6000, **EXACT)
    for s, station in enumerate(AROUND):
        seen = scan.station_index == s
        assert seen.sum() > 300
        towards = np.array(station) - scan.points[seen]
        assert (np.einsum("ij,ij->i", towards, scan.surface_normals[seen]) > 0).all()
    assert np.abs(np.linalg.norm(scan.surface_normals, axis=1) - 1).max() < 1e-6
    # Independent of the scanner's own normals: of the four sides of the beam, from one
    # station, only the two towards it have points.
    if element is BEAM:
        one = scan_virtually(BEAM, stations=AHEAD, **EXACT)
        local = in_segments(one, BEAM, one.points)
        counts = [
            (np.abs(local[:, axis] - side) < 1e-5).sum()
            for axis, side in ((0, 0.05), (1, 0.15), (0, -0.05), (1, -0.15))
        ]
        assert counts[0] > 5000 and counts[1] > 500 and counts[2] < 20 and counts[3] < 20


def test_the_line_of_sight_is_free() -> None:
    """No point has the element in front of it, by another ray caster."""
    scan = scan_virtually(H, bends=["8:y:40"], stations=AROUND, points=400, **EXACT)
    body = trimesh.Trimesh(*element_mesh(H, ["8:y:40"]), process=False)
    origins = np.array(AROUND)[scan.station_index]
    rays = scan.points - origins
    hits, ray, _ = body.ray.intersects_location(origins, rays, multiple_hits=True)
    share = np.linalg.norm(hits - origins[ray], axis=1) / np.linalg.norm(rays[ray], axis=1)
    assert share.min() > 1 - 1e-5


def test_noise_runs_along_the_ray() -> None:
    exact = scan_virtually(BEAM, stations=AHEAD, mixed_pixels=0.0, range_noise_m=0.0)
    noisy = scan_virtually(BEAM, stations=AHEAD, mixed_pixels=0.0, range_noise_m=0.002)
    error = noisy.points - exact.points
    ray = exact.points - AHEAD[0]
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    along = np.einsum("ij,ij->i", error, ray)
    assert np.linalg.norm(error - along[:, None] * ray, axis=1).max() < 1e-9
    assert along.std() == pytest.approx(0.002, rel=0.05)
    assert abs(along.mean()) < 4 * 0.002 / np.sqrt(len(along))


def test_mixed_pixels_lie_between_an_edge_and_what_is_behind() -> None:
    others = [wall((-1.5, 0, 1.2), (1, 0, 0))]
    scan = scan_virtually(BEAM, stations=AHEAD, others=others, mixed_pixels=0.01, range_noise_m=0.0)
    mixed = scan.points[scan.segment == -1]
    assert len(mixed) == pytest.approx(0.01 * len(scan), abs=1)
    body = trimesh.Trimesh(*element_mesh(BEAM), process=False)
    ray = mixed - AHEAD[0]
    hits, index, _ = body.ray.intersects_location(np.repeat(AHEAD, len(mixed), axis=0), ray, multiple_hits=True)
    first = np.full(len(mixed), np.inf)
    np.minimum.at(first, index, np.linalg.norm(hits - AHEAD[0], axis=1))
    there = np.isfinite(first)
    assert there.mean() > 0.95, "they belong to rays that meet the element"
    distance = np.linalg.norm(ray, axis=1)
    assert (distance[there] >= first[there] - 1e-5).all()
    assert (mixed[:, 0] > -1.5 - 0.01).all(), "none behind the wall, but for the step to the neighbouring ray"
    depth = (mixed[:, 0] - 0.05) / (-1.5 - 0.05)
    assert np.histogram(depth, bins=4, range=(0, 1))[0].min() > 0.15 * len(mixed), "anywhere between"


def test_mixed_pixels_without_a_background() -> None:
    # A convex body has no edge with itself behind; only slivers of a grazing face look like one.
    assert (scan_virtually(BEAM, stations=AHEAD, background_m=0.0).segment < 0).mean() < 1e-3
    scan = scan_virtually(BEAM, stations=AHEAD, background_m=0.5, range_noise_m=0.0)
    mixed = scan.segment == -1
    assert mixed.sum() == pytest.approx(0.01 * len(scan), abs=1)
    from_faces = np.abs(scan.points[mixed] @ np.diag([1, 1, 0]))
    assert 0.2 < from_faces.max() < 0.75
    assert not scan.on_element[mixed].any()


def test_other_objects_are_seen_labelled_and_in_the_way() -> None:
    crate = box_mesh((0.6, 0.1, 0.5), (0.2, 0.6, 0.4))
    others = [floor((0, 0, -0.02)), wall((-1, 0, 1), (1, 0, 0)), crate, neighbour(BEAM, (0, 0.4, 0))]
    scan = scan_virtually(BEAM, bends=["8:y:9"], stations=AHEAD, others=others, **EXACT)
    clutter = scan.points[scan.segment == 0]
    meshes = [trimesh.Trimesh(*m, process=False) for m in others]
    assert len(clutter) > 3000
    near = np.array([trimesh.proximity.closest_point(m, clutter[::40])[1] for m in meshes])
    assert near.min(axis=0).max() < 1e-5
    assert (np.bincount(near.argmin(axis=0), minlength=4) > 3).all(), "something of each is seen"
    assert off_body(_only_element(scan), BEAM).max() < 1e-5
    alone = scan_virtually(BEAM, bends=["8:y:9"], stations=AHEAD, angular_step_deg=0.2, **EXACT)
    hidden = scan_virtually(BEAM, bends=["8:y:9"], stations=AHEAD, angular_step_deg=0.2, others=[crate], **EXACT)
    assert 0.5 * len(alone) < hidden.on_element.sum() < 0.98 * len(alone)


def _only_element(scan: SimulatedScan) -> SimulatedScan:
    keep = scan.on_element
    truth = (scan.joint_angles_rad, scan.q, scan.nodes_m, scan.base_pose)
    names = ("joint_angles_rad", "q", "nodes_m", "base_pose")
    return SimulatedScan(
        scan.points[keep],
        segment=scan.segment[keep],
        surface_normals=scan.surface_normals[keep],
        **dict(zip(names, truth, strict=True)),
    )


def test_normals_look_at_the_station_whichever_way_a_wall_is_drawn() -> None:
    for front in ((1, 0, 0), (-1, 0, 0)):
        scan = scan_virtually(BEAM, stations=AHEAD, others=[wall((-1, 0, 1), front)], **EXACT)
        assert scan.surface_normals[scan.segment == 0] == pytest.approx(
            np.array([[1.0, 0, 0]] * (scan.segment == 0).sum())
        )


def test_a_scan_cast_in_parts_is_the_same(monkeypatch) -> None:
    kwargs = {"bends": ["8:y:22.5"], "stations": AROUND, "others": [floor((0, 0, -0.02))]}
    whole = scan_virtually(BEAM, **kwargs)
    monkeypatch.setattr(virtual_scanner, "RAYS_AT_ONCE", 3000)
    parts = scan_virtually(BEAM, **kwargs)
    assert parts.points.tobytes() == whole.points.tobytes()
    assert np.array_equal(parts.segment, whole.segment)


def test_the_neighbour_stands_beside_in_the_placements_frame() -> None:
    element = Element("e", BEAM.profile, 2.5, placement=Placement((5, 6, 7), (1, 0, 0), (0, 0, 1)))
    shift = neighbour(element, (0.15, 0, 0)).vertices - element_mesh(element).vertices
    assert np.abs(shift - [0, 0, 0.15]).max() < 1e-12


def test_others_may_come_from_trimesh() -> None:
    ball = trimesh.creation.icosphere(radius=0.2)
    ball.apply_translation((0.5, 0.3, 1.0))
    scan = scan_virtually(BEAM, stations=AHEAD, others=[ball], **EXACT)
    clutter = scan.points[scan.segment == 0]
    assert len(clutter) > 300
    assert np.abs(np.linalg.norm(clutter - [0.5, 0.3, 1.0], axis=1) - 0.2).max() < 0.01


def test_the_points_wanted_come_within_a_few_per_cent() -> None:
    for element, stations in ((BEAM, AHEAD), (PIPE, AROUND), (H, AROUND)):
        for points in (1000, 20_000):
            scan = scan_virtually(element, bends=["8:y:22.5"], stations=stations, points=points, **EXACT)
            assert scan.on_element.sum() == pytest.approx(points, rel=0.06)
    assert scan_virtually(BEAM, stations=AHEAD, **EXACT).on_element.sum() == pytest.approx(10_000, rel=0.05)


def test_the_angular_step_is_kept() -> None:
    scan = scan_virtually(BEAM, stations=[[3.0, 0.0, 1.25]], angular_step_deg=0.1, **EXACT)
    face = scan.points[np.abs(scan.points[:, 0] - 0.05) < 1e-6] - [3.0, 0.0, 1.25]
    middle = face[np.abs(face[:, 2]) < 0.2]
    cell = (np.radians(0.1) * 2.95) ** 2
    assert len(middle) == pytest.approx(0.4 * 0.3 / cell, rel=0.03)


def test_scans_carry_their_stations() -> None:
    scan = scan_virtually(BEAM, stations=AROUND)
    assert np.array_equal(scan.stations, AROUND)
    assert set(np.unique(scan.station_index)) == {0, 1, 2}
    plain = scan.without_truth()
    assert plain.station_index is scan.station_index and not hasattr(plain, "segment")


def test_the_truth_is_carried() -> None:
    bent = bend_element(BEAM, ["8:y:22.5"])
    scan = scan_virtually(BEAM, bends=["8:y:22.5"], stations=AHEAD)
    assert np.array_equal(scan.q, bent.q) and np.array_equal(scan.nodes_m, bent.nodes_m)
    again = scan_virtually(BEAM, joint_angles_rad=bent.joint_angles_rad, stations=AHEAD)
    assert again.points.tobytes() == scan.points.tobytes()


def test_the_same_seed_gives_the_same_bits_and_another_another_grid() -> None:
    one, two, other = (scan_virtually(BEAM, stations=AHEAD, seed=s).points.tobytes() for s in (1, 1, 2))
    assert one == two != other


def test_utm_coordinates_keep_their_digits() -> None:
    element = Element("utm", H.profile, 2.5, placement=UTM)
    T = UTM.T_world_element
    motion = rigid_motion((0.05, -0.03, 0.02), (1, 2, -3))
    stations = np.array(AROUND) @ T[:3, :3].T + T[:3, 3]
    floor_here = wall((0, 0, -0.02), (0, 0, 1))
    floor_there = (floor_here.vertices @ T[:3, :3].T + T[:3, 3], floor_here.triangles)
    kwargs = {"bends": ["8:y:22.5"], "displacement": motion, "mixed_pixels": 0.0}
    here = scan_virtually(H, stations=AROUND, others=[floor_here], **kwargs)
    there = scan_virtually(element, stations=stations, others=[floor_there], **kwargs)
    # A ray that grazes an edge may fall either way by a rounding.
    assert abs(len(here) - len(there)) < 20
    local = (there.points - T[:3, 3]) @ T[:3, :3]
    gap = shapely.STRtree(shapely.points(here.points)).query_nearest(
        shapely.points(local), all_matches=False, return_distance=True
    )[1]
    assert np.quantile(gap, 0.999) < 1e-5
    exact = scan_virtually(element, bends=["8:y:22.5"], displacement=motion, stations=stations, **EXACT)
    assert off_body(exact, element).max() < 6e-5
    towards = stations[exact.station_index] - exact.points
    assert (np.einsum("ij,ij->i", towards, exact.surface_normals) > -1e-4).all()


def test_a_station_beneath_above_and_far_away() -> None:
    for station in ((0.0, 0.0, -3.0), (0.02, 0.01, 6.0), (300.0, 200.0, 2.0), (0.2, 0.0, 1.2)):
        scan = scan_virtually(BEAM, bends=["8:y:9"], stations=[station], points=2000, **EXACT)
        assert scan.on_element.sum() == pytest.approx(2000, rel=0.1)
        assert off_body(scan, BEAM).max() < 1e-4


def test_stations_that_see_nothing_say_so() -> None:
    hood = [box_mesh((3.0, 1.0, 1.2), (0.2, 0.2, 0.2))]
    with pytest.raises(SettingsError, match="none of them sees the element"):
        scan_virtually(BEAM, stations=AHEAD, others=hood)
    assert (scan_virtually(BEAM, stations=AHEAD, others=hood, angular_step_deg=1.0, mixed_pixels=0).segment == 0).all()
    with pytest.raises(SettingsError, match="nothing is seen"):
        scan_virtually(Element("e", Circle(1e-4), 0.01), stations=[[50, 0, 0]], angular_step_deg=10, margin_m=0)


def test_a_scan_from_within_the_pipe_sees_its_inside() -> None:
    scan = scan_virtually(PIPE, stations=[[0.0, 0.0, 1.2]], points=3000, **EXACT)
    local = in_segments(scan, PIPE, scan.points)
    assert np.linalg.norm(local[:, :2], axis=1).max() < 0.0901


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"stations": []}, "stations: shape"),
        ({"stations": np.zeros((0, 3))}, "0 stations"),
        ({"stations": [[1, 2]]}, r"stations: shape \[1\]\[2\]"),
        ({"stations": [[np.nan, 0, 0]]}, "not finite"),
        ({"stations": [[0.0, 0.0, 1.2]]}, "inside the element"),
        ({"stations": [[0.0, 0.0, 1.2]], "angular_step_deg": 1.0}, "inside the element"),
        ({"stations": [[0.05, 0.15, 0.25]]}, "inside the element"),
        ({"points": 10, "angular_step_deg": 0.1}, "together with angular_step_deg"),
        ({"points": 0}, "points: 0"),
        ({"angular_step_deg": 0.0}, "angular_step_deg: 0"),
        ({"angular_step_deg": 0.0001}, "a grid of .* rays"),
        ({"range_noise_m": -1}, "range_noise_m: -1"),
        ({"mixed_pixels": 1.5}, "mixed_pixels: 1.5"),
        ({"background_m": -1}, "background_m: -1"),
        ({"margin_m": "wide"}, "margin_m: 'wide'"),
        ({"seed": 1.5}, "seed: 1.5"),
        ({"bends": ["11:y:3"]}, "segment 11"),
        ({"others": ["floor"]}, r"others\[0\]: a str"),
        ({"others": [(np.zeros((3, 3)), [[0, 1, 3]])]}, r"others\[0\]: triangles beyond"),
        ({"others": [(np.zeros((3, 2)), [[0, 1, 2]])]}, r"others\[0\] vertices: shape"),
    ],
)
def test_wrong_arguments_are_named(arguments, message) -> None:
    with pytest.raises(SettingsError, match=message):
        scan_virtually(BEAM, **{"stations": AHEAD, **arguments})


def test_wrong_objects_are_named() -> None:
    with pytest.raises(SettingsError, match="size"):
        box_mesh((0, 0, 0), (1, 0, 1))
    with pytest.raises(SettingsError, match="normal"):
        wall((0, 0, 0), (0, 0, 0))
    assert trimesh.Trimesh(*box_mesh((1, 2, 3), (1, 2, 3))).volume == pytest.approx(6)


def test_a_joint_folded_back_is_no_division_by_zero() -> None:
    element = Element("e", BEAM.profile, 2.5, joint_limit_deg=180)
    vertices, _ = element_mesh(element, ["5:y:180"])
    assert np.isfinite(vertices).all()
    assert vertices[:, 2].max() < 1.01
