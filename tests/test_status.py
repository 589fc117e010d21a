"""What a fit says of itself: absent elements, unseen segments, wrong sections, coverage."""

from __future__ import annotations

import re

import numpy as np
import pytest
from samples import SAMPLES
from truth import check_consistent, node_errors_m

import linear_ik
from linear_ik import Circle, Element, IShape, LShape, Rectangle, Scan, simulate
from linear_ik.assessment import by_chance
from linear_ik.bending import rigid_motion

SHAPES = ("rectangle", "i_shape", "circle", "l_shape")


def member(name: str, **fields) -> Element:
    return Element("member", SAMPLES[name], 2.5, **fields)


def right_of(element: Element) -> float:
    return float(element.profile.outline()[:, 0].max())


def uniform(element: Element, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([-0.5, -0.5, -0.2], [0.5, 0.5, 2.7], (10_000, 3))


def wall(element: Element, rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform([0, -2, -0.5], [0, 2, 3], (20_000, 3))
    points[:, 0] += right_of(element) + 0.3 + 0.001 * rng.standard_normal(len(points))
    return points


def floor(element: Element, rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform([-2, -2, 0], [2, 2, 0], (20_000, 3))
    points[:, 2] = 0.001 * rng.standard_normal(len(points))
    return points


ELSEWHERE = {
    "far away": lambda element, rng: rng.normal(size=(5000, 3)) + 100.0,
    "uniform": uniform,
    "one point": lambda element, rng: np.array([[right_of(element), 0.0, 1.0]]),
    "one point many times": lambda element, rng: np.repeat([[right_of(element), 0.0, 1.0]], 100, axis=0),
    "wall": wall,
    "floor": floor,
}


@pytest.mark.parametrize(("name", "start"), [("rectangle", "fixed"), ("i_shape", "free"), ("circle", "fixed")])
@pytest.mark.parametrize("what", ELSEWHERE)
def test_an_element_that_is_not_in_the_scan(what, name, start):
    element = member(name, start=start)
    points = ELSEWHERE[what](element, np.random.default_rng(0))
    result = linear_ik.fit(element, Scan(points))
    check_consistent(result)
    if what in ("wall", "floor"):
        # A flat surface within reach may be a face of a bent member: doubted where it is not refused.
        assert result.status in ("not_scanned", "uncertain", "max_iterations"), result.reasons
        assert result.reasons
        return
    assert result.status == "not_scanned", result.reasons
    assert len(result.reasons) >= 1 and "not in the scan" in result.reasons[0]
    assert [s.status for s in result.segments] == ["not_scanned"] * 10
    # The design comes back, as uncertain as a design is.
    T = element.placement.T_world_element
    np.testing.assert_allclose(result.nodes_m[-1], T[:3, 3] + 2.5 * T[:3, 2], atol=1e-12)
    assert np.sqrt(np.trace(result.nodes_covariance_m2[-1])) > 0.1


def test_only_a_neighbour_was_scanned():
    element = member("i_shape")
    neighbour = linear_ik.Placement((0.9, 0.0, 0.0))
    scan = simulate(Element("neighbour", SAMPLES["i_shape"], 2.5, placement=neighbour))
    assert linear_ik.fit(element, scan.without_truth()).status != "converged"


@pytest.mark.parametrize("bends", [[], ["3:y:10"], ["4:x:2", "8:y:3"]], ids=["straight", "knee", "slight"])
@pytest.mark.parametrize("name", SHAPES)
def test_the_half_that_nobody_scanned_is_named(name, bends):
    element = member(name)
    scan = simulate(element, bends=bends)
    result = linear_ik.fit(element, Scan(scan.points[scan.segment <= 5]))
    check_consistent(result)
    assert result.status == "uncertain"
    assert any("segments 6 to 10 not scanned" in reason for reason in result.reasons)
    assert [s.status for s in result.segments] == ["measured"] * 5 + ["not_scanned"] * 5
    assert all(s.points == 0 and s.coverage < 0.1 for s in result.segments[5:])
    assert node_errors_m(result, scan)[:6].max() < 0.001
    # The unseen tip is somewhere near the straight continuation, and says how near.
    deviation = np.sqrt(np.trace(result.nodes_covariance_m2, axis1=1, axis2=2))
    assert (np.diff(deviation[5:]) > 0).all() and deviation[-1] > 3 * deviation[5]
    if not bends:
        assert node_errors_m(result, scan)[-1] < 3 * deviation[-1]


@pytest.mark.parametrize("name", SHAPES)
def test_the_half_next_to_the_start_is_inferred(name):
    element = member(name)
    scan = simulate(element)
    result = linear_ik.fit(element, Scan(scan.points[scan.segment > 5]))
    assert result.status == "uncertain"
    assert [s.status for s in result.segments] == ["inferred"] * 5 + ["measured"] * 5
    assert any("segments 1 to 5 inferred" in reason for reason in result.reasons)
    assert node_errors_m(result, scan)[5:].max() < 0.002


@pytest.mark.parametrize("name", SHAPES)
def test_a_gap_is_inferred_from_both_sides(name):
    element = member(name)
    scan = simulate(element, bends=["2:x:3", "8:y:5"])
    result = linear_ik.fit(element, Scan(scan.points[(scan.segment < 5) | (scan.segment > 6)]))
    assert result.status == "uncertain"
    assert [s.status for s in result.segments] == ["measured"] * 4 + ["inferred"] * 2 + ["measured"] * 4
    assert any("segments 5 to 6 inferred" in reason for reason in result.reasons)
    assert node_errors_m(result, scan).max() < 0.001


@pytest.mark.parametrize("name", SHAPES)
def test_a_tenth_of_the_length_is_not_the_element(name):
    element = member(name)
    scan = simulate(element)
    result = linear_ik.fit(element, Scan(scan.points[scan.segment == 1]))
    assert result.status != "converged", result.reasons
    assert [s.status for s in result.segments[2:]] == ["not_scanned"] * 8
    # Where the other nine tenths went is anybody's guess, and said to be.
    deviation = np.sqrt(np.trace(result.nodes_covariance_m2, axis1=1, axis2=2))
    assert node_errors_m(result, scan)[-1] < 2 * deviation[-1]


def test_coverage_is_the_share_of_the_surface():
    element = member("rectangle")
    full = linear_ik.fit(element, simulate(element, bends=["8:y:22.5"]).without_truth())
    assert all(s.coverage > 0.97 for s in full.segments)
    assert abs(sum(s.points for s in full.segments) - 10_000) < 50
    one_face = linear_ik.fit(element, simulate(element, bends=["8:y:22.5"], missing=["+x"]).without_truth())
    # The face is 0.3 of 0.8 m around; 50 mm of it at either edge are within 2 % of the length.
    assert all(s.coverage == pytest.approx(1 - 0.2 / 0.8, abs=0.04) for s in one_face.segments)
    two_faces = linear_ik.fit(element, simulate(element, bends=["8:x:22.5"], missing=["+x", "+y"]).without_truth())
    assert all(s.coverage == pytest.approx(1 - 0.3 / 0.8, abs=0.04) for s in two_faces.segments)


def test_each_segment_has_its_own_residual():
    element = member("rectangle")
    scan = simulate(element, bends=["8:y:22.5"])
    points = scan.points.copy()
    rough = scan.segment == 4
    points[rough] += 0.001 * np.random.default_rng(8).standard_normal((rough.sum(), 3))
    rmse = [s.surface_rmse_m for s in linear_ik.fit(element, Scan(points)).segments]
    others = rmse[:3] + rmse[4:]
    assert np.mean(others) == pytest.approx(0.001, rel=0.05)
    assert rmse[3] == pytest.approx(0.001 * np.sqrt(2), rel=0.12)


@pytest.mark.parametrize(
    ("designed", "built"),
    [
        (Rectangle(0.1, 0.3), Rectangle(0.12, 0.36)),
        (Rectangle(0.1, 0.3), Rectangle(0.08, 0.24)),
        (Rectangle(0.1, 0.3), Rectangle(0.12, 0.3)),
        (Rectangle(0.1, 0.3), Rectangle(0.1, 0.36)),
        (Rectangle(0.1, 0.3), Rectangle(0.1, 0.24)),
        (Circle(0.15), Circle(0.18)),
        (Circle(0.15), Circle(0.12)),
        (IShape(0.3, 0.3, 0.011, 0.019), IShape(0.36, 0.36, 0.011, 0.019)),
        (IShape(0.3, 0.3, 0.011, 0.019), IShape(0.315, 0.315, 0.011, 0.019)),
        (LShape(0.15, 0.1, 0.012), LShape(0.18, 0.12, 0.012)),
    ],
    ids=lambda profile: "x".join(f"{v * 1000:.0f}" for v in vars(profile).values() if v),
)
@pytest.mark.parametrize("bends", [[], ["8:y:22.5"]], ids=["straight", "bent"])
def test_another_section_does_not_converge(designed, built, bends):
    scan = simulate(Element("built", built, 2.5), bends=bends)
    result = linear_ik.fit(Element("designed", designed, 2.5), scan.without_truth())
    check_consistent(result)
    assert result.status != "converged"
    assert result.reasons


@pytest.mark.parametrize(("width_m", "depth_m"), [(0.102, 0.306), (0.1, 0.297)])
def test_a_section_within_its_tolerance_is_measured_and_used(width_m, depth_m):
    scan = simulate(Element("built", Rectangle(width_m, depth_m), 2.5), bends=["8:y:22.5"])
    result = linear_ik.fit(member("rectangle"), scan.without_truth())
    assert result.status == "converged", result.reasons
    said = re.search(r"measures ([\d.]+) x ([\d.]+) mm", " ".join(result.reasons))
    assert said is not None, result.reasons
    assert [float(mm) for mm in said.groups()] == pytest.approx([1e3 * width_m, 1e3 * depth_m], abs=0.2)
    assert node_errors_m(result, scan).max() < 0.001


def test_a_start_that_is_not_where_it_is_held_is_said():
    element = member("rectangle")
    scan = simulate(element, displacement=rigid_motion((0.03, 0.0, 0.0)))
    result = linear_ik.fit(element, scan.without_truth())
    assert result.status == "uncertain"
    assert "start" in " ".join(result.reasons)


def test_a_start_beyond_its_tolerance_is_said():
    element = member("rectangle", start="free", placement_tolerance=linear_ik.PlacementTolerance(0.01, 2.0))
    scan = simulate(element, bends=["6:x:20"], displacement=rigid_motion((0.03, 0.0, 0.0)))
    result = linear_ik.fit(element, scan.without_truth())
    assert result.status == "uncertain"
    base = element.placement.T_world_element[:3, :3].T @ result.base_pose[:3, 3]
    assert np.abs(base).max() <= 0.01


def test_iterations_that_run_out_are_said():
    element = member("rectangle")
    settings = linear_ik.FitSettings(max_iterations=3)
    result = linear_ik.fit(element, simulate(element, bends=["8:y:45"]).without_truth(), settings)
    assert result.status == "max_iterations"
    assert result.iterations <= 3
    assert "iterations" in result.reasons[0]


def test_two_faces_across_from_each_other_hardly_show_what_is_across_them():
    element = member("rectangle")
    ratios = []
    # Errors of one scan go together: it takes many to tell a share.
    for seed in range(1, 13):
        scan = simulate(element, bends=["4:x:2"], missing=["+x", "-x"], seed=seed)
        result = linear_ik.fit(element, scan.without_truth())
        deviation = np.sqrt(np.diagonal(result.nodes_covariance_m2, axis1=1, axis2=2))[1:]
        assert deviation[:, 0].max() > 2 * deviation[:, 1].max()
        ratios.append(np.abs(result.nodes_m - scan.nodes_m)[1:, 0] / deviation[:, 0])
    # Said with the right size: 95 % within two deviations, as errors of a run go.
    assert np.mean(np.array(ratios) < 2.0) > 0.8


def test_what_the_scan_does_not_show_is_named():
    pipe = Element("pipe", Circle(0.05), 2.5)
    assert linear_ik.fit(pipe, simulate(pipe, bends=["8:y:10"]).without_truth()).unobservable == (
        "torsion: the section is round",
    )
    beam = Element("beam", Rectangle(0.1, 0.3), 2.5, start="free")
    whole = simulate(beam).points
    assert linear_ik.fit(beam, Scan(whole)).unobservable == ()
    # Without its ends nothing says where it lies along itself.
    middle = linear_ik.fit(beam, Scan(whole[(whole[:, 2] > 0.6) & (whole[:, 2] < 1.9)]))
    assert "the place along the axis" in middle.unobservable
    assert middle.status != "converged"


def test_a_tolerance_without_effect_is_said_whatever_the_status():
    element = member("rectangle", placement_tolerance=linear_ik.PlacementTolerance(0.01, 2.0), end_tolerance_m=0.01)
    found = linear_ik.fit(element, linear_ik.simulate(element, points=2000, seed=1))
    assert found.status == "converged"
    assert [reason.split()[0] for reason in found.reasons] == ["placement_tolerance", "end_tolerance_m"]
    away = linear_ik.fit(element, linear_ik.Scan(np.random.default_rng(0).uniform(90, 99, (500, 3))))
    assert away.status == "not_scanned"
    assert away.reasons[-2:] == found.reasons


@pytest.mark.parametrize(("radius_m", "expected"), [(None, 3.0), (10.0, 3.0), (0.004, (22.4**2 - 8.6**2) / 8.6**2)])
def test_more_lies_beside_a_thin_wire_by_chance_than_on_it(radius_m, expected):
    # Of the wire: 0 to 8.6 mm from the axis is within 4 deviations, from there to 22.4 mm within 16.
    assert by_chance(radius_m, 0.00115) == pytest.approx(expected, rel=0.02)


def test_a_length_in_millimetres_is_asked_about():
    scan = simulate(member("rectangle"), points=2000, seed=3)
    in_mm = Element("member", SAMPLES["rectangle"], 2500.0)
    result = linear_ik.fit(in_mm, scan.without_truth())
    assert result.status == "not_scanned" and "length_unit" in result.reason_codes, result.reasons
    assert "is it given in metres?" in result.reasons[result.reason_codes.index("length_unit")]
