"""Curved design axes: how chains follow them, and fits that start from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truth import check_consistent, kinematics

import linear_ik
from linear_ik.chain import BASE, Chain
from linear_ik.design_axis import follow
from linear_ik.element import Element
from linear_ik.element_file import element_from_mapping, element_to_mapping
from linear_ik.errors import ElementError, SettingsError
from linear_ik.problem import AXIAL, Problem
from linear_ik.profile import Circle, Rectangle
from linear_ik.simulate import simulate
from linear_ik.terms.support import end_support


def arc(radius_m: float, degrees: float, azimuth_deg: float = 0.0, legs: int = 200) -> tuple:
    """A circle's arc from the origin, its start along Z, towards an azimuth."""
    t, a = np.radians(np.linspace(0, degrees, legs + 1)), np.radians(azimuth_deg)
    across = radius_m * (1 - np.cos(t))
    return tuple(map(tuple, np.column_stack([across * np.cos(a), across * np.sin(a), radius_m * np.sin(t)])))


def along(profile, points, segments: int = 10, **more) -> Element:
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return Element("curved", profile, length, segments, axis_points=points, **more)


ARC = along(Rectangle(0.1, 0.3), arc(2.0, 90.0))
ELBOW = along(Circle(0.06), ((0, 0, 0), (0, 0, 1.0), (0.3, 0, 1.3), (1.3, 0, 1.3)), 20)
OBLIQUE = along(Rectangle(0.08, 0.2), arc(1.5, 70.0, 30.0))


# the axis ---------------------------------------------------------------------------------


@pytest.mark.parametrize("element", [ARC, ELBOW, OBLIQUE], ids=["arc", "elbow", "oblique"])
def test_nodes_lie_on_the_axis_equally_far_apart(element):
    design, points = element.design, np.array(element.axis_points)
    steps = np.linalg.norm(np.diff(design.nodes_m, axis=0), axis=1)
    np.testing.assert_allclose(steps, element.segment_length_m, rtol=1e-9)
    np.testing.assert_allclose(design.nodes_m[-1], points[-1], rtol=0, atol=1e-8)
    for node in design.nodes_m:
        legs = np.diff(points, axis=0)
        share = np.clip(((node - points[:-1]) * legs).sum(axis=1) / (legs**2).sum(axis=1), 0, 1)
        assert np.linalg.norm(points[:-1] + share[:, None] * legs - node, axis=1).min() < 1e-9
    _, nodes = kinematics(np.eye(4), design.angles_rad, element.segment_length_m)
    np.testing.assert_allclose(nodes, design.nodes_m, rtol=0, atol=1e-8)
    chain = Chain.of(element)
    np.testing.assert_allclose(chain.nodes(design.angles_rad[:, ::-1].ravel()), design.nodes_m, rtol=0, atol=1e-8)


def test_a_plane_arc_keeps_its_section_in_its_plane():
    across = np.array([-np.sin(np.radians(30)), np.cos(np.radians(30)), 0])
    for R in OBLIQUE.design.rotations:
        # What the section's X and Y are across the plane stays what it was.
        np.testing.assert_allclose(across @ R[:, :2], across[:2], rtol=0, atol=1e-12)


def test_a_straight_polyline_is_the_straight_element():
    straight = Element("e", Circle(0.1), 2.0)
    same = replace(straight, axis_points=((0, 0, 0), (0, 0, 0.5), (0, 0, 2.0)))
    np.testing.assert_allclose(same.design.nodes_m, straight.design.nodes_m, rtol=0, atol=1e-12)
    assert not same.design.angles_rad.any()


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([[0, 0, 0]], "at least two points"),
        ([[0, 0, 1], [0, 0, 2]], "the placement's location"),
        ([[0, 0, 0], [0, 0, 1], [0, 0, 1]], "points apart"),
        ([[0, 0, 0], [1, 0, -0.1]], "away from"),
        ([[0, 0, 0], [0, 1]], "three numbers"),
        ([[0, 0, 0], [0, 0, float("nan")]], "metres"),
        ("arc", "at least two points"),
    ],
)
def test_what_is_no_axis_is_refused(points, says):
    with pytest.raises(ElementError, match=says) as refused:
        Element("e", Circle(0.1), 1.0, axis_points=points)
    assert refused.value.subject.startswith("axis_points")


