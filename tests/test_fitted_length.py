"""A length that is known within a tolerance: found where the ends of the scan tell it, else carried as uncertain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from command import run
from samples import SAMPLES
from truth import kinematics

import linear_ik
from linear_ik import Element, Placement, Rectangle, Scan, simulate
from linear_ik.bending import bend_element, rigid_motion
from linear_ik.cloud_end import cloud_end
from linear_ik.design_axis import polyline_length_m
from linear_ik.deviation import deviations
from linear_ik.deviation_bands import BAND_95
from linear_ik.errors import ElementError
from linear_ik.exports.result_json import result_to_mapping, write_result
from linear_ik.readers.result_json import ResultError, read_result, result_from_mapping
from linear_ik.scene import wall
from linear_ik.virtual_scanner import scan_virtually

DESIGNED_M, TOLERANCE_M = 2.5, 0.03
UTM = Placement((512345.678, 5403210.123, 412.5), axis=(1.0, 0.2, 0.0))
ARC = tuple((3.0 - 3.0 * float(np.cos(a)), 0.0, 3.0 * float(np.sin(a))) for a in np.linspace(0.0, np.pi / 4, 31))


def member(profile="rectangle", **fields):
    return Element("member", SAMPLES[profile], DESIGNED_M, length_tolerance_m=TOLERANCE_M, **fields)


def built(element, off_m):
    """What stands there: the design but for its length."""
    return replace(element, length_m=element.length_m + off_m, length_tolerance_m=0.0)


def slightly_bent(seed):
    angles = np.zeros((10, 3))
    angles[:, :2] = np.radians(np.random.default_rng(seed).uniform(-2.0, 2.0, (10, 2)))
    return angles


def check(result, element, scan, off_m, within_m=0.003):
    assert result.element is element
    assert result.length_m == pytest.approx(element.length_m + off_m, abs=within_m)
    assert abs(result.length_m - element.length_m - off_m) < 4.0 * result.length_sd_m < 0.012
    # The nodes are those of a chain of that length, and as near to the truth as they say.
    _, nodes = kinematics(result.base_pose, result.joint_angles_rad, result.fitted_element.segment_length_m)
    np.testing.assert_allclose(result.nodes_m, nodes, rtol=0, atol=1e-9 + 4e-16 * np.abs(nodes).max())
    off = result.nodes_m[-1] - scan.nodes_m[-1]
    assert off @ np.linalg.solve(result.nodes_covariance_m2[-1], off) < 16.0


@pytest.mark.parametrize("off_m", [-0.024, 0.011])
@pytest.mark.parametrize("profile", ["rectangle", "circle", "i_shape"])
def test_the_far_end_of_the_scan_tells_the_length_of_a_held_member(profile, off_m):
    element = member(profile, placement=UTM)
    scan = simulate(built(element, off_m), joint_angles_rad=slightly_bent(3), seed=3)
    result = linear_ik.fit(element, scan.without_truth())
    assert result.status == "converged"
    check(result, element, scan, off_m)


@pytest.mark.parametrize("start", ["free", "roller"])
def test_both_ends_tell_length_and_slide_where_the_start_may_move(start):
    element = member(start=start)
    moved = rigid_motion((0.0, 0.0, 0.015))
    scan = simulate(built(element, 0.02), joint_angles_rad=slightly_bent(5), displacement=moved, seed=5)
    result = linear_ik.fit(element, scan.without_truth())
    check(result, element, scan, 0.02)
    assert result.base_pose[2, 3] == pytest.approx(0.015, abs=0.006)


@pytest.mark.parametrize("end", ["roller", "pinned", "fixed"])
def test_held_ends(end):
    """A member between two supports that are farther apart than designed is only as long as its scan."""
    element = member(end=end)
    scan = simulate(built(element, 0.004), seed=2)
    result = linear_ik.fit(element, scan.without_truth())
    check(result, element, scan, 0.004)
    assert result.status == "converged"


def test_a_member_that_does_not_reach_where_its_end_is_held_is_in_doubt():
    element = member(end="pinned")
    scan = simulate(built(element, -0.025), seed=2)
    result = linear_ik.fit(element, scan.without_truth())
    check(result, element, scan, -0.025)
    assert result.status == "uncertain"
    assert any("from where the end is held" in reason for reason in result.reasons)


def test_a_hidden_end_leaves_the_designed_length_and_carries_the_tolerance():
    element = member()
    scan = simulate(built(element, 0.01), joint_angles_rad=slightly_bent(4), seed=4)
    seen = Scan(scan.points[scan.segment <= 9])
    result = linear_ik.fit(element, seen)
    assert result.length_m is None and result.length_sd_m is None
    assert any("length is not measured" in reason for reason in result.reasons)
    known = linear_ik.fit(replace(element, length_tolerance_m=0.0), seen)
    np.testing.assert_array_equal(result.nodes_m, known.nodes_m)
    along = known.nodes_m[-1] - known.nodes_m[0]
    along /= np.linalg.norm(along)
    more = along @ (result.nodes_covariance_m2[-1] - known.nodes_covariance_m2[-1]) @ along
    assert np.sqrt(more) == pytest.approx(TOLERANCE_M / np.sqrt(3.0), rel=0.02)


def test_a_held_end_tells_the_length_where_the_scan_does_not_show_it():
    element = member(end="pinned")
    scan = simulate(built(element, 0.0), seed=4)
    result = linear_ik.fit(element, Scan(scan.points[scan.segment <= 9]))
    assert result.length_m == pytest.approx(DESIGNED_M, abs=0.002)
    assert result.length_sd_m == pytest.approx(element.end_tolerance_m, rel=0.05)


def test_a_neighbour_that_goes_on_beyond_the_end_is_no_end():
    element = member()
    longer = replace(element, length_m=3.0, segments=12, length_tolerance_m=0.0)
    result = linear_ik.fit(element, simulate(longer, seed=6, points=12_000).without_truth())
    assert result.length_m is None
    assert any("go on beyond" in reason or "outside the tolerance" in reason for reason in result.reasons)


def test_a_shadow_that_runs_slanting_across_the_sides_is_no_end():
    element = member()
    scan = simulate(built(element, 0.02), seed=7)
    shadow = scan.points[:, 2] < 2.50 + 0.25 * scan.points[:, 1]
    result = linear_ik.fit(element, Scan(scan.points[shadow]))
    assert result.length_m is None
    assert any("do not stop at one place" in reason for reason in result.reasons)


@pytest.mark.parametrize("axis_points", [None, ARC])
def test_a_scanner_sees_the_length(axis_points):
    length_m = DESIGNED_M if axis_points is None else polyline_length_m(axis_points)
    element = Element("member", SAMPLES["rectangle"], length_m, length_tolerance_m=TOLERANCE_M, axis_points=axis_points)
    truth = element.with_length(element.length_m - 0.017)
    place = element.design.nodes_m.mean(axis=0)
    scan = scan_virtually(
        truth, stations=[place + [3.0, 2.0, 0.3], place - [3.0, 2.5, 0.2]], others=[wall((0, 6, 0), (0, -1, 0))], seed=8
    )
    result = linear_ik.fit(element, scan.without_truth())
    check(result, element, scan, -0.017)


def test_the_stated_deviation_holds_over_seeds():
    element, scores = member("circle"), []
    for seed in range(16):
        off_m = float(np.random.default_rng(seed).uniform(-0.028, 0.028))
        scan = simulate(built(element, off_m), seed=seed, points=5000)
        result = linear_ik.fit(element, scan.without_truth())
        scores.append((result.length_m - DESIGNED_M - off_m) / result.length_sd_m)
    # Of a chi-square of 16: between its 0.5 % and 99.9 % points, less what is stated cautiously.
    assert 2.0 < np.sum(np.square(scores)) < 39.3


def test_edges_are_found_whether_sharp_or_blurred():
    rng = np.random.default_rng(0)
    for blur_m in (0.0, 0.001):
        u = 0.013 - 0.5 * rng.random(3000) + blur_m * rng.standard_normal(3000)
        found = cloud_end(u, rng.integers(0, 8, 3000), 0.001, -0.05, 0.05)
        assert not isinstance(found, str)
        assert abs(found.at_m - 0.013) < 4.0 * found.sd_m < 0.006


def test_rows_of_points_tell_the_end_no_better_than_their_distance():
    rows = -np.arange(20) * 0.02
    u = np.repeat(rows, 40) + 1e-4 * np.random.default_rng(1).standard_normal(800)
    found = cloud_end(u, np.random.default_rng(2).integers(0, 8, 800), 0.001, -0.05, 0.05)
    assert not isinstance(found, str)
    assert found.sd_m > 0.004 and 0.0 < found.at_m < 0.02


def test_bands_and_length_change_carry_the_length():
    element = member()
    scan = simulate(built(element, 0.018), seed=9)
    result = linear_ik.fit(element, scan.without_truth())
    change = deviations(result).length_change_m
    assert change.value == pytest.approx(0.018, abs=0.003)
    assert change.band == pytest.approx(BAND_95 * result.length_sd_m, rel=0.05)
    assert f"{result.length_m:.4f} m" in change.note


def test_a_result_reads_back_and_contradictions_are_refused(tmp_path):
    element = member()
    result = linear_ik.fit(element, simulate(built(element, 0.018), seed=9).without_truth())
    back = read_result(write_result(result, tmp_path / "result.json"))
    assert (back.length_m, back.length_sd_m, back.element) == (result.length_m, result.length_sd_m, element)
    mapping = result_to_mapping(result)
    for change in ({"length_m": 9.0}, {"length_sd_m": None}, {"length_sd_m": -1.0}, {"length_m": "long"}):
        with pytest.raises(ResultError):
            result_from_mapping({**mapping, **change})
    for key in ("length_m", "length_sd_m"):
        del mapping[key]
    assert result_from_mapping(mapping).length_m is None


@pytest.mark.parametrize("wrong", [-0.001, 1.0, float("nan"), "much"])
def test_a_wrong_tolerance_is_refused(wrong):
    with pytest.raises(ElementError, match="length_tolerance_m"):
        replace(member(), length_tolerance_m=wrong)


def test_exports_take_the_fitted_length(tmp_path):
    from linear_ik.asbuilt.shape import bent_shape
    from linear_ik.report.cloud import T_world_segments
    from linear_ik.site.body import Body

    element = member()
    result = linear_ik.fit(element, simulate(built(element, 0.018), seed=9).without_truth())
    tip = result.nodes_m[-1]
    fitted = result.fitted_element
    frames = T_world_segments(result)
    np.testing.assert_allclose(frames[-1, :3, 3] + fitted.segment_length_m * frames[-1, :3, 2], tip, atol=1e-9)
    np.testing.assert_array_equal(bent_shape(result).nodes_m[-1], tip)
    body = Body.fitted(result)
    last = body.T_world_base @ body.T_base_segment[-1]
    np.testing.assert_allclose(last[:3, 3] + fitted.segment_length_m * last[:3, 2], tip, atol=1e-9)
    bent = bend_element(fitted, joint_angles_rad=result.joint_angles_rad)
    np.testing.assert_allclose(bent.nodes_m[-1], tip, atol=1e-9)


def test_the_command_line(tmp_path):
    text = "name: m\nprofile: {type: rectangle, x_dim: 0.1, y_dim: 0.3}\nlength: 2.5\nlength_tolerance_m: 0.03\n"
    (tmp_path / "beam.yaml").write_text(text)
    scan = simulate(built(member(), 0.018), seed=9)
    np.savetxt(tmp_path / "scan.xyz", scan.points)
    outputs = ["-o", "r.json", "--glb", "r.glb", "--urdf", "r.urdf"]
    done = run("fit", "beam.yaml", "scan.xyz", *outputs, cwd=tmp_path)
    assert done.returncode == 0
    assert "length     2.51" in done.stderr and "mm from the design" in done.stderr
    length_m = read_result(tmp_path / "r.json").length_m
    assert f'<origin xyz="0 0 {length_m / 10!r}"' in (tmp_path / "r.urdf").read_text()
    (tmp_path / "beam.yaml").write_text(text.replace("0.03", "3"))
    done = run("fit", "beam.yaml", "scan.xyz", "-o", "other.json", cwd=tmp_path)
    assert done.returncode == 2 and not (tmp_path / "other.json").exists()
    assert done.stderr.startswith("error: beam.yaml: length_tolerance_m: 3 (up to a quarter of")


def test_the_length_of_a_member_whose_section_is_out_of_its_nominal_size():
    element = replace(member(), profile=Rectangle(0.3, 0.3))
    real = replace(built(element, 0.02), profile=Rectangle(0.308, 0.308))
    scan = simulate(real, joint_angles_rad=slightly_bent(5), points=12_000, noise_m=0.0005, seed=5)
    result = linear_ik.fit(element, scan.without_truth())
    assert "section_size" in result.reason_codes
    check(result, element, scan, 0.02)
