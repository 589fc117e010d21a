"""Which sides of a section were seen, told by the points: thin plates, corners, and faces that nobody saw."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import linear_ik
from linear_ik import Element, IShape, LShape, Rectangle, TShape, UShape, simulate
from linear_ik.chain import Chain
from linear_ik.correspondence import Matcher
from linear_ik.surface import Surface
from linear_ik.visible_sides import thin_plates

CHANNEL = UShape(depth=0.1, flange_width=0.05, web_thickness=0.006, flange_thickness=0.0085)
SEARCHED = linear_ik.FitSettings(search="always")


@pytest.mark.parametrize(
    ("profile", "thickness_mm"),
    [
        (CHANNEL, [6.0, 8.5, 8.5]),
        (IShape(0.1, 0.2, 0.0056, 0.0085), [5.6] + 4 * [8.5]),
        (TShape(0.14, 0.14, 0.015, 0.015), [15.0, 15.0, 15.0]),
        (LShape(0.1, 0.1, 0.01), [10.0, 10.0]),
        (Rectangle(0.02, 0.2), [20.0]),
        (Rectangle(0.1, 0.3), []),
    ],
    ids=lambda p: getattr(p, "type", ""),
)
def test_plates_are_pairs_of_faces_with_material_between(profile, thickness_mm) -> None:
    plates = thin_plates(Surface.of(profile), 0.02)
    assert sorted(1e3 * p.thickness_m for p in plates) == pytest.approx(thickness_mm)


@pytest.mark.parametrize("seed", range(1, 5))
@pytest.mark.parametrize("unseen", ["+y", "-y"])
def test_flanges_twice_as_thick_as_the_noise_are_seen_from_one_side(unseen, seed) -> None:
    """Without this they settle half their thickness, 4 mm, off, and the scatter looks like 2.5 mm."""
    element = Element("channel", CHANNEL, 2.4, segments=6)
    scan = simulate(element, bends=["4:x:3"], noise_m=0.0035, missing=[unseen], points=12_000, seed=seed)
    result = linear_ik.fit(element, scan.without_truth(), SEARCHED)
    assert np.abs((result.nodes_m - scan.nodes_m)[:, 1]).max() < 0.0015
    assert result.range_noise_m == pytest.approx(0.0035, rel=0.2)


def test_both_sides_stay_where_both_were_seen() -> None:
    element = Element("channel", CHANNEL, 2.4, segments=6)
    scan = simulate(element, bends=["4:x:3"], noise_m=0.0015, points=12_000, seed=1)
    result = linear_ik.fit(element, scan.without_truth(), SEARCHED)
    assert np.abs(result.nodes_m - scan.nodes_m).max() < 0.0006


def test_a_corner_shows_no_face_that_was_not_seen() -> None:
    """Noise takes points at a face's edges around the corner; they do not show where the beam lies along that face."""
    element = Element("beam", Rectangle(0.1, 0.3), 3.0)
    inside = []
    for seed in range(1, 5):
        scan = simulate(element, noise_m=0.004, missing=["+x", "+y", "-y"], seed=seed)
        result = linear_ik.fit(element, scan.without_truth(), SEARCHED)
        error, spread = (result.nodes_m - scan.nodes_m)[1:, :2], result.nodes_covariance_m2[1:, :2, :2]
        inside += (np.einsum("ki,kij,kj->k", error, np.linalg.inv(spread), error) < 5.99).tolist()
        assert np.sqrt(spread[:, 1, 1]).max() > 0.002
        assert result.status != "converged"
    assert np.mean(inside) > 0.85


@given(seed=st.integers(0, 1000), hidden=st.sets(st.integers(0, 7), min_size=1, max_size=7))
def test_no_point_is_given_to_a_face_that_nobody_saw(seed: int, hidden: set[int]) -> None:
    surface, rng = Surface.of(CHANNEL), np.random.default_rng(seed)
    element = Element("channel", CHANNEL, 2.4, segments=6)
    chain = Chain.of(element)
    pose = chain.pose(chain.with_q(rng.uniform(-0.1, 0.1, 18)))
    points = simulate(element, points=600, noise_m=0.003, seed=seed).points
    unseen = np.isin(np.arange(8), list(hidden))
    pairs = Matcher(surface, chain.segment_length_m, handicap_m2=np.where(unseen, np.inf, 0.0)).match(pose, points)
    assert not set(pairs.face) & hidden
    nearest = surface.faces(~unseen).distances(pairs.local[:, :2])
    np.testing.assert_allclose(np.abs(pairs.residual_m), nearest, atol=1e-9)


def test_a_last_column_of_points_before_an_edge_is_no_face_around_it() -> None:
    """As found on columns half behind a slab: the edge was moved to that column, 4 mm off, five stated deviations."""
    column = Element("column", IShape(0.24, 0.24, 0.010, 0.017), 3.6, start="free")
    for seed in range(4):
        rng = np.random.default_rng(seed)
        whole = simulate(column, points=6000, noise_m=0.0014, seed=seed).without_truth().points
        # The lower half shows one flange only, in a scanner's columns; the last are 4 mm before the edges.
        x, z = rng.choice(np.linspace(-0.116, 0.116, 49), 800), rng.uniform(0, 1.8, 800)
        lower = np.column_stack([x, 0.12 + 0.0014 * rng.standard_normal(800), z])
        result = linear_ik.fit(column, linear_ik.Scan(np.vstack([whole[whole[:, 2] > 1.8], lower])))
        off_m, sd_m = result.nodes_m[:, 0], np.sqrt(result.nodes_covariance_m2[:, 0, 0])
        assert (np.abs(off_m) < 3.0 * sd_m).all(), (seed, off_m)
