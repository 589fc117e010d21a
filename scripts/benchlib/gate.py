"""Gate: today's figures against the committed baseline.

Only figures that mean the same on every machine are gated: accuracies on seeded clouds,
iterations, ratios of times taken in turns, memory per point. Each has a noise stated
with it in the baseline, relative to its value, and falls behind when it is worse by more
than that. The baseline is one file for all benchmarks:

    {"bench_peers": {"quick": {"fit / ICP": {"value": 0.2, "noise": 0.3, "better": "lower"}}}}

A benchmark offers Metrics and calls `finish`; `--gate` and `--update-baseline` come with
`add_arguments`.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from benchlib.timing import say

Better = Literal["lower", "higher"]

BASELINE = Path(__file__).parent.parent.parent / "benchmarks" / "baseline.json"


@dataclass(frozen=True)
class Metric:
    """A figure that must not get worse.

    Attributes:
        name: says what it is, with its unit.
        value: today's.
        noise: what it may differ by from run to run, relative to the value.
        better: which way is better.
        target: what the project wants it to be; reported, not gated.
    """

    name: str
    value: float
    noise: float
    better: Better = "lower"
    target: float | None = None


@dataclass(frozen=True)
class Verdict:
    """One figure beside its baseline.

    Attributes:
        name: of the metric.
        passed: not behind the baseline by more than its noise; True where there is none.
        sentence: for people.
    """

    name: str
    passed: bool
    sentence: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --gate, --update-baseline and --baseline to a benchmark's command line."""
    parser.add_argument("--gate", action="store_true", help="exit 1 when a figure falls behind the baseline")
    parser.add_argument("--update-baseline", action="store_true", help="make this run's figures the baseline")
    parser.add_argument("--baseline", type=Path, default=BASELINE, help="default: benchmarks/baseline.json")


def finish(benchmark: str, mode: str, metrics: Sequence[Metric], options: argparse.Namespace) -> int:
    """Compare or update as the command line asks, and return the exit code.

    Args:
        benchmark: such as "bench_peers".
        mode: such as "quick": figures are compared with those of the same mode.
        metrics: of this run.
        options: the parsed command line, with what `add_arguments` added.
    """
    for metric in metrics:
        if metric.target is not None:
            word = "met" if met(metric) else "missed"
            say(f"target: {metric.name}: {metric.value:.3g}, wanted {metric.target:g}: {word}")
    if options.update_baseline:
        update(benchmark, mode, metrics, options.baseline)
        say(f"baseline: {options.baseline}: {len(metrics)} figures of {benchmark} ({mode})")
    if not options.gate:
        return 0
    verdicts = compare(metrics, read(options.baseline).get(benchmark, {}).get(mode, {}))
    for verdict in verdicts:
        say(f"gate: {'ok    ' if verdict.passed else 'BEHIND'} {verdict.sentence}")
    return 0 if all(v.passed for v in verdicts) else 1


def met(metric: Metric) -> bool:
    """Whether a metric reaches its target."""
    if metric.target is None or math.isnan(metric.value):
        return False
    return metric.value <= metric.target if metric.better == "lower" else metric.value >= metric.target


def compare(metrics: Sequence[Metric], baseline: dict[str, dict[str, Any]]) -> list[Verdict]:
    """Return one verdict for each figure of the baseline, and for each that it does not have.

    An empty baseline passes nothing: a gate without one would be open.
    """
    if not baseline:
        return [Verdict("baseline", False, "no baseline for this benchmark and mode (make one with --update-baseline)")]
    today = {m.name: m for m in metrics}
    verdicts = []
    for name, entry in baseline.items():
        metric = today.pop(name, None)
        if metric is None or math.isnan(metric.value):
            verdicts.append(Verdict(name, False, f"{name}: not measured, the baseline has {entry['value']:.4g}"))
            continue
        value, noise, lower = float(entry["value"]), float(entry["noise"]), entry["better"] == "lower"
        limit = value + (1 if lower else -1) * noise * abs(value)
        passed = metric.value <= limit if lower else metric.value >= limit
        text = f"{name}: {metric.value:.4g}, baseline {value:.4g}, allowed {'up' if lower else 'down'} to {limit:.4g}"
        verdicts.append(Verdict(name, passed, text))
    return verdicts + [Verdict(name, True, f"{name}: {m.value:.4g}, not in the baseline") for name, m in today.items()]


def read(path: Path) -> dict[str, Any]:
    """Return the baseline, empty where there is no file."""
    if not path.exists():
        return {}
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def update(benchmark: str, mode: str, metrics: Sequence[Metric], path: Path) -> None:
    """Replace the figures of one benchmark and mode in the baseline, and leave the others."""
    whole = read(path)
    entries = {}
    for metric in metrics:
        if math.isnan(metric.value):
            raise ValueError(f"{metric.name}: not measured; no baseline without it")
        entry = asdict(metric)
        del entry["name"]
        entries[metric.name] = {**entry, "value": float(f"{metric.value:.5g}")}
    whole.setdefault(benchmark, {})[mode] = entries
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(whole, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
