"""Correspondences: the nearest face of a bent chain, against brute force over all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from samples import SAMPLES

from linear_ik.bending import bend_element
from linear_ik.chain import Chain, Pose
from linear_ik.correspondence import Correspondences, Matcher
from linear_ik.element import Element, Placement
from linear_ik.problem import AXIAL, Problem, in_reach, sample, thinned
from linear_ik.profile import Circle, Profile, Rectangle
from linear_ik.scan import Scan
from linear_ik.simulate import simulate
from linear_ik.surface import Surface

SINGLE = 2e-6  # what single precision may mistake over 3 m
CHORDS = 32  # which tell a round section's segments apart
EACH = pytest.mark.parametrize("profile", SAMPLES.values(), ids=SAMPLES.keys())


def bent_chain(profile: Profile, segments: int = 4, bends: Sequence[str] = ("2:y:25", "3:x:-35")) -> tuple:
    element = Element("e", profile, 2.0, segments)
    chain = Chain.of(element)
    q = bend_element(element, bends).q
    return element, Matcher(Surface.of(profile), chain.segment_length_m), chain.pose(chain.with_q(q))


def points_around(element: Element, pose: Pose, count: int, seed: int = 0) -> np.ndarray:
    """Points in and about every segment, up to 0.1 m off the section's box, ends included."""
    rng = np.random.default_rng(seed)
    k = rng.integers(element.segments, size=count)
    outline = element.profile.outline()
    low, high = outline.min(axis=0) - 0.1, outline.max(axis=0) + 0.1
    local = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(-0.2, 0.7, count)])
    return pose.nodes_m[k] + np.einsum("pij,pj->pi", pose.rotations[k], local)


def all_distances(element: Element, pose: Pose, points: np.ndarray) -> np.ndarray:
    """Distance [P][N][E] of each point to each face of each segment, by GEOS and Pythagoras."""
    corners, out = element.profile.outline(), []
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    for R, p in zip(pose.rotations, pose.nodes_m[:-1], strict=True):
        local = (points - p) @ R
        across = shapely.distance(edges[None], shapely.points(local[:, :2])[:, None])
        if element.profile.radius_m is not None:
            across[:] = np.abs(np.hypot(*local[:, :2].T) - element.profile.radius_m)[:, None]
        along = local[:, 2] - np.clip(local[:, 2], 0, element.segment_length_m)
        out.append(np.hypot(across, along[:, None]))
    return np.stack(out, axis=1)


def in_rows(pairs: Correspondences, values: np.ndarray) -> np.ndarray:
    """Values of the matches, in the order of the points."""
    out = np.empty_like(values)
    out[pairs.order] = values
    return out


def seen_from_chords_m(profile: Profile) -> float:
    """How much farther than the nearest segment the one taken may be: Open3D sees chords of a circle."""
    return SINGLE + (0.0 if profile.radius_m is None else 2 * profile.radius_m * (1 - np.cos(np.pi / CHORDS)))


# which face -----------------------------------------------------------------------------


@EACH
def test_every_point_is_matched_to_its_nearest_face(profile: Profile) -> None:
    element, matcher, pose = bent_chain(profile)
    points = points_around(element, pose, 1500)
    pairs = matcher.match(pose, points)
    D = all_distances(element, pose, points[pairs.order])
    nearest = D.min(axis=(1, 2))
    slack = seen_from_chords_m(profile)
    np.testing.assert_allclose(pairs.distance_m, nearest, rtol=0, atol=slack)
    assert (D[np.arange(len(D)), pairs.segment].min(axis=1) <= nearest + slack).all()
    clear = np.sort(D.min(axis=2), axis=1)[:, 1] > nearest + slack
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(pairs.segment[clear], D.min(axis=2).argmin(axis=1)[clear])
    if profile.radius_m is None:
        own = D[np.arange(len(D)), pairs.segment]
        assert (own[np.arange(len(D)), pairs.face] <= nearest + slack).all()