def test_turns_that_segments_cannot_follow_are_refused():
    hairpin = ((0, 0, 0), (0, 0, 1.0), (0.01, 0, 1.0), (0.01, 0, 0))
    with pytest.raises(ElementError, match="more segments"):
        follow(hairpin, 3)


def test_length_is_the_axis_own():
    points = [list(p) for p in arc(2.0, 90.0)]
    keys = {"name": "curved", "profile": {"type": "rectangle", "x_dim": 0.1, "y_dim": 0.3}, "axis_points": points}
    assert element_from_mapping(keys) == ARC
    assert element_from_mapping(element_to_mapping(ARC)) == ARC
    assert element_from_mapping({**keys, "length": 3.1416}).length_m == ARC.length_m
    with pytest.raises(ElementError, match="the length along axis_points") as refused:
        element_from_mapping({**keys, "length": 3.2})
    assert refused.value.subject == "length"
    with pytest.raises(ElementError, match="key length is missing"):
        element_from_mapping({k: v for k, v in keys.items() if k != "axis_points"})
    with pytest.raises(ElementError, match="not a list of three"):
        element_from_mapping({**keys, "axis_points": [[0, 0, 0], 1.0]})


# limits, bends, supports, priors ------------------------------------------------------------


def test_limits_are_about_the_design():
    element = replace(ARC, joint_limit_deg=(5, 6, 7))
    chain, designed = Chain.of(element), element.design.angles_rad
    lower, upper = (bound[BASE:].reshape(-1, 3)[:, ::-1] for bound in (chain.lower, chain.upper))
    np.testing.assert_array_equal(lower, designed - np.radians([5, 6, 7]))
    np.testing.assert_array_equal(upper, designed + np.radians([5, 6, 7]))
    scan = simulate(element, bends=["4:y:6"], points=10)
    assert scan.joint_angles_rad[3, 1] == pytest.approx(designed[3, 1] + np.radians(6))
    with pytest.raises(SettingsError, match="segment 4 by 6.5 degrees"):
        simulate(element, bends=["4:y:6.5"])


@pytest.mark.parametrize("end", ["roller", "pinned", "fixed"])
def test_a_held_end_pulls_to_where_the_design_ends(end):
    element = replace(ARC, end=end)
    chain, problem = Chain.of(element), Problem.of(element, linear_ik.Scan(np.zeros((20, 3))))
    term = end_support(element, chain.pose(problem.designed), 1.0)
    assert np.abs(term.c).max() < 1e-3 * np.abs(term.H).max() * 1e-3
    # A roller slides along the last segment.
    tip = chain.pose(problem.designed).node_jacobians()[-1]
    free = np.linalg.lstsq(tip, element.design.rotations[-1, :, 2], rcond=None)[0]
    pull = free @ term.H @ free
    assert (pull < 1.0) == (end == "roller")


def test_the_design_is_what_is_expected():
    problem = Problem.of(replace(ARC, start="free"), linear_ik.Scan(np.zeros((20, 3))))
    np.testing.assert_array_equal(problem.prior_mean[BASE:], ARC.design.angles_rad[:, ::-1].ravel())
    np.testing.assert_array_equal(problem.designed, problem.prior_mean)
    assert AXIAL in problem.variables


# fits -------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", [ARC, ELBOW, OBLIQUE], ids=["arc", "elbow", "oblique"])
@pytest.mark.parametrize("missing", [[], ["+x"]], ids=["whole", "a side missing"])
def test_the_truth_is_recovered(element, missing):
    scan = simulate(element, bends=["3:y:3", "7:x:-8"], missing=missing, seed=2)
    result = linear_ik.fit(element, scan.without_truth())
    check_consistent(result)
    error = np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)
    assert error.max() < 0.001, (result.reasons, error)
    assert result.status == "converged", result.reasons


