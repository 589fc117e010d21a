"""The tables of `bench_peers`: runs beside each other, what they show, and the figures that the gate watches."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from benchlib.gate import Metric, repeated
from benchlib.methods.registry import ICP, LEAST_SQUARES, OURS, Method
from benchlib.peer_clouds import Cloud
from benchlib.reports import shown


@dataclass
class Runs:
    """What one method answered, round by round.

    Attributes:
        method: which.
        rounds: the rounds it ran in.
        answers: of `peer_job`.
        remark: why there is no answer, or fewer than rounds.
    """

    method: Method
    rounds: list[int] = field(default_factory=list)
    answers: list[dict[str, Any]] = field(default_factory=list)
    remark: str = ""

    def median(self, key: str) -> float:
        """Return the median over the rounds, NaN where the method does not say."""
        values = [a[key] for a in self.answers if a.get(key) is not None]
        return statistics.median(values) if values else math.nan

    def rms(self, key: str) -> float:
        """Return the root mean square over the rounds, each a cloud of its own."""
        values = [a[key] for a in self.answers]
        return math.sqrt(statistics.fmean(v * v for v in values)) if values else math.nan

    def time_ratios(self, other: Runs, to: str = "time_s") -> list[float]:
        """Return the ratios of time in the rounds that both ran in; ``to`` names the other's."""
        both = [r for r in self.rounds if r in other.rounds]
        pairs = [(self.answers[self.rounds.index(r)], other.answers[other.rounds.index(r)]) for r in both]
        return [own["time_s"] / other[to] for own, other in pairs if other.get(to)]

    def time_ratio(self, other: Runs, to: str = "time_s") -> float:
        """Return the median of the ratios of time in the rounds that both ran in."""
        return statistics.median(self.time_ratios(other, to) or [math.nan])


def ours_of(runs: Sequence[Runs]) -> Runs | None:
    """Return the default's runs, if it ran."""
    return next((r for r in runs if r.method.name == OURS and r.answers), None)


def rows_of(runs: Sequence[Runs]) -> list[dict[str, Any]]:
    """Return one row a method; ratios are to our default, NaN where that did not run."""
    ours = ours_of(runs) or Runs(runs[0].method)
    rows = []
    for r in runs:
        rows.append(
            {
                "method": r.method.title,
                "version": r.method.installed or "",
                "time s": r.median("time_s"),
                "time / ours": r.time_ratio(ours),
                "nodes rms mm": r.rms("node_rms_mm"),
                "nodes / ours": r.rms("node_rms_mm") / ours.rms("node_rms_mm"),
                "tip mm": r.rms("tip_mm"),
                "tip / ours": r.rms("tip_mm") / ours.rms("tip_mm"),
                "surface rms mm": r.rms("surface_rms_mm"),
                "memory MB": r.median("peak_mb"),
                "memory / ours": r.median("peak_mb") / ours.median("peak_mb"),
                "iterations": r.median("iterations"),
                "rounds": len(r.rounds),
                "remark": r.remark,
            }
        )
    return rows


def better_on_both(runs: Sequence[Runs]) -> list[Runs]:
    """Return the peers that are more accurate and faster than our default."""
    ours = ours_of(runs)
    if ours is None:
        return []
    peers = [r for r in runs if r.method.peer and r.answers]
    # On the same clouds: those of the rounds that the peer ran in.
    return [r for r in peers if r.time_ratio(ours) < 1.0 and r.rms("node_rms_mm") < same_rounds(ours, r)]


def same_rounds(ours: Runs, other: Runs) -> float:
    """Return our nodes' rms over the rounds that the other ran in."""
    answers = [a for r, a in zip(ours.rounds, ours.answers, strict=True) if r in other.rounds]
    return Runs(ours.method, other.rounds, answers).rms("node_rms_mm")