@EACH
def test_residuals_are_exact_signed_distances_in_double_precision(profile: Profile) -> None:
    element, matcher, pose = bent_chain(profile)
    points = points_around(element, pose, 1500, seed=1)
    pairs = matcher.match(pose, points)
    k = pairs.segment
    local = np.einsum("pij,pi->pj", pose.rotations[k], points[pairs.order] - pose.nodes_m[k])
    np.testing.assert_allclose(pairs.local, local, rtol=0, atol=1e-14)
    if profile.radius_m is not None:
        across = np.hypot(*local[:, :2].T) - profile.radius_m
    else:
        section, xy = shapely.Polygon(profile.outline()), shapely.points(local[:, :2])
        across = shapely.distance(section.exterior, xy) * np.where(shapely.contains(section, xy), -1, 1)
    # Beyond a segment's end another face may be the nearest one in space: judge those over the segment.
    over = (local[:, 2] > 0) & (local[:, 2] < element.segment_length_m)
    assert over.mean() > 0.5
    tied = np.abs(np.abs(pairs.residual_m) - np.abs(across)) > 1e-13
    assert (np.abs(np.abs(pairs.residual_m) - np.abs(across))[over] < SINGLE).all()
    assert tied[over].mean() < 0.01
    np.testing.assert_array_equal(np.sign(pairs.residual_m[over & ~tied]), np.sign(across[over & ~tied]))
    beyond = local[:, 2] - np.clip(local[:, 2], 0, element.segment_length_m)
    np.testing.assert_allclose(pairs.distance_m, np.hypot(pairs.residual_m, beyond), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(pairs.gradient, axis=1), 1, rtol=0, atol=1e-14)


@EACH
def test_points_of_the_simulator_are_on_the_face_they_were_made_on(profile: Profile) -> None:
    element, matcher, pose = bent_chain(profile)
    scan = simulate(element, bends=["2:y:25", "3:x:-35"], points=1000, noise_m=0.0)
    pairs = matcher.match(pose, scan.points)
    # Of two chords of a fillet, 0.5 m long and 3 mm wide, single precision may take the neighbour.
    slack = 5e-4 if "fillet_radius" in vars(profile) else seen_from_chords_m(profile)
    exact = np.abs(pairs.residual_m) < 1e-12
    assert exact.mean() > 0.995 and np.abs(pairs.residual_m).max() < slack
    assert exact.all() or slack > SINGLE
    # At a bend a point may lie on two segments at once, inside the member.
    own = in_rows(pairs, pairs.segment) + 1 == scan.segment
    assert own.mean() > 0.97
    k = pairs.segment
    normals = np.einsum("pij,pj->pi", pose.rotations[k][:, :, :2], pairs.gradient)
    across = np.einsum("ij,ij->i", normals, scan.surface_normals[pairs.order])
    assert np.median(across) > 1 - 1e-9 and (across[own[pairs.order]] > 0.99).mean() > 0.97


# how it is kept ------------------------------------------------------------------------


def test_matches_are_sorted_by_segment_and_know_their_point() -> None:
    element, matcher, pose = bent_chain(Rectangle(0.1, 0.3))
    points = points_around(element, pose, 700)
    pairs = matcher.match(pose, points)
    assert sorted(pairs.order) == list(range(700))
    assert pairs.starts[0] == 0 and pairs.starts[-1] == 700 and len(pairs.starts) == element.segments + 1
    assert (np.diff(pairs.segment) >= 0).all()
    for k in range(element.segments):
        rows = slice(pairs.starts[k], pairs.starts[k + 1])
        assert (pairs.segment[rows] == k).all()
        assert (np.diff(pairs.order[rows]) > 0).all()


def test_the_order_of_the_points_does_not_matter() -> None:
    element, matcher, pose = bent_chain(SAMPLES["i_shape"])
    points = points_around(element, pose, 700)
    shuffled = np.random.default_rng(5).permutation(700)
    one, other = matcher.match(pose, points), matcher.match(pose, points[shuffled])
    np.testing.assert_array_equal(in_rows(one, one.residual_m)[shuffled], in_rows(other, other.residual_m))
    np.testing.assert_array_equal(in_rows(one, one.face)[shuffled], in_rows(other, other.face))


