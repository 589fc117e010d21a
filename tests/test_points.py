"""What may be wrong with a scan's points: outliers, other units, lost digits, an error all share."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from samples import SAMPLES
from truth import node_errors_m

import linear_ik
from linear_ik import Element, FitSettings, Placement, Scan, SimulatedScan, simulate
from linear_ik.coordinates import coarse_step_m, unit_hint
from linear_ik.outliers import without_outliers

AT_MAP = Placement((512_345.678, 5_412_345.678, 321.5))


@cache
def among_outliers() -> tuple[Element, SimulatedScan, np.ndarray]:
    """A bent beam of 10,000 points among as many uniform ones."""
    element = Element("e", SAMPLES["rectangle"], 2.5)
    scan = simulate(element, bends=["8:x:22.5"])
    strays = np.random.default_rng(5).uniform([-0.5, -1.0, -0.2], [0.5, 1.0, 2.7], (10_000, 3))
    return element, scan, np.concatenate([scan.points, strays])


@pytest.mark.parametrize("removal", [False, True])
def test_half_the_points_may_be_outliers(removal: bool) -> None:
    element, scan, points = among_outliers()
    result = linear_ik.fit(element, Scan(points), FitSettings(outlier_removal=removal))
    assert node_errors_m(result, scan).max() < 0.001
    assert result.settings.outlier_removal is removal


def test_outliers_go_and_the_surface_stays() -> None:
    _, scan, points = among_outliers()
    points = np.concatenate([scan.points, points[len(scan) : len(scan) + 500]])
    kept = without_outliers(points)
    on_surface = np.isin(kept[:, 0], scan.points[:, 0]).sum()
    assert on_surface > 0.99 * len(scan) and len(kept) - on_surface < 0.2 * 500
    assert len(without_outliers(points[:20])) == 20


def test_an_error_that_all_points_share_moves_all_nodes_together() -> None:
    element = Element("e", SAMPLES["rectangle"], 2.5, placement=Placement((1, 2, 3), axis=(1, 2, 0)))
    scan = simulate(element, bends=["8:x:22.5"]).without_truth()
    without, stated = (linear_ik.fit(element, scan, FitSettings(systematic_error_m=s)) for s in (0.0, 0.003))
    added = stated.nodes_covariance_m2 - without.nodes_covariance_m2
    np.testing.assert_allclose(added, np.tile(9e-6 * np.eye(3), (11, 1, 1)), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(stated.nodes_m, without.nodes_m)
    assert stated.status == without.status and stated.settings.systematic_error_m == 0.003


@pytest.mark.parametrize(("unit", "factor"), [("millimetres", 1000.0), ("feet", 1 / 0.3048)])
def test_a_scan_in_other_units_is_told_so(unit: str, factor: float) -> None:
    element = Element("e", SAMPLES["rectangle"], 2.5, placement=Placement((12.0, 30.0, 3.0)))
    scan = Scan(simulate(element, points=2000).points * factor)
    result = linear_ik.fit(element, scan)
    assert result.status == "not_scanned"
    assert any(f"in {unit}" in reason for reason in result.reasons), result.reasons


def test_a_scan_that_is_elsewhere_is_in_no_unit() -> None:
    clump = np.random.default_rng(0).normal(size=(5000, 3)) + 100.0
    assert unit_hint(clump, np.eye(4), 2.5) is None
    assert unit_hint(np.full((5000, 3), 1e6), np.eye(4), 2.5) is None


def test_single_precision_at_map_coordinates_is_said() -> None:
    element = Element("e", SAMPLES["rectangle"], 2.5, placement=AT_MAP)
    points = simulate(element).points
    result = linear_ik.fit(element, Scan(points.astype(np.float32).astype(np.float64)))
    assert result.status != "converged"
    assert any("single precision, in steps of 500 mm" in reason for reason in result.reasons), result.reasons


def test_steps_of_single_precision() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3))
    single = points.astype(np.float32).astype(np.float64)
    assert coarse_step_m(single) is None  # near the origin it has digits enough
    assert coarse_step_m(points + 5e5) is None
    assert coarse_step_m((points + 5e5).astype(np.float32).astype(np.float64)) == 0.03125
    assert coarse_step_m(np.round(points + 5e5, 3)) is None  # millimetres, written as such
    # A thin beam along x whose y and z happen to be near a step of single precision.
    thin = points * [1.0, 0.05, 0.05] + [500001.3, 5400000.0, 2_000_000.0]
    for beam in (thin, np.round(thin, 3)):
        assert coarse_step_m(beam) is None
        assert coarse_step_m(np.round(beam.astype(np.float32).astype(np.float64), 2)) == 0.5


@pytest.mark.parametrize(
    ("name", "value"), [("outlier_removal", 1), ("outlier_removal", None), ("systematic_error_m", -1.0)]
)
def test_settings_are_checked(name: str, value: object) -> None:
    with pytest.raises(linear_ik.LinearIkError, match=name):
        FitSettings(**{name: value})  # type: ignore[arg-type]
