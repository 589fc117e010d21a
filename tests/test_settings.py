"""Settings of a fit: what is taken, what is refused, and what is said then."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from linear_ik.errors import SettingsError
from linear_ik.settings import TERM_WEIGHTS, FitSettings, TermWeights


def test_the_defaults_are_settings() -> None:
    settings = FitSettings()
    assert (settings.method, settings.search, settings.solver) == ("default", "auto", "osqp")
    assert settings.weights == TERM_WEIGHTS["default"]
    # No term that would bend the result.
    assert settings.weights.continuity == settings.weights.directional == 0


def test_the_papers_method_has_weights_of_its_own() -> None:
    paper = FitSettings(method="icpik")
    assert paper.weights == TERM_WEIGHTS["icpik"] and min(paper.weights) > 0
    assert FitSettings(method="icpik", continuity=0.5).weights == paper.weights._replace(continuity=0.5)
    assert FitSettings(damping=0, directional=2).weights == TermWeights(0, 0, 2)


def test_settings_are_values() -> None:
    assert FitSettings(seed=3) == FitSettings(seed=3) != FitSettings(seed=4)
    with pytest.raises(dataclasses.FrozenInstanceError):
        FitSettings().seed = 1  # type: ignore[misc]
    assert dataclasses.replace(FitSettings(method="icpik"), seed=5).weights == TERM_WEIGHTS["icpik"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_iterations", 1),
        ("max_iterations", 10**6),
        ("range_noise_m", 0.002),
        ("range_noise_m", None),
        ("damping", 0),
        ("damping", 1e-3),
        ("continuity", 1.0),
        ("directional", 0.0),
        ("max_step_rad", math.pi),
        ("search", "always"),
        ("search", "never"),
        ("method", "icpik"),
        ("seed", 0),
        ("seed", 2**63),
        ("seed", np.int64(7)),
        ("max_iterations", np.int32(50)),
        ("range_noise_m", np.float64(0.003)),
    ],
)
def test_what_is_taken(name: str, value: object) -> None:
    assert getattr(FitSettings(**{name: value}), name) == value  # type: ignore[arg-type]


NO_NUMBERS = [math.nan, math.inf, -math.inf, -1, "1", [1], {}, True, 1e300]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda v: repr(v)[:6])
@pytest.mark.parametrize(
    "name", ["max_iterations", "range_noise_m", "damping", "continuity", "directional", "max_step_rad", "seed"]
)
def test_what_is_no_such_number_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(SettingsError) as raised:
        FitSettings(**{name: value})  # type: ignore[arg-type]
    assert raised.value.subject == name and repr(value)[:20] in raised.value.what
    assert raised.value.expected and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_iterations", 0),
        ("max_iterations", None),
        ("max_iterations", 2.5),
        ("max_iterations", 10**6 + 1),
        ("range_noise_m", 0),
        ("range_noise_m", 2.0),
        ("max_step_rad", 0.0),
        ("max_step_rad", 4.0),
        ("max_step_rad", None),
        ("seed", 1.0),
        ("seed", None),
        ("seed", 2**64),
    ],
)
def test_limits_of_the_ranges(name: str, value: object) -> None:
    with pytest.raises(SettingsError, match=name):
        FitSettings(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("value", ["", "Auto", None, 1, [], "sometimes"])
@pytest.mark.parametrize(("name", "choices"), [("search", "auto, always, never"), ("method", "default, icpik")])
def test_a_wrong_choice_is_told_the_right_ones(name: str, choices: str, value: object) -> None:
    with pytest.raises(SettingsError) as raised:
        FitSettings(**{name: value})  # type: ignore[arg-type]
    assert raised.value.subject == name and choices in raised.value.expected
