"""Doubts that the shape of a fit and the thickness of its plates raise."""

from __future__ import annotations

import numpy as np
import pytest

import linear_ik
from linear_ik import Chain, Element, IShape, Rectangle, Scan, TShape, scan_virtually
from linear_ik.bending import bend_element
from linear_ik.doubts import beside_all_along, stepped_aside

BEAM = Element("beam", Rectangle(0.1, 0.3), 3.0, 10)


def pose_of(*bends: str):
    chain = Chain.of(BEAM)
    return chain.pose(chain.with_q(bend_element(BEAM, bends).q))


@pytest.mark.parametrize(
    ("bends", "where"),
    [
        (("2:y:30", "3:y:-30"), (1, 1)),
        (("3:x:36", "5:x:-45", "6:x:9", "9:y:2"), (2, 3)),
        (("1:x:30", "2:x:-30"), (0, 0)),
    ],
)
def test_a_step_aside_is_seen(bends, where):
    first, last, aside_m = stepped_aside(pose_of(*bends))
    assert (first, last) == where
    assert 0.14 < aside_m < 0.5


@pytest.mark.parametrize(
    "bends",
    [
        (),
        ("5:y:45",),
        ("3:y:20", "5:x:-20"),
        ("3:y:20", "4:y:20"),
        ("2:x:4.7", "6:x:-9.4", "10:x:4.7"),
        tuple(f"{k}:y:{10 * (-1) ** k}" for k in range(2, 11)),
    ],
    ids=["straight", "knee", "two axes", "arc", "sag", "zigzag"],
)
def test_and_nothing_else_is(bends):
    assert stepped_aside(pose_of(*bends)) is None


@pytest.mark.parametrize(
    ("profile", "noise_m", "doubted"),
    [(TShape(0.1, 0.1, 0.011, 0.011), 0.0045, True), (IShape(0.3, 0.3, 0.011, 0.019), 0.0015, False)],
    ids=["thin", "thick"],
)
def test_plates_as_thin_as_the_noise_are_said_where_both_sides_were_seen_and_no_station_tells(
    profile, noise_m, doubted
):
    element, stations = Element("thin", profile, 2.0, 6), [[4, 1, 1.6], [-4, -1, 1.6]]
    scan = scan_virtually(element, stations=stations, bends=["4:y:11"], range_noise_m=noise_m, points=6000, seed=1)
    for told, given in ((True, scan.without_truth()), (False, Scan(scan.points))):
        said = any("thin plates" in reason for reason in linear_ik.fit(element, given).reasons)
        assert said == (doubted and not told)


@pytest.mark.parametrize("seed", range(1, 5))
def test_plates_as_thin_as_the_noise_are_right_where_one_side_was_seen(seed):
    """From one station; at half their thickness, 5 mm, it settled before, or doubted."""
    element = Element("thin", TShape(0.1, 0.1, 0.011, 0.011), 2.0, 6)
    scan = scan_virtually(
        element, stations=[[4, 1, 1.6]], bends=["4:y:11"], range_noise_m=0.0045, points=6000, seed=seed
    )
    result = linear_ik.fit(element, Scan(scan.points))
    assert np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1).max() < 0.0012
    assert result.status == "converged", result.reasons


def test_a_thin_plate_is_wrong_or_doubted():
    element = Element("thin", TShape(0.1, 0.1, 0.011, 0.011), 2.0, 6)
    for seed in range(1, 5):
        scan = scan_virtually(
            element, stations=[[4, 1, 1.6]], bends=["5:y:11"], range_noise_m=0.0045, points=6000, seed=seed
        )
        result = linear_ik.fit(element, Scan(scan.points))
        error_m = np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1).max()
        assert error_m < 0.0015 or result.status != "converged"


@pytest.mark.parametrize(
    ("beside", "share"),
    [
        ([10, 10, 10, 10], 0.0),  # noise and mixed pixels
        ([10, 900, 10, 10], 0.0),  # a bracket at one segment
        ([150, 150, 150, 0], pytest.approx(150 / 1150)),
        ([0, 0, 0, 0], 0.0),
    ],
)
def test_points_beside_a_surface_are_a_doubt_where_they_run_all_along_it(beside, share):
    assert beside_all_along(np.full(4, 1000), np.array(beside)) == share


def test_an_unseen_element_has_nothing_beside_it():
    assert beside_all_along(np.zeros(4, dtype=int), np.zeros(4, dtype=int)) == 0.0