@pytest.mark.parametrize(("first", "segments"), [(0, 1), (0, 3), (2, 4), (1, 2)])
def test_part_of_the_chain(first: int, segments: int) -> None:
    element, matcher, pose = bent_chain(Rectangle(0.1, 0.3))
    points = points_around(element, pose, 800)
    pairs = matcher.match(pose, points, segments, first)
    assert len(pairs.starts) == segments + 1 and pairs.starts[-1] == 800
    assert (pairs.segment >= first).all() and (pairs.segment < segments).all()
    D = all_distances(element, pose, points[pairs.order])[:, first:segments].min(axis=(1, 2))
    np.testing.assert_allclose(pairs.distance_m, D, rtol=0, atol=SINGLE)


@pytest.mark.parametrize("segments", [255, 256, 257, 500])
def test_more_segments_than_a_byte_counts(segments: int) -> None:
    element = Element("long", Circle(0.05), 50.0, segments)
    chain = Chain.of(element)
    pose = chain.pose(np.zeros(chain.nv))
    points = simulate(element, points=2000, noise_m=0.0).points
    pairs = Matcher(Surface.of(element.profile), chain.segment_length_m).match(pose, points)
    np.testing.assert_allclose(points[pairs.order, 2], pairs.local[:, 2] + 50.0 / segments * pairs.segment, atol=1e-11)
    assert (pairs.local[:, 2] >= -1e-5).all() and (pairs.local[:, 2] <= 50.0 / segments + 1e-5).all()
    assert np.abs(pairs.residual_m).max() < 1e-12


def test_no_points_give_no_matches() -> None:
    element, matcher, pose = bent_chain(Rectangle(0.1, 0.3))
    pairs = matcher.match(pose, np.zeros((0, 3)))
    assert pairs.starts.tolist() == [0] * (element.segments + 1) and len(pairs.residual_m) == 0


def test_matching_leaves_the_points_as_they_are() -> None:
    element, matcher, pose = bent_chain(Rectangle(0.1, 0.3))
    points = points_around(element, pose, 100)
    before = points.copy()
    matcher.match(pose, points)
    np.testing.assert_array_equal(points, before)


def test_ends_are_open() -> None:
    element, matcher, pose = bent_chain(Rectangle(0.1, 0.3), bends=())
    # In the middle of the end section the nearest surface is a side, 50 mm away.
    pairs = matcher.match(pose, np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 2.03]]))
    np.testing.assert_allclose(pairs.distance_m, [0.05, np.hypot(0.05, 0.03)], rtol=1e-12)
    np.testing.assert_allclose(pairs.residual_m, -0.05, rtol=1e-12)


# the problem they are matched in ---------------------------------------------------------


@pytest.mark.parametrize(
    "placement",
    [
        Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2), ref_direction=(0, 0, 1)),
        Placement((0, 0, 0), axis=(0, 0, -1), ref_direction=(0, 1, 0)),
    ],
    ids=["utm", "upside down"],
)
def test_where_the_element_stands_changes_no_match(placement: Placement) -> None:
    bends, profile = ["2:y:25"], SAMPLES["l_shape"]
    here = Element("e", profile, 2.0, 4)
    there = Element("e", profile, 2.0, 4, placement=placement)
    problems = [Problem.of(e, Scan(simulate(e, bends=bends, points=2000).points)) for e in (here, there)]
    # A UTM coordinate is rounded to a nanometre.
    np.testing.assert_allclose(problems[1].points, problems[0].points, rtol=0, atol=5e-9)
    x = problems[0].chain.with_q(bend_element(here, bends).q)
    one, other = (p.matcher.match(p.chain.pose(x), p.points) for p in problems)
    np.testing.assert_allclose(in_rows(one, one.distance_m), in_rows(other, other.distance_m), rtol=0, atol=SINGLE)
    assert (in_rows(one, one.segment) == in_rows(other, other.segment)).mean() > 0.999


