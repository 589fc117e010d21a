"""Gate: today's figures against the committed baseline.

Only figures that mean the same on every machine are gated: accuracies on seeded clouds,
iterations, ratios of times taken in turns, memory per point. Each has a noise in the
baseline, relative to its value: where a run repeats a figure, the spread of the
repeats; where that would take too long, a stated one and why. A figure falls behind
when it is worse by more than its noise, or misses a target that the baseline met. The
baseline is one file for all benchmarks:

    {"bench_peers": {"quick": {"made with": {"points": 2000},
                               "figures": {"fit / ICP": {"value": 0.2, "noise": 0.3, "why": ...}}}}}

A benchmark offers Metrics and calls `finish`; `--gate` and `--update-baseline` come with
`add_arguments`.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from benchlib.timing import say

Better = Literal["lower", "higher"]
Settings = Mapping[str, Any]

BASELINE = Path(__file__).parent.parent.parent / "benchmarks" / "baseline.json"
# Repeats of one run lie closer together than runs of two days do.
LEAST_NOISE = 0.1
SEEDED = "seeded clouds, one run: the allowance is for another machine's rounding and releases of the packages"


@dataclass(frozen=True)
class Metric:
    """A figure that must not get worse.

    Attributes:
        name: says what it is, with its unit.
        value: today's.
        noise: what it may differ by from run to run, relative to the value.
        better: which way is better.
        target: what the project wants it to be: once met, it must stay so.
        why: where the noise comes from.
    """

    name: str
    value: float
    noise: float
    better: Better = "lower"
    target: float | None = None
    why: str = SEEDED


def repeated(name: str, values: Sequence[float], better: Better = "lower", target: float | None = None) -> Metric:
    """Return the median of a figure's repeats, its noise the spread of the repeats."""
    value = statistics.median(values)
    spread = (max(values) - min(values)) / abs(value) if value else 0.0
    noise, why = max(LEAST_NOISE, spread), f"spread of {len(values)} repeats, at least {LEAST_NOISE:g}"
    if len(values) < 3:
        noise, why = 0.5, "times, too few repeats for a spread"
    return Metric(name, value, float(f"{noise:.2g}"), better, target, why)


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
    parser.add_argument(
        "--update-baseline",
        action="store_true",
        help="make this run's figures the baseline; with --gate only if none falls behind",
    )
    parser.add_argument("--baseline", type=Path, default=BASELINE, help="default: benchmarks/baseline.json")


def finish(
    benchmark: str,
    mode: str,
    metrics: Sequence[Metric],
    options: argparse.Namespace,
    made_with: Settings | None = None,
    partial: bool = False,
) -> int:
    """Compare and update as the command line asks, in this order, and return the exit code.

    Args:
        benchmark: such as "bench_peers".
        mode: such as "quick": figures are compared with those of the same mode.
        metrics: of this run.
        options: the parsed command line, with what `add_arguments` added.
        made_with: settings that the figures depend on: compared only with a baseline of the same.
        partial: whether the run was asked for some of its figures only: the others are
            neither missed nor dropped.
    """
    for metric in metrics:
        # Few seeds and few points reach no target, and show nothing by it.
        if metric.target is not None and mode == "full":
            word = "met" if met(metric.value, metric.target, metric.better) else "missed"
            say(f"target: {metric.name}: {metric.value:.3g}, wanted {metric.target:g}: {word}")
    made_with = plain(made_with)
    if options.gate:
        verdicts = compare(metrics, read(options.baseline).get(benchmark, {}).get(mode, {}), made_with, partial)
        for verdict in verdicts:
            say(f"gate: {'ok    ' if verdict.passed else 'BEHIND'} {verdict.sentence}")
        if not all(v.passed for v in verdicts):
            if options.update_baseline:
                say(f"baseline: {options.baseline}: left as it was")
            return 1
    if options.update_baseline:
        try:
            update(benchmark, mode, metrics, options.baseline, made_with, partial)
        except ValueError as error:
            say(f"baseline: {error}")
            return 1
        say(f"baseline: {options.baseline}: {len(metrics)} figures of {benchmark} ({mode})")
    return 0