def test_a_curved_pole_that_tapers_and_has_moved():
    element = along(Circle(0.08), arc(2.5, 60.0), start="free", profile_end=Circle(0.04))
    motion = np.eye(4)
    motion[:3, 3] = 0.02, -0.015, 0.02
    scan = simulate(element, bends=["6:x:4"], displacement=motion)
    result = linear_ik.fit(element, scan.without_truth())
    sd_m = np.sqrt(np.linalg.eigvalsh(result.nodes_covariance_m2)[:, -1])
    error = np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)
    assert (error < 0.001 + 4 * sd_m).all()
    assert result.surface_rmse_m == pytest.approx(0.001, abs=1e-4)


@pytest.mark.parametrize("settings", [linear_ik.FitSettings(search="always"), linear_ik.FitSettings(method="icpik")])
def test_search_and_icpik_start_from_the_design(settings):
    scan = simulate(ARC, bends=["5:y:4"], points=5000)
    result = linear_ik.fit(ARC, scan.without_truth(), settings)
    error = np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)
    assert error.max() < (0.001 if settings.method != "icpik" else 0.05)


def test_where_nothing_is_scanned_the_design_is_the_answer():
    result = linear_ik.fit(ARC, linear_ik.Scan(np.full((30, 3), 50.0)))
    assert result.status == "not_scanned"
    np.testing.assert_allclose(result.nodes_m, ARC.design.nodes_m, rtol=0, atol=1e-9)


def test_the_viewer_shows_the_curve():
    from linear_ik.viewer_shapes import axis_distances_m, design_body, designed_nodes_m

    corners = design_body(ARC).vertices
    assert corners[:, 0].max() == pytest.approx(2.0, abs=0.06)
    np.testing.assert_array_equal(designed_nodes_m(ARC), ARC.design.nodes_m)
    assert axis_distances_m(ARC, ARC.design.nodes_m + [0, 0.1, 0]) == pytest.approx(0.1)


def test_nodes_of_a_true_curve_are_off_by_no_more_than_their_chords_leave_them():
    """As built a bend is smooth: nodes of its chords stand two thirds of the bulge outside it, and say so."""
    turns, radius_m, noise_m = np.pi / 2, 0.4, 0.0015
    bend = arc(radius_m, 90.0)
    line = ((0, 0, -1.0), *bend, (radius_m + 1.0, 0, radius_m))
    pipe = along(Circle(0.08), tuple((x, y, z + 1.0) for x, y, z in line), 40, start="free")
    rng = np.random.default_rng(1)
    where, around = rng.uniform(0, 2 + radius_m * turns, 12_000), rng.uniform(0, 2 * np.pi, 12_000)

    def axis(s):
        t = np.clip((s - 1.0) / radius_m, 0, turns)
        before, after = np.minimum(s, 1.0), np.maximum(s - 1.0 - radius_m * turns, 0.0)
        x, z = radius_m * (1 - np.cos(t)) + after, before + radius_m * np.sin(t)
        inwards = np.column_stack([np.cos(t), np.zeros(len(t)), -np.sin(t)])
        return np.column_stack([x, np.zeros(len(t)), z]), inwards

    middle, inwards = axis(where)
    outwards = np.cos(around)[:, None] * inwards + np.sin(around)[:, None] * [0.0, 1.0, 0.0]
    points = middle + (0.08 + noise_m * rng.standard_normal((len(where), 1))) * outwards
    result = linear_ik.fit(pipe, linear_ik.Scan(points))
    assert result.status in ("converged", "uncertain"), result.reasons
    fine, _ = axis(np.linspace(0, 2 + radius_m * turns, 10_001))
    inner = slice(2, -2)
    off = result.nodes_m[inner, None] - fine[None]
    nearest = np.einsum("kfi,kfi->kf", off, off).argmin(axis=1)
    off = off[np.arange(len(off)), nearest]
    size_m = np.linalg.norm(off, axis=1)
    unit = off / size_m[:, None]
    sd_m = np.sqrt(np.einsum("ki,kij,kj->k", unit, result.nodes_covariance_m2[inner], unit))
    assert 0.0007 < size_m.max() < 0.0013, "the chords' own"
    assert (size_m < 3.0 * sd_m).all()
