"""The fit on simulated scans: what it finds, wherever the member stands and however it bends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import SAMPLES
from truth import check_consistent, node_errors_m

import linear_ik
from linear_ik import Bend, Element, FitSettings, Placement, Scan, simulate
from linear_ik.errors import SettingsError

WITHIN_M = 0.001
BEAM = Element("beam", SAMPLES["rectangle"], 2.5)


def fit_of(element, fit_settings=None, **scene):
    """A fit without the truth, and the scan with it."""
    scan = simulate(element, **scene)
    result = linear_ik.fit(element, scan.without_truth(), fit_settings)
    check_consistent(result)
    return result, scan


def assert_found(result, scan, within_m=WITHIN_M):
    assert result.status == "converged", result.reasons
    assert node_errors_m(result, scan).max() <= within_m


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("name", SAMPLES)
def test_every_profile(name, axis):
    element = Element("member", SAMPLES[name], 2.5)
    assert_found(*fit_of(element, bends=[Bend(8, axis, 22.5)]))


@pytest.mark.parametrize(
    "bends",
    [
        ["6:x:60"],
        ["6:y:60"],
        ["1:x:60"],
        ["3:y:-60"],
        ["10:x:60"],
        [f"{k}:x:9" for k in range(1, 11)],
        [f"{k}:y:-9" for k in range(1, 11)],
        [f"{k}:{axis}:{degrees}" for k in range(1, 11) for axis, degrees in (("x", 9), ("z", 3))],
        ["3:x:20", "5:y:-25", "7:z:10"],
        ["8:x:22.5", "8:y:15", "8:z:8"],
    ],
    ids=lambda bends: f"{bends[0]}..{bends[-1]}" if len(bends) > 3 else " ".join(bends),
)
@pytest.mark.parametrize("name", ["rectangle", "i_shape"])
def test_bends_of_every_kind(name, bends):
    element = Element("member", SAMPLES[name], 2.5, joint_limit_deg=90)
    assert_found(*fit_of(element, bends=bends))


@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.sampled_from([(0.0, 0.0, 0.0), (512_345.678, 5_403_210.123, 412.5), (-3.9e6, 4.1e6, 3.2e6)]),
)
def test_anywhere_on_earth_in_any_orientation(quaternion, location):
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    axis = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    ref = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    element = replace(BEAM, placement=Placement(location, axis, ref))
    result, scan = fit_of(element, bends=["8:y:22.5", "3:x:5"])
    assert_found(result, scan)
    # What the place on Earth takes away is the coordinates' last digits only.
    home, home_scan = fit_of(BEAM, bends=["8:y:22.5", "3:x:5"])
    assert np.abs(node_errors_m(result, scan) - node_errors_m(home, home_scan)).max() < 2e-6


@pytest.mark.parametrize("segments", [1, 2, 3, 30])
def test_numbers_of_segments(segments):
    element = replace(BEAM, segments=segments)
    bends = [Bend(max(1, 8 * segments // 10), "y", 22.5), Bend(1, "x", 2.0)]
    result, scan = fit_of(element, bends=bends)
    assert_found(result, scan)
    assert result.nodes_m.shape == (segments + 1, 3)


def test_every_iteration_is_told_as_it_is_kept():
    heard = []
    scan = simulate(BEAM, bends=["8:y:22.5"], missing=["+x", "+y"])
    result = linear_ik.fit(BEAM, scan.without_truth(), on_iteration=heard.append)
    assert len(heard) == result.iterations == len(result.history) > 5
    assert all(a is b for a, b in zip(heard, result.history, strict=True))
    assert [record.iteration for record in heard] == list(range(1, len(heard) + 1))
    lower, upper = result.joint_limits_rad[:, ::-1, 0].ravel(), result.joint_limits_rad[:, ::-1, 1].ravel()
    for record in heard:
        assert record.q.shape == (30,) and record.base_pose.shape == (4, 4)
        assert ((record.q >= lower) & (record.q <= upper)).all()
        assert record.points >= 0 and record.step_rad >= 0
    # What was handed out is nobody's working memory.
    assert len({record.q.ctypes.data for record in heard}) == len(heard)
    np.testing.assert_allclose(heard[-1].q, result.q, atol=np.radians(0.05))


def test_an_error_in_the_listener_is_the_callers():
    def stop(record):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        linear_ik.fit(BEAM, simulate(BEAM).without_truth(), on_iteration=stop)


@pytest.mark.parametrize("missing", [[], ["+x", "+y"]], ids=["all faces", "half the faces"])
def test_the_same_seed_gives_the_same_bits(missing):
    scan = simulate(BEAM, bends=["8:y:22.5"], missing=missing).without_truth()
    one, other = (linear_ik.fit(BEAM, scan) for _ in range(2))
    for name in ("nodes_m", "nodes_covariance_m2", "q", "base_pose"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert (one.rmse_m, one.surface_rmse_m, one.range_noise_m) == (
        other.rmse_m,
        other.surface_rmse_m,
        other.range_noise_m,
    )
    assert one.segments == other.segments and one.iterations == other.iterations
    another = linear_ik.fit(BEAM, scan, FitSettings(seed=7))
    assert np.abs(another.nodes_m - one.nodes_m).max() < 0.0003


def test_the_scan_comes_back_as_it_was():
    scan = simulate(BEAM, bends=["8:y:22.5"])
    points = scan.points.copy()
    scan.points.setflags(write=False)
    linear_ik.fit(BEAM, scan)
    assert points.tobytes() == scan.points.tobytes()


@pytest.mark.parametrize("missing", [[], ["+x", "+y"]], ids=["all faces", "half the faces"])
def test_the_truth_and_normals_change_nothing(missing):
    scan = simulate(BEAM, bends=["8:y:22.5"], missing=missing)
    flipped = scan.surface_normals * np.random.default_rng(1).choice([-1.0, 1.0], (len(scan), 1))
    bare = linear_ik.fit(BEAM, scan.without_truth())
    for other in (Scan(scan.points, flipped), scan):
        assert linear_ik.fit(BEAM, other).nodes_m.tobytes() == bare.nodes_m.tobytes()


@pytest.mark.parametrize("missing", [[], ["+x", "+y"]], ids=["all faces", "half the faces"])
def test_stations_that_saw_nothing_of_it_are_not_used_and_that_is_said(missing):
    scan = simulate(BEAM, bends=["8:y:22.5"], missing=missing)
    lie = Scan(scan.points, None, np.array([[9.0, 9.0, 9.0]]), np.zeros(len(scan), dtype=np.int32))
    result, bare = linear_ik.fit(BEAM, lie), linear_ik.fit(BEAM, scan.without_truth())
    assert result.nodes_m.tobytes() == bare.nodes_m.tobytes()
    assert result.status == "uncertain" and any("stations were not used" in reason for reason in result.reasons)


@pytest.mark.parametrize("missing", [[], ["+x", "+y"]], ids=["all faces", "half the faces"])
def test_the_order_of_the_points_does_not_matter(missing):
    scan = simulate(BEAM, bends=["8:y:22.5"], missing=missing)
    result = linear_ik.fit(BEAM, scan.without_truth())
    order = np.random.default_rng(3).permutation(len(scan))
    for rows in (order, np.arange(len(scan))[::-1], np.argsort(scan.points[:, 2])):
        other = linear_ik.fit(BEAM, Scan(scan.points[rows]))
        assert other.status == result.status == "converged"
        assert np.abs(other.nodes_m - result.nodes_m).max() < 0.0003


@pytest.mark.parametrize("limit_deg", [90, 20], ids=["free", "at the limit"])
def test_another_solver_finds_the_same(limit_deg):
    qpsolvers = pytest.importorskip("qpsolvers")
    names = [name for name in ("daqp", "quadprog", "proxqp", "clarabel", "piqp") if name in qpsolvers.available_solvers]
    member = replace(BEAM, joint_limit_deg=limit_deg)
    scan = simulate(replace(BEAM, joint_limit_deg=90), bends=["8:y:22.5"]).without_truth()
    result = linear_ik.fit(member, scan)
    for name in [*names[:1], "osqp"]:
        other = linear_ik.fit(member, scan, FitSettings(solver=name))
        check_consistent(other)
        assert np.abs(other.nodes_m - result.nodes_m).max() < 1e-5, name
        assert other.status == result.status


def test_a_solver_nobody_knows_is_named_with_those_there_are():
    with pytest.raises(SettingsError, match="osqp"):
        linear_ik.fit(BEAM, simulate(BEAM).without_truth(), FitSettings(solver="oskp"))


@pytest.mark.parametrize("search", ["always", "never"])
def test_search_can_be_forced_and_forbidden(search):
    result, scan = fit_of(BEAM, FitSettings(search=search), bends=["8:y:22.5"])
    assert_found(result, scan)
    assert ("search" in {record.phase for record in result.history}) == (search == "always")
    assert ("search" in result.timings_s) == (search == "always")


def test_a_clean_scan_needs_no_search():
    result, scan = fit_of(BEAM, bends=["8:y:22.5"])
    assert_found(result, scan)
    assert "search" not in {record.phase for record in result.history}


def test_without_a_search_a_wrong_face_is_not_called_right():
    result, scan = fit_of(BEAM, FitSettings(search="never"), bends=["8:x:22.5"], missing=["+x", "+y"])
    assert result.status != "converged" or node_errors_m(result, scan).max() <= WITHIN_M


@pytest.mark.parametrize("name", ["rectangle", "i_shape", "circle", "l_shape"])
@pytest.mark.parametrize("share", [0.05, 0.5])
def test_outliers(name, share):
    element = Element("member", SAMPLES[name], 2.5)
    scan = simulate(element, bends=["8:y:22.5", "3:x:4"])
    rng = np.random.default_rng(5)
    low, high = scan.points.min(axis=0) - 0.3, scan.points.max(axis=0) + 0.3
    outliers = rng.uniform(low, high, (int(share * len(scan)), 3))
    result = linear_ik.fit(element, Scan(np.concatenate([scan.points, outliers])))
    assert_found(result, scan)
    assert result.surface_rmse_m < 0.0015


@pytest.mark.parametrize("name", ["rectangle", "i_shape", "circle"])
def test_a_wall_beside_the_member(name):
    element = Element("member", SAMPLES[name], 2.5)
    scan = simulate(element, bends=["8:x:10", "3:x:4"])
    rng = np.random.default_rng(6)
    wall = np.column_stack([np.zeros(10_000), rng.uniform(-1, 1, 10_000), rng.uniform(-0.2, 2.7, 10_000)])
    wall[:, 0] += element.profile.outline()[:, 0].max() + 0.05 + 0.001 * rng.standard_normal(10_000)
    assert_found(linear_ik.fit(element, Scan(np.concatenate([scan.points, wall]))), scan)


def test_noise_is_estimated():
    for noise_m in (0.0002, 0.001, 0.003):
        result, scan = fit_of(BEAM, bends=["8:y:22.5"], noise_m=noise_m)
        assert result.range_noise_m == pytest.approx(noise_m, rel=0.1)
        assert_found(result, scan, WITHIN_M * max(1.0, noise_m / 0.001))


def test_a_scan_without_noise_is_fitted_exactly():
    result, scan = fit_of(BEAM, bends=["8:y:22.5"], noise_m=0.0)
    assert_found(result, scan, 2e-5)


def test_few_points_are_enough_and_many_are_better():
    for points, within_m in ((600, 0.003), (100_000, 0.00015)):
        result, scan = fit_of(BEAM, bends=["8:y:22.5"], points=points)
        assert_found(result, scan, within_m)
