"""Element, Placement and their checks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from linear_ik.element import Element, Placement, PlacementTolerance
from linear_ik.errors import ElementError
from linear_ik.profile import Rectangle

RECTANGLE = Rectangle(0.1, 0.3)
direction = st.tuples(*[st.floats(-1e3, 1e3)] * 3)


def beam(**changes: object) -> Element:
    return Element(**{"name": "beam", "profile": RECTANGLE, "length_m": 2.5, **changes})  # type: ignore[arg-type]


def test_defaults_are_the_contracts() -> None:
    element = beam()
    assert (element.segments, element.start, element.end) == (10, "fixed", "free")
    assert element.joint_limit_deg == (45.0, 45.0, 45.0)
    assert element.segment_length_m == 0.25
    np.testing.assert_array_equal(element.placement.T_world_element, np.eye(4))


def test_joint_limits_one_for_all_or_three() -> None:
    np.testing.assert_array_equal(beam(joint_limit_deg=[10, 20, 180]).joint_limit_rad, np.radians([10.0, 20.0, 180.0]))
    assert beam(joint_limit_deg=np.array([10, 20, 30])).joint_limit_deg == (10.0, 20.0, 30.0)
    assert beam(joint_limit_deg=30) == beam(joint_limit_deg=(30.0, 30.0, 30.0))


def test_numpy_numbers_become_plain_ones() -> None:
    element = beam(segments=np.int64(4), length_m=np.float32(0.5))
    assert type(element.segments) is int and type(element.length_m) is float


@given(axis=direction, ref=direction, location=direction)
def test_placement_is_a_right_handed_frame(axis: tuple, ref: tuple, location: tuple) -> None:
    assume(np.linalg.norm(axis) > 1e-6 and np.linalg.norm(ref) > 1e-6)
    sine = np.linalg.norm(np.cross(axis, ref)) / np.linalg.norm(axis) / np.linalg.norm(ref)
    assume(sine > 2e-6)
    T = Placement(location, axis, ref).T_world_element
    R = T[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_allclose(R[:, 2], np.array(axis) / np.linalg.norm(axis), atol=1e-14)
    assert R[:, 0] @ ref > 0 and abs(R[:, 1] @ ref) / np.linalg.norm(ref) < 1e-9
    assert tuple(T[:3, 3]) == location and T[3].tolist() == [0, 0, 0, 1]


@given(axis=direction)
def test_placement_without_a_reference_follows_ifc(axis: tuple) -> None:
    assume(np.linalg.norm(axis) > 1e-6)
    R = Placement(axis=axis).T_world_element[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1)


def test_vertical_and_horizontal_defaults() -> None:
    np.testing.assert_array_equal(Placement(axis=(0, 0, 5)).T_world_element[:3, 0], [1, 0, 0])
    np.testing.assert_array_equal(Placement(axis=(0, 2, 0)).T_world_element[:3, 0], [1, 0, 0])
    np.testing.assert_array_equal(Placement(axis=(3, 0, 0)).T_world_element[:3, 0], [0, 1, 0])


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"axis": (0, 0, 0)}, "placement.axis"),
        ({"axis": (0, 0, 1e-12)}, "placement.axis"),
        ({"axis": (0, 0)}, "placement.axis"),
        ({"axis": "abc"}, "placement.axis"),
        ({"axis": (0, 0, math.nan)}, "placement.axis"),
        ({"axis": (0, 0, True)}, "placement.axis"),
        ({"axis": (0, 0, 10**400)}, "placement.axis"),
        ({"location": (0, math.inf, 0)}, "placement.location"),
        ({"location": (0, 1e12, 0)}, "placement.location"),
        ({"location": None}, "placement.location"),
        ({"ref_direction": (0, 0, 0)}, "placement.ref_direction"),
        ({"ref_direction": (0, 0, -3)}, "placement.ref_direction"),
        ({"ref_direction": (1e-9, 0, 1)}, "placement.ref_direction"),
        ({"ref_direction": (1, 0)}, "placement.ref_direction"),
    ],
)
def test_impossible_placements_are_refused_by_name(values: dict, named: str) -> None:
    with pytest.raises(ElementError) as caught:
        Placement(**values)
    assert caught.value.subject == named and caught.value.expected


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"name": ""}, "name"),
        ({"name": "  "}, "name"),
        ({"name": 3}, "name"),
        ({"name": "x" * 201}, "name"),
        ({"name": "a\nb"}, "name"),
        ({"name": "a\ud800"}, "name"),
        ({"profile": "rectangle"}, "profile"),
        ({"profile": Rectangle}, "profile"),
        ({"placement": (0, 0, 0)}, "placement"),
        ({"placement_tolerance": 0.1}, "placement_tolerance"),
        ({"length_m": 0}, "length_m"),
        ({"length_m": -1}, "length_m"),
        ({"length_m": math.nan}, "length_m"),
        ({"length_m": 1e9}, "length_m"),
        ({"length_m": 10**400}, "length_m"),
        ({"length_m": "2.5"}, "length_m"),
        ({"length_m": True}, "length_m"),
        ({"segments": 0}, "segments"),
        ({"segments": 501}, "segments"),
        ({"segments": 10**8}, "segments"),
        ({"segments": 10**400}, "segments"),
        ({"segments": 2.5}, "segments"),
        ({"segments": True}, "segments"),
        ({"segments": 500, "length_m": 0.01}, "segments"),
        ({"start": "fixd"}, "start"),
        ({"end": None}, "end"),
        ({"start": ["fixed"]}, "start"),
        ({"joint_limit_deg": 0}, "joint_limit_deg"),
        ({"joint_limit_deg": 180.1}, "joint_limit_deg"),
        ({"joint_limit_deg": [45, 45]}, "joint_limit_deg"),
        ({"joint_limit_deg": [45, 45, -1]}, "joint_limit_deg"),
        ({"joint_limit_deg": "45"}, "joint_limit_deg"),
        ({"end_tolerance_m": 0}, "end_tolerance_m"),
        ({"density_kg_m3": -1}, "density_kg_m3"),
    ],
)
def test_impossible_elements_are_refused_by_name(values: dict, named: str) -> None:
    with pytest.raises(ElementError) as caught:
        beam(**values)
    assert caught.value.subject == named and caught.value.expected
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"translation_m": -1}, "placement_tolerance.translation_m"),
        ({"translation_m": math.inf}, "placement_tolerance.translation_m"),
        ({"rotation_deg": 181}, "placement_tolerance.rotation_deg"),
        ({"rotation_deg": "2"}, "placement_tolerance.rotation_deg"),
    ],
)
def test_impossible_tolerances_are_refused_by_name(values: dict, named: str) -> None:
    with pytest.raises(ElementError) as caught:
        PlacementTolerance(**values)
    assert caught.value.subject == named


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"start": "fixed"}, ["placement_tolerance"]),
        ({"start": "pinned"}, ["placement_tolerance"]),
        ({"start": "roller"}, ["rotation_deg"]),
        ({"start": "free"}, []),
        ({"start": "free", "end_tolerance_m": 0.001}, ["end_tolerance_m"]),
        ({"start": "free", "end_tolerance_m": 0.001, "end": "pinned"}, []),
    ],
)
def test_tolerances_without_effect_are_named(given, said):
    element = Element("e", Rectangle(0.1, 0.3), 2.5, placement_tolerance=PlacementTolerance(0.1, 1.0), **given)
    assert len(element.without_effect) == len(said)
    assert all(word in sentence for word, sentence in zip(said, element.without_effect, strict=True))
    usual = {key: value for key, value in given.items() if key in ("start", "end")}
    assert Element("e", Rectangle(0.1, 0.3), 2.5, **usual).without_effect == ()
