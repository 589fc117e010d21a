"""A number of segments that the scan chooses: few where it is straight, many where it curves or kinks."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from command import run
from truth import check_consistent

import linear_ik
from linear_ik import Circle, Element, ModelFitOptions, Rectangle, Scan, simulate
from linear_ik.cli.summary import chosen_count
from linear_ik.element_file import element_from_mapping, element_to_mapping
from linear_ik.errors import ElementError, SettingsError
from linear_ik.exports.result_json import result_to_mapping, write_result
from linear_ik.readers.result_json import ResultError, read_result, result_from_mapping
from linear_ik.result import SegmentCount
from linear_ik.segment_count import candidates

PIPE, BAR = Circle(0.03), Rectangle(0.1, 0.06)
FINE = 80


def auto(profile, **fields):
    return Element("member", profile, 2.5, auto_segments=True, **fields)


def fitted(profile, angles, seed, **scene):
    """The fit of a member whose true chain is much finer than what is tried."""
    real = Element("member", profile, 2.5, segments=FINE)
    scan = simulate(real, joint_angles_rad=angles, seed=seed, **scene)
    result = linear_ik.fit(auto(profile), scan.without_truth())
    check_consistent(result)
    assert not result.element.auto_segments
    assert result.element.segments in [tried.segments for tried in result.segment_counts]
    least = min(result.segment_counts, key=lambda tried: tried.against)
    assert least.against == 0.0 and least.segments == result.element.segments
    return result, scan


def turning(degrees, axis=1):
    angles = np.zeros((FINE, 3))
    angles[:, axis] = np.radians(degrees) / FINE
    return angles


def kinked(degrees, joint):
    angles = np.zeros((FINE, 3))
    angles[joint, 1] = np.radians(degrees)
    return angles


@pytest.mark.parametrize("profile", [PIPE, BAR], ids=["pipe", "bar"])
@pytest.mark.parametrize("seed", range(4))
def test_a_straight_member_has_few(profile, seed):
    result, _ = fitted(profile, np.zeros((FINE, 3)), seed, points=6000)
    assert result.element.segments == 5
    assert result.status == "converged"


@pytest.mark.parametrize("seed", [0])
def test_a_quarter_of_a_circle_has_many(seed):
    result, scan = fitted(BAR, turning(90.0), seed)
    assert result.element.segments == 20
    # Segments are at least as long as the section is wide; the true curve's own points lie on it.
    assert result.surface_rmse_m < 0.0013


@pytest.mark.parametrize("seed", range(3))
def test_a_slight_arc_has_some(seed):
    result, _ = fitted(BAR, turning(5.0, axis=seed % 2), seed)
    assert result.element.segments == 10


@pytest.mark.parametrize("joint", [11, 37, 61])
def test_a_kink_between_the_joints_of_the_coarse_ones_is_followed(joint):
    result, scan = fitted(BAR, kinked(4.0, joint), seed=joint)
    assert result.element.segments >= 20
    at = result.nodes_m[1:-1], scan.nodes_m[joint]
    bends = np.linalg.norm(result.joint_angles_rad[1:, :2], axis=1)
    assert np.linalg.norm(at[0][bends.argmax()] - at[1]) <= 2.5 / 20


def test_a_scan_of_few_points_does_not_get_many():
    result, _ = fitted(BAR, turning(90.0), seed=1, points=1500)
    assert result.element.segments <= 20
    assert all(60 * tried.segments <= 1500 for tried in result.segment_counts)


def test_errors_that_points_share_are_not_followed():
    real = Element("member", BAR, 2.5, segments=FINE)
    scan = simulate(real, seed=3, points=40_000, noise_m=0.0005)
    # Waves of 0.2 mm on all faces: a fiftieth of the member long.
    off = 2e-4 * np.sin(2 * np.pi * 50 * scan.points[:, 2] / 2.5 + scan.surface_normals[:, 0])
    result = linear_ik.fit(auto(BAR), Scan(scan.points + off[:, None] * scan.surface_normals))
    assert result.element.segments == 5


def test_candidates_are_no_shorter_than_the_section():
    assert [e.segments for e in candidates(auto(PIPE))] == [5, 10, 20, 40]
    assert [e.segments for e in candidates(auto(BAR))] == [5, 10, 20]
    assert [e.segments for e in candidates(replace(auto(Rectangle(0.3, 0.3)), length_m=1.0))] == [3]
    assert [e.segments for e in candidates(replace(auto(Rectangle(0.3, 0.3)), length_m=0.2))] == [1]
    # A hook of 100 degrees that five segments cannot follow.
    hook = ((0, 0, 0), (0, 0, 1.0), (0.2, 0, 1.2), (0.4, 0, 1.0), (0.4, 0, 0.2))
    length_m = 1.0 + 2 * float(np.hypot(0.2, 0.2)) + 0.8
    curved = Element("hook", Circle(0.02), length_m, auto_segments=True, axis_points=hook)
    assert 10 in [e.segments for e in candidates(curved)]


def test_an_element_that_is_not_there_is_not_scanned():
    result = linear_ik.fit(auto(BAR), Scan(np.random.default_rng(0).random((500, 3)) + 20.0))
    assert result.status == "not_scanned" and result.segment_counts == ()


def test_what_is_not_there_is_not_fitted_again_for_its_length(monkeypatch):
    element = auto(BAR, length_tolerance_m=0.03)
    monkeypatch.setattr(import_module("linear_ik.fit"), "fit_length", lambda *_: pytest.fail("fitted again"))
    result = linear_ik.fit(element, Scan(np.random.default_rng(0).random((500, 3)) + 20.0))
    assert result.status == "not_scanned" and result.segment_counts == ()
    assert result.element == replace(element, segments=5, auto_segments=False)


def test_the_chosen_count_is_the_one_with_the_least_against_it():
    tried = (SegmentCount(5, 3.0, 0.002), SegmentCount(10, 1e-12, 0.001))
    assert chosen_count(tried) == "10 by the evidence (against 5: 3)"


def test_with_a_length_to_be_found():
    real = Element("member", BAR, 2.48, segments=FINE)
    element = auto(BAR, length_tolerance_m=0.03)
    result = linear_ik.fit(element, simulate(real, joint_angles_rad=turning(5.0), seed=4).without_truth())
    assert result.element == replace(element, segments=10, auto_segments=False)
    assert result.length_m == pytest.approx(2.48, abs=0.003)


def test_the_file_says_auto():
    mapping = {"name": "a", "profile": {"type": "circle", "radius": 0.1}, "length": 3, "segments": "auto"}
    element = element_from_mapping(mapping)
    assert element.auto_segments and element.segments == 10
    assert element_to_mapping(element)["segments"] == "auto"
    assert element_from_mapping(element_to_mapping(element)) == element
    with pytest.raises(ElementError, match="segments: 'automatic' is not a number"):
        element_from_mapping({**mapping, "segments": "automatic"})
    with pytest.raises(ElementError, match="auto_segments"):
        element_from_mapping({**mapping, "auto_segments": True})


def test_both_a_number_and_auto_are_refused():
    with pytest.raises(ElementError, match="12 together with auto_segments"):
        Element("a", PIPE, 2.5, segments=12, auto_segments=True)
    with pytest.raises(ElementError, match="auto_segments"):
        Element("a", PIPE, 2.5, auto_segments="yes")
    assert ModelFitOptions(segments="auto").segments == "auto"
    with pytest.raises(SettingsError, match="segments"):
        ModelFitOptions(segments="many")


def test_a_result_reads_back_and_contradictions_are_refused(tmp_path):
    result, _ = fitted(BAR, np.zeros((FINE, 3)), 1, points=3000)
    back = read_result(write_result(result, tmp_path / "result.json"))
    assert back.segment_counts == result.segment_counts
    mapping = result_to_mapping(result)
    row = {"segments": 7, "against": 0.0, "surface_rmse_m": 0.001}
    for wrong in ([row], [{**row, "segments": "5"}], {}, [3]):
        with pytest.raises(ResultError, match="segment_counts"):
            result_from_mapping({**mapping, "segment_counts": wrong})
    del mapping["segment_counts"]
    assert result_from_mapping(mapping).segment_counts == ()


def test_the_command_line(tmp_path):
    scan = simulate(Element("m", BAR, 2.5), seed=9, points=4000)
    np.savetxt(tmp_path / "scan.xyz", scan.points)
    text = "name: m\nprofile: {type: rectangle, x_dim: 0.1, y_dim: 0.06}\nlength: 2.5\nsegments: 8\n"
    (tmp_path / "bar.yaml").write_text(text)
    done = run("fit", "bar.yaml", "scan.xyz", "-o", "r.json", "--segments", "auto", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "5 by the evidence (against 10: " in done.stderr
    assert read_result(tmp_path / "r.json").element.segments == 5
    done = run("fit", "bar.yaml", "scan.xyz", "-o", "s.json", "--segments", "many", cwd=tmp_path)
    assert done.returncode == 2 and not (tmp_path / "s.json").exists()
    assert done.stderr == "error: --segments: 'many' (a whole number, or auto)\n"


def test_a_live_view_follows_the_numbers_that_are_tried(tmp_path):
    from linear_ik.viewer import Viewer

    element = auto(BAR)
    scan = simulate(Element("m", BAR, 2.5), seed=9, points=3000).without_truth()
    viewer = Viewer("m")
    viewer.show_design(element)
    result = linear_ik.fit(element, scan, on_iteration=viewer.on_iteration)
    viewer.show_result(result, scan)
    assert viewer.static_html(tmp_path / "page.html").stat().st_size > 100_000


@pytest.mark.parametrize("share", [1.0, 1.025])
def test_a_section_out_of_its_nominal_size_has_as_many(share):
    angles = np.zeros((20, 3))
    angles[1:, 1] = np.radians(40.0 / 20)
    real = Element("member", Rectangle(0.1 * share, 0.1 * share), 4.0, 20)
    scan = simulate(real, joint_angles_rad=angles, points=6000, seed=1)
    result = linear_ik.fit(Element("member", Rectangle(0.1, 0.1), 4.0, auto_segments=True), scan.without_truth())
    assert result.element.segments == 20
    assert np.linalg.norm(result.nodes_m[-1] - scan.nodes_m[-1]) < 0.0005
    assert (result.section_scale is None) == (share == 1.0)
    if share != 1.0:
        assert result.section_scale == pytest.approx((share, share), abs=0.001)
        again = result_from_mapping(result_to_mapping(result))
        assert again.section_scale == result.section_scale
