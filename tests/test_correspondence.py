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
from linear_ik.element import Element
from linear_ik.profile import Circle, Profile, Rectangle
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
