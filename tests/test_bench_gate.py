"""The gate of the benchmarks: what it lets through, and what a baseline keeps."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))

from benchlib import gate  # noqa: E402
from benchlib.gate import Metric  # noqa: E402


def finished(tmp_path: Path, *metrics: Metric, words: str = "--gate", **more: Any) -> int:
    parser = argparse.ArgumentParser()
    gate.add_arguments(parser)
    options = parser.parse_args([*words.split(), "--baseline", str(tmp_path / "b.json")])
    return gate.finish("b", "quick", metrics, options, **more)


def updated(tmp_path: Path, *metrics: Metric, **more: Any) -> None:
    assert finished(tmp_path, *metrics, words="--update-baseline", **more) == 0


def figures(tmp_path: Path) -> dict[str, Any]:
    found: dict[str, Any] = gate.read(tmp_path / "b.json")["b"]["quick"]["figures"]
    return found


@pytest.mark.parametrize(
    ("value", "better", "code"),
    [(1.19, "lower", 0), (1.21, "lower", 1), (0.1, "lower", 0), (0.81, "higher", 0), (0.79, "higher", 1)],
)
def test_gate_allows_the_stated_noise(tmp_path: Path, value: float, better: gate.Better, code: int) -> None:
    updated(tmp_path, Metric("m", 1.0, 0.2, better))
    assert finished(tmp_path, Metric("m", value, 0.2, better)) == code


def test_gate_takes_the_noise_of_the_baseline(tmp_path: Path) -> None:
    updated(tmp_path, Metric("m", 1.0, 0.1))
    assert finished(tmp_path, Metric("m", 1.5, 9.0)) == 1


def test_gate_is_closed_without_a_baseline_or_a_figure(tmp_path: Path) -> None:
    assert finished(tmp_path, Metric("m", 1.0, 0.1)) == 1
    updated(tmp_path, Metric("m", 1.0, 0.1))
    assert finished(tmp_path, Metric("other", 1.0, 0.1)) == 1
    assert finished(tmp_path, Metric("m", math.nan, 0.1)) == 1
    assert finished(tmp_path, Metric("m", 1.0, 0.1), Metric("new", 5.0, 0.1)) == 0


def test_a_target_that_was_met_must_stay_so(tmp_path: Path) -> None:
    updated(tmp_path, Metric("m", 0.24, 0.5, target=0.25), Metric("missed", 0.3, 0.5, target=0.25))
    missed = Metric("missed", 0.35, 0.5, target=0.25)
    assert finished(tmp_path, Metric("m", 0.25, 0.5), missed) == 0
    assert finished(tmp_path, Metric("m", 0.26, 0.5), missed) == 1


def test_the_gate_is_asked_before_the_baseline_is_renewed(tmp_path: Path) -> None:
    updated(tmp_path, Metric("m", 1.0, 0.1))
    assert finished(tmp_path, Metric("m", 1.2, 0.1), words="--gate --update-baseline") == 1
    assert figures(tmp_path)["m"]["value"] == 1.0
    assert finished(tmp_path, Metric("m", 1.05, 0.1), words="--gate --update-baseline") == 0
    assert figures(tmp_path)["m"]["value"] == 1.05


def test_a_partial_run_merges(tmp_path: Path) -> None:
    updated(tmp_path, Metric("a", 1.0, 0.1), Metric("b", 2.0, 0.1), made_with={"points": 5})
    updated(tmp_path, Metric("b", 3.0, 0.1), made_with={"points": 5}, partial=True)
    assert {name: entry["value"] for name, entry in figures(tmp_path).items()} == {"a": 1.0, "b": 3.0}
    assert finished(tmp_path, Metric("b", 3.0, 0.1), made_with={"points": 5}, partial=True) == 0
    assert finished(tmp_path, Metric("b", 3.0, 0.1), made_with={"points": 5}) == 1
    words = "--update-baseline"
    assert finished(tmp_path, Metric("b", 9.0, 0.1), words=words, made_with={"points": 6}, partial=True) == 1
    assert figures(tmp_path)["b"]["value"] == 3.0


def test_other_settings_are_not_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    updated(tmp_path, Metric("m", 1.0, 0.1), made_with={"seed": 1})
    assert finished(tmp_path, Metric("m", 1.0, 0.1), made_with={"seed": 2}) == 1
    assert "made with seed 1, this run with seed 2" in capsys.readouterr().err


def test_noise_is_the_spread_of_the_repeats() -> None:
    metric = gate.repeated("m", [0.8, 1.0, 1.3], target=2.0)
    assert (metric.value, metric.noise, metric.target) == (1.0, 0.5, 2.0) and "3 repeats" in metric.why
    assert gate.repeated("m", [1.0, 1.0, 1.01]).noise == gate.LEAST_NOISE
    assert "too few" in gate.repeated("m", [1.0]).why


def test_baseline_keeps_other_benchmarks(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    gate.update("a", "full", [Metric("m", 1.0, 0.1)], path)
    gate.update("b", "full", [Metric("m", 2.0, 0.1, target=3.0, why="x")], path, {"seed": 1})
    whole = gate.read(path)
    assert whole["a"]["full"]["figures"]["m"]["value"] == 1.0
    entry = {"value": 2.0, "noise": 0.1, "better": "lower", "target": 3.0, "why": "x"}
    assert whole["b"]["full"] == {"made with": {"seed": 1}, "figures": {"m": entry}}
    with pytest.raises(ValueError, match="not measured"):
        gate.update("a", "full", [Metric("m", math.nan, 0.1)], path)