def verdicts(runs: Sequence[Runs], cloud: Cloud) -> list[str]:
    """Return what the table shows, in sentences."""
    if ours_of(runs) is None:
        return ["The default did not run: no ratios."]
    beaten = better_on_both(runs)
    said = "No peer is better on accuracy and time at once."
    if beaten:
        said = f"BETTER THAN OURS on accuracy and time at once: {', '.join(r.method.title for r in beaten)}."
    late = [f"{r.method.title} ({', '.join(names)})" for r in runs if (names := late_imports(r))]
    return [
        said,
        *headline(runs, cloud),
        *([f"Memory counts what was imported within the measured calls: {'; '.join(late)}."] if late else []),
    ]


def late_imports(run: Runs) -> list[str]:
    """Return the packages that a method imported only while it was measured."""
    return sorted({name for answer in run.answers for name in answer.get("late_imports", ())})


def headline(runs: Sequence[Runs], cloud: Cloud) -> list[str]:
    """Return how the default's time stands to rigid ICP's and least squares' on a cloud, if they ran."""
    ours = ours_of(runs)
    by_name = {r.method.name: r for r in runs if r.answers}
    if ours is None:
        return []
    told = []
    if ICP in by_name:
        ratios = [ours.time_ratio(by_name[ICP], key) for key in ("time_s", "core_s")]
        told.append(f"{shown(ratios[0])} x rigid ICP with its normals ({shown(ratios[1])} x without their time)")
    if LEAST_SQUARES in by_name:
        told.append(f"{shown(ours.time_ratio(by_name[LEAST_SQUARES]))} x least_squares")
    kind = "where it must search" if cloud.searched else "where no search is needed"
    return [f"Time of the default {kind} ({cloud.title}): {', '.join(told)}."] if told else []


def notes(cloud: Cloud, points: int, rounds: int) -> list[str]:
    """Return how the figures came about."""
    return [
        f"Cloud: {cloud.about}; 1 mm noise, {points:,} points; {rounds} rounds, each with a seed of its own, one "
        "process a method and round.",
        "Time: the call alone, from points to nodes, after one call on a cloud of the same kind with 1,000 points. The "
        "median of up to 7 calls in a round, then the median of the rounds; the ratio is taken within each round. BLAS "
        "on one thread.",
        "Nodes, tip: rms over the rounds of the distance from the true nodes, the first left out. Surface: rms "
        "distance of the element's points to the surface that the method found.",
        "Memory: the most that the process held, above what it held after its imports, the small cloud and the "
        "making of the large one; freed memory is used again, so small figures are rounded by what was left over.",
        "Nodes regressed: one affine map a segment by least squares from the straight template's cross-sections to the "
        "deformed ones; the axis under the maps, its ends averaged where two segments meet.",
    ]


def peer_metrics(runs: Sequence[Runs], cloud: Cloud) -> list[Metric]:
    """Return the figures of one cloud that the gate watches."""
    ours = ours_of(runs)
    if ours is None:
        return []
    iterations = Metric(f"{cloud.name}: iterations", ours.median("iterations"), 0.25)
    metrics = [
        Metric(f"{cloud.name}: nodes rms mm", ours.rms("node_rms_mm"), 0.10),
        Metric(f"{cloud.name}: tip mm", ours.rms("tip_mm"), 0.15),
        Metric(f"{cloud.name}: surface rms mm", ours.rms("surface_rms_mm"), 0.02),
        iterations if cloud.searched else replace(iterations, target=10.0),
    ]
    if any(r.method.peer and r.answers for r in runs):
        better, why = float(len(better_on_both(runs))), "a count"
        metrics.append(Metric(f"{cloud.name}: peers better on accuracy and time", better, 0.0, target=0.0, why=why))
    by_name: Mapping[str, Runs] = {r.method.name: r for r in runs if r.answers}
    for name, target in ((ICP, 0.25), (LEAST_SQUARES, 0.1), ("pink_points", None)):
        if name in by_name:
            title = f"{cloud.name}: time, default / {by_name[name].method.title}"
            wanted = None if cloud.searched else target
            metrics.append(repeated(title, ours.time_ratios(by_name[name]), target=wanted))
    return metrics