def met(value: float, target: float, better: str) -> bool:
    """Whether a value reaches a target; one that was not measured does not."""
    return value <= target if better == "lower" else value >= target


def compare(
    metrics: Sequence[Metric], baseline: Mapping[str, Any], made_with: Settings | None = None, partial: bool = False
) -> list[Verdict]:
    """Return one verdict for each figure of the baseline, and for each that it does not have.

    An empty baseline passes nothing: a gate without one would be open. Nor does one that
    was made with other settings: it would compare what is not alike.
    """
    figures = baseline.get("figures", {})
    if not figures:
        return [Verdict("baseline", False, "no baseline for this benchmark and mode (make one with --update-baseline)")]
    if baseline["made with"] != plain(made_with):
        sentence = f"the baseline was made with {told(baseline['made with'])}, this run with {told(plain(made_with))}"
        return [Verdict("baseline", False, sentence)]
    today = {m.name: m for m in metrics}
    verdicts = []
    for name, entry in figures.items():
        metric = today.pop(name, None)
        if metric is None and partial:
            continue
        if metric is None or math.isnan(metric.value):
            verdicts.append(Verdict(name, False, f"{name}: not measured, the baseline has {entry['value']:.4g}"))
            continue
        verdicts.append(judged(metric, entry))
    return verdicts + [Verdict(name, True, f"{name}: {m.value:.4g}, not in the baseline") for name, m in today.items()]


def judged(metric: Metric, entry: Mapping[str, Any]) -> Verdict:
    """Return the verdict on one figure beside its entry in the baseline."""
    value, noise, better, target = float(entry["value"]), float(entry["noise"]), entry["better"], entry["target"]
    limit = value + (1 if better == "lower" else -1) * noise * abs(value)
    text = (
        f"{metric.name}: {metric.value:.4g}, baseline {value:.4g}, "
        f"allowed {'up' if better == 'lower' else 'down'} to {limit:.4g}"
    )
    if target is not None and met(value, target, better) and not met(metric.value, target, better):
        return Verdict(metric.name, False, f"{text}; the target {target:g} was met and is lost")
    return Verdict(metric.name, met(metric.value, limit, better), text)


def plain(settings: Settings | None) -> dict[str, Any]:
    """Return settings as the file gives them back."""
    found: dict[str, Any] = json.loads(json.dumps(dict(settings or {})))
    return found


def told(settings: Settings) -> str:
    """Return settings in words."""
    return ", ".join(f"{name} {value}" for name, value in settings.items()) or "no settings"


def read(path: Path) -> dict[str, Any]:
    """Return the baseline, empty where there is no file."""
    if not path.exists():
        return {}
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def update(
    benchmark: str,
    mode: str,
    metrics: Sequence[Metric],
    path: Path,
    made_with: Settings | None = None,
    partial: bool = False,
) -> None:
    """Replace the figures of one benchmark and mode in the baseline, and leave the others.

    Args:
        benchmark: see `finish`.
        mode: see `finish`.
        metrics: see `finish`.
        path: of the baseline.
        made_with: see `finish`.
        partial: leave the figures of this benchmark and mode that are not among ``metrics``.

    Raises:
        ValueError: a figure was not measured, or a partial run has other settings than the rest.
    """
    whole = read(path)
    before = whole.get(benchmark, {}).get(mode, {})
    made_with = plain(made_with)
    if partial and before and before["made with"] != made_with:
        raise ValueError(f"the rest was made with {told(before['made with'])}, this part with {told(made_with)}")
    entries = dict(before.get("figures", {})) if partial else {}
    for metric in metrics:
        if math.isnan(metric.value):
            raise ValueError(f"{metric.name}: not measured; no baseline without it")
        entry = asdict(metric)
        del entry["name"]
        entries[metric.name] = {**entry, "value": float(f"{metric.value:.5g}")}
    whole.setdefault(benchmark, {})[mode] = {"made with": made_with, "figures": entries}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(whole, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
