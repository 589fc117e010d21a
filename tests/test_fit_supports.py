"""Supports and limits: what holds the member, and what the fit says where they bind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import SAMPLES
from truth import across_errors_m, check_consistent, node_errors_m

import linear_ik
from linear_ik import Element, Scan, simulate
from linear_ik.bending import rigid_motion

WITHIN_M = 0.001


def fit_of(element, **scene):
    """A fit without the truth, and the scan with it."""
    scan = simulate(element, **scene)
    result = linear_ik.fit(element, scan.without_truth())
    check_consistent(result)
    return result, scan


def assert_believed_but_for_the_slide(result):
    """Converged; or with no doubt but where the prism lies along its axis, and that a free start may leave."""
    doubts = [reason for reason in result.reasons if "along its axis" not in reason]
    assert not doubts
    assert result.status == "converged" or (result.element.start in ("free", "roller") and result.reasons)


@pytest.mark.parametrize("name", ["rectangle", "i_shape", "circle"])
@pytest.mark.parametrize("bends", [["8:y:22.5"], ["6:x:45"], ["4:x:1", "6:x:-1"]], ids=["22.5", "45", "slight"])
@pytest.mark.parametrize(
    ("start", "translation_m", "rotation_deg"),
    [
        ("free", (0.02, -0.015, 0.01), (1.0, -0.5, 0.5)),
        ("pinned", (0.0, 0.0, 0.0), (1.0, -0.5, 0.5)),
        ("roller", (0.0, 0.0, 0.02), (1.0, -0.5, 0.5)),
    ],
    ids=["free", "pinned", "roller"],
)
def test_starts(name, bends, start, translation_m, rotation_deg):
    element = Element("member", SAMPLES[name], 2.5, start=start)
    result, scan = fit_of(element, bends=bends, displacement=rigid_motion(translation_m, rotation_deg))
    assert_believed_but_for_the_slide(result)
    assert across_errors_m(result, scan).max() <= WITHIN_M
    # A nearly straight prism looks the same wherever it has slid to: bounded by what is said of it.
    slide_m = 3.5 * np.sqrt(result.nodes_covariance_m2[0, 2, 2])
    assert node_errors_m(result, scan).max() <= (WITHIN_M + slide_m if bends[0] == "4:x:1" else 2 * WITHIN_M)
    base = element.placement.T_world_element[:3, :3].T @ result.base_pose[:3, 3]
    allowed = {"free": [0.05] * 3, "pinned": [0, 0, 0], "roller": [0, 0, 0.05]}[start]
    assert (np.abs(base) <= allowed).all()


def sag_angles(segments: int, length_m: float, sag_m: float, clamped: bool) -> np.ndarray:
    """Angles [N][3] of a member that sags about X between its ends, both on the chord."""
    along = (np.arange(segments) + 0.5) / segments
    shape = np.sin(2 * np.pi * along) if clamped else np.cos(np.pi * along)
    low, high = 0.0, 1.0
    for _ in range(60):
        slope = (low + high) / 2
        depth = length_m / segments * np.cumsum(np.sin(slope * shape)).max()
        low, high = (slope, high) if depth < sag_m else (low, slope)
    angles = np.zeros((segments, 3))
    angles[:, 0] = -np.diff(slope * shape, prepend=0.0)
    return angles


@pytest.mark.parametrize("end", ["free", "roller", "pinned", "fixed"])
@pytest.mark.parametrize("start", ["fixed", "pinned", "roller", "free"])
def test_a_member_that_sags_between_its_supports(start, end):
    element = Element("sagging", SAMPLES["rectangle"], 5.0, start=start, end=end)
    angles = sag_angles(10, 5.0, 0.040, clamped=end == "fixed")
    result, scan = fit_of(element, joint_angles_rad=angles)
    # The chord of a member of known length is shorter by what it sags.
    assert 0.0006 < 5.0 - scan.nodes_m[-1, 2] < 0.0010
    # A start that may slide, with nothing at the end to hold it, is known along the axis to the points' spacing.
    assert result.status == "converged" or start == "free", result.reasons
    assert across_errors_m(result, scan).max() <= 0.0005
    assert np.abs(result.nodes_m[5, :2] - scan.nodes_m[5, :2]).max() <= 0.0005
    if start in ("fixed", "pinned"):
        assert node_errors_m(result, scan).max() <= 0.0005
    tip = result.nodes_m[-1] - [0, 0, 5.0]
    if end == "roller":
        assert np.hypot(tip[0], tip[1]) < 0.0005
    if end in ("pinned", "fixed"):
        assert np.linalg.norm(tip) < element.end_tolerance_m


@pytest.mark.parametrize(("end", "held"), [("roller", 2), ("pinned", 3), ("fixed", 3)])
def test_a_held_end_says_where_nothing_was_scanned(end, held):
    element = Element("half", SAMPLES["rectangle"], 5.0, end=end)
    scan = simulate(element, joint_angles_rad=sag_angles(10, 5.0, 0.040, clamped=end == "fixed"))
    seen = Scan(scan.points[scan.segment <= 6])
    result = linear_ik.fit(element, seen)
    loose = linear_ik.fit(replace(element, end="free"), seen)
    tip = result.nodes_m[-1] - [0, 0, 5.0]
    assert np.abs(tip[:held]).max() < element.end_tolerance_m
    held_sd, loose_sd = (np.sqrt(np.trace(r.nodes_covariance_m2[-1])) for r in (result, loose))
    assert held_sd < 0.012 and loose_sd > 1.5 * held_sd
    # What was scanned bends alike, and so is taken to go on: right here, and not claimed to be sure.
    assert loose.status == "uncertain"
    assert np.abs(loose.nodes_m[-1] - [0, 0, 5.0]).max() < 3.0 * loose_sd


@pytest.mark.parametrize(
    ("name", "limit_deg", "bends", "joint"),
    [
        ("rectangle", 20, ["8:y:22.5"], (8, 1)),
        ("i_shape", 20, ["8:y:22.5"], (8, 1)),
        ("circle", 20, ["8:y:22.5"], (8, 1)),
        ("l_shape", 20, ["5:x:30"], (5, 0)),
        ("i_shape", 20, ["5:x:30"], (5, 0)),
        ("rectangle", 10, ["8:y:22.5"], (8, 1)),
        ("rectangle", 45, ["6:x:60"], (6, 0)),
        ("circle", 45, ["6:x:60"], (6, 0)),
        ("rectangle", 2, ["5:x:5", "6:y:3"], (5, 0)),
        ("rectangle", (10, 10, 1), ["6:z:4", "7:x:3"], (6, 2)),
    ],
)
def test_an_active_limit_holds_to_the_last_bit_and_is_said(name, limit_deg, bends, joint):
    member = Element("member", SAMPLES[name], 2.5, joint_limit_deg=180)
    scan = simulate(member, bends=bends)
    result = linear_ik.fit(replace(member, joint_limit_deg=limit_deg), scan.without_truth())
    check_consistent(result)
    segment, axis = joint
    assert result.joint_angles_rad[segment - 1, axis] in result.joint_limits_rad[segment - 1, axis]
    assert result.status == "uncertain"
    said = [reason for reason in result.reasons if "joint limit" in reason]
    assert said and str(segment) in said[0]


@pytest.mark.parametrize("name", ["rectangle", "circle"])
def test_a_member_bent_to_exactly_its_limit_is_right(name):
    element = Element("member", SAMPLES[name], 2.5, joint_limit_deg=22.5)
    result, scan = fit_of(element, bends=["8:y:22.5"])
    assert result.status == "converged", result.reasons
    assert node_errors_m(result, scan).max() <= WITHIN_M