def test_points_out_of_the_elements_reach_are_left_out() -> None:
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 4, placement=Placement((100, 200, 300)))
    near = simulate(element, bends=["1:x:45", "2:x:45"], points=300).points
    far = near + [0, 0, 500]
    problem = Problem.of(element, Scan(np.concatenate([near, far])))
    np.testing.assert_allclose(problem.points, near - [100, 200, 300], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("profile", "start", "held"),
    [
        (Rectangle(0.1, 0.3), "fixed", [0, 1, 2, 3, 4, 5]),
        (Circle(0.1), "fixed", [0, 1, 2, 3, 4, 5, 6, 9, 12]),
        (Rectangle(0.1, 0.3), "pinned", [0, 1, 2]),
        (Rectangle(0.1, 0.3), "roller", [0, 1, 2]),
        (Rectangle(0.1, 0.3), "free", [2]),
    ],
)
def test_what_may_move(profile: Profile, start: str, held: list[int]) -> None:
    element = Element("e", profile, 2.0, 3, start=start)
    problem = Problem.of(element, Scan(np.zeros((1, 3))))
    assert np.setdiff1d(np.arange(15), problem.variables).tolist() == held
    assert problem.may_slide == (start in ("roller", "free"))
    assert np.setdiff1d(np.arange(15), problem.released().variables).tolist() == [i for i in held if i != AXIAL]
    assert not problem.straight.any()


@pytest.mark.parametrize("end", ["free", "roller", "pinned", "fixed"])
def test_a_slide_is_held_unless_the_far_end_holds_it(end: str) -> None:
    for start in ("free", "roller"):
        problem = Problem.of(Element("e", Rectangle(0.1, 0.3), 2.0, 3, start=start, end=end), Scan(np.zeros((1, 3))))
        assert (AXIAL in problem.variables) == (end in ("pinned", "fixed"))


def test_another_prior_other_points_another_section() -> None:
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 3)
    problem = Problem.of(element, Scan(simulate(element, points=50).points))
    sd, mean = np.full(15, 0.1), np.full(15, 0.01)
    stiffer = problem.expecting(sd, mean)
    assert stiffer.prior_sd is sd and stiffer.prior_mean is mean and problem.prior_mean is not mean
    assert stiffer.expecting(2 * sd).prior_mean is mean
    assert len(problem.seeing(problem.points[:7]).points) == 7 and len(problem.points) == 50
    wider = problem.measuring(problem.surface.scaled(np.array([1.1, 1.0])))
    pairs = wider.matcher.match(wider.chain.pose(wider.straight), np.array([[0.06, 0.0, 1.0]]))
    assert pairs.residual_m[0] == pytest.approx(0.005)


# points of the problem -------------------------------------------------------------------


def test_many_points_are_kept_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    T = Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2)).T_world_element
    points = T[:3, 3] + rng.uniform(-4, 4, (1000, 3))
    few = in_reach(points, T, 3.0)
    monkeypatch.setattr("linear_ik.problem.MANY_POINTS", 300)
    many = in_reach(points, T, 3.0)
    near = np.linalg.norm(points - T[:3, 3], axis=1) <= 3.0
    assert few.dtype == np.float64 and many.dtype == np.float32 and len(few) == len(many) == near.sum()
    np.testing.assert_allclose(few, (points - T[:3, 3])[near] @ T[:3, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(many, few, rtol=0, atol=2e-7)


def test_a_sample_is_some_of_the_points_in_their_order() -> None:
    points = np.arange(300, dtype=np.float32).reshape(100, 3)
    some = sample(points, 10, np.random.default_rng(0))
    assert some.dtype == np.float64 and len(some) == 10
    assert (np.diff(some[:, 0]) > 0).all() and np.isin(some[:, 0], points[:, 0]).all()
    np.testing.assert_array_equal(sample(points, 100, np.random.default_rng(0)), points)


def test_thinned_is_one_point_a_cell_as_measured() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, (5000, 3))
    thin = thinned(points, 1.0, seed=2)
    assert (thin[:, None] == points[None]).all(axis=2).any(axis=1).all()
    cells = np.floor(thin - points.min(axis=0)).astype(int)
    every = np.floor(points - points.min(axis=0)).astype(int)
    assert len(np.unique(cells, axis=0)) == len(thin) == len(np.unique(every, axis=0))
    np.testing.assert_array_equal(thin, thinned(points, 1.0, seed=2))
    assert (thin != thinned(points, 1.0, seed=3)).any()
