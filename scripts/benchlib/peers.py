"""Everything a user might pick instead, on the same cloud in the same run: `scripts/bench_peers`.

Each method runs in a process of its own, in rounds: a round takes every method once, the
order turning, on one cloud (the round's seed). Ratios are to our default in the same
round, and the median of the rounds is shown.
"""

from __future__ import annotations

import argparse
import math
import statistics
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchlib import gate
from benchlib.gate import Metric
from benchlib.methods.registry import ICP, LEAST_SQUARES, METHODS, OURS, Method, named
from benchlib.qp_steps import SIZES, qp_metrics, qp_rows
from benchlib.reports import write_table
from benchlib.timing import JobError, load, ratio, rotated, run_job, say

SLOW_S = 15.0
STEPS = "qp_steps"


@dataclass(frozen=True)
class Plan:
    """How much to run.

    Attributes:
        mode: of the baseline.
        points: of the clouds.
        rounds: clouds, and runs of each method.
        budget_s: time in which a process repeats its method.
        timeout_s: of a process.
        sizes: variables of the bare steps.
    """

    mode: str
    points: int
    rounds: int
    budget_s: float
    timeout_s: float
    sizes: tuple[int, ...]


FULL = Plan("full", 10_000, 5, 1.0, 600.0, SIZES)
QUICK = Plan("quick", 2_000, 1, 0.2, 120.0, SIZES[:1])


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

    def time_ratio(self, other: Runs) -> float:
        """Return the median of the ratios of time in the rounds that both ran in."""
        both = [r for r in self.rounds if r in other.rounds]
        if not both:
            return math.nan
        own, to = ([x.answers[x.rounds.index(r)]["time_s"] for r in both] for x in (self, other))
        return ratio(own, to)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the methods, write the tables, judge them; 1 where the gate is asked for and closed."""
    parser = argparse.ArgumentParser(prog="bench_peers", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("bench_output"), help="folder (./bench_output)")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK.points:,} points, {QUICK.rounds} round")
    parser.add_argument("--rounds", type=int, help=f"clouds, and runs of each method ({FULL.rounds})")
    parser.add_argument("--only", metavar="NAMES", help=f"some methods, by commas; {STEPS} for the bare QP steps")
    parser.add_argument("--list", action="store_true", help="say the methods' names and leave")
    parser.add_argument("--install", action="store_true", help="get the packages that are missing, one by one, by pip")
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    plan = QUICK if options.quick else FULL
    rounds = plan.rounds if options.rounds is None else options.rounds
    if rounds < 1:
        parser.error(f"--rounds {rounds}: at least 1")
    try:
        methods, steps = chosen(options.only)
    except ValueError as error:
        parser.error(f"--only {error}, {STEPS}")
    if options.list:
        print("\n".join([f"{m.name:20} {m.title}" for m in methods] + [f"{STEPS:20} bare QP steps"]))
        return 0

    failures = install(methods) if options.install else {}
    runs = run_all(methods, plan, rounds, failures)
    written: list[Path] = []
    if runs:
        written += write_table(
            options.out / "peers",
            rows_of(runs),
            [*verdicts(runs), *(f"{r.method.title}: {r.method.about}" for r in runs), *notes(plan, rounds)],
            points=plan.points,
            rounds=rounds,
            answers={r.method.name: r.answers for r in runs},
            machine_load=load(),
        )
    metrics = peer_metrics(runs)
    if steps:
        rows = qp_rows(plan.sizes, plan.timeout_s)
        written += write_table(options.out / "qp_steps", rows, QP_NOTES)
        metrics += qp_metrics(rows)
    for path in written:
        if path.suffix == ".md":
            print(path.read_text(encoding="utf-8"))
    print("\n".join(str(path) for path in written))
    return gate.finish("bench_peers", plan.mode, metrics, options)


def chosen(only: str | None) -> tuple[list[Method], bool]:
    """Return the methods that --only names, and whether it names the bare steps; everything when None.

    Raises:
        ValueError: a name is unknown.
    """
    if only is None:
        return list(METHODS), True
    names = [name.strip() for name in only.split(",")]
    return named([name for name in names if name != STEPS]), STEPS in names


def install(methods: Sequence[Method]) -> dict[str, str]:
    """Install what the methods need, each by itself, and return what went wrong by method."""
    failures: dict[str, str] = {}
    for method in methods:
        if method.installed is not None:
            continue
        say(f"installing {' '.join(method.install)}")
        command = [sys.executable, "-m", "pip", "install", "--quiet", *method.install]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if done.returncode:
            errors = [line.strip() for line in done.stdout.splitlines() if "error" in line.lower()]
            failures[method.name] = (errors or [f"pip's exit code {done.returncode}"])[0][:200]
            say(f"{method.title}: {failures[method.name]}")
    return failures


def run_all(methods: Sequence[Method], plan: Plan, rounds: int, failures: dict[str, str]) -> list[Runs]:
    """Run every method in every round; one that fails is not asked again, one that is slow only once."""
    runs = {m.name: Runs(m) for m in methods}
    for name, method in ((m.name, m) for m in methods):
        if method.installed is None:
            how = failures.get(name) or f"pip install {' '.join(method.install)}"
            runs[name].remark = f"not installed: {how}"
    for i in range(rounds):
        for name in rotated(list(runs), i):
            run = runs[name]
            if run.remark:
                continue
            job = {"method": name, "points": plan.points, "seed": 1 + i, "budget_s": plan.budget_s}
            try:
                answer = run_job("benchlib.peer_job", job, plan.timeout_s)
            except JobError as error:
                run.remark = f"failed: {error}"
                say(f"round {i + 1}/{rounds}: {run.method.title}: {run.remark}")
                continue
            run.rounds.append(i)
            run.answers.append(answer)
            if rounds > 1 and answer["time_s"] > SLOW_S:
                run.remark = "one round only: slow"
            say(
                f"round {i + 1}/{rounds}: {run.method.title}: {answer['time_s']:.3f} s, "
                f"nodes {answer['node_rms_mm']:.3g} mm"
            )
    return list(runs.values())


# The table ------------------------------------------------------------------------------


def rows_of(runs: Sequence[Runs]) -> list[dict[str, Any]]:
    """Return one row a method; ratios are to our default, NaN where that did not run."""
    ours = next((r for r in runs if r.method.name == OURS), Runs(runs[0].method))
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
    ours = next((r for r in runs if r.method.name == OURS and r.answers), None)
    if ours is None:
        return []
    peers = [r for r in runs if r.method.peer and r.answers]
    # On the same clouds: those of the rounds that the peer ran in.
    return [r for r in peers if r.time_ratio(ours) < 1.0 and r.rms("node_rms_mm") < same_rounds(ours, r)]


def same_rounds(ours: Runs, other: Runs) -> float:
    """Return our nodes' rms over the rounds that the other ran in."""
    answers = [a for r, a in zip(ours.rounds, ours.answers, strict=True) if r in other.rounds]
    return Runs(ours.method, other.rounds, answers).rms("node_rms_mm")


def verdicts(runs: Sequence[Runs]) -> list[str]:
    """Return what the table shows, in sentences."""
    if not any(r.method.name == OURS and r.answers for r in runs):
        return ["The default did not run: no ratios."]
    beaten = better_on_both(runs)
    if not beaten:
        return ["No peer is better on accuracy and time at once."]
    names = ", ".join(r.method.title for r in beaten)
    return [f"BETTER THAN OURS on accuracy and time at once: {names}."]


def notes(plan: Plan, rounds: int) -> list[str]:
    """Return how the figures came about."""
    return [
        "Cloud: simulate(), rectangle 0.1 x 0.3 m, 2.5 m long, 10 segments, 22.5 degrees at segment 8, 1 mm noise, "
        f"{plan.points:,} points; {rounds} rounds, each with a seed of its own, one process a method and round.",
        "Time: the call alone, from points to nodes; imports done and, where a first call imports, one cloud of "
        "1,000 points solved before. The fastest of up to 7 calls in a round, then the median of the rounds; the "
        "ratio is taken within each round. BLAS on one thread.",
        "Nodes, tip: rms over the rounds of the distance from the true nodes, the first left out. Surface: rms "
        "distance of the scan's points to the surface that the method found.",
        "Memory: the most that the process held, above what it held after its imports and the cloud of 1,000 points; "
        "freed memory is used again, so small figures are rounded by what was left over.",
        "Nodes regressed: one affine map a segment by least squares from the straight template's cross-sections to the "
        "deformed ones; the axis under the maps, its ends averaged where two segments meet.",
    ]


QP_NOTES = (
    "Steps of real fits of 10, 30 and 100 segments (30, 90, 300 variables), as they come, and with the box drawn in "
    "until about half of the variables are at a limit. Time: median of a step.",
    "Error: how far the answer is from meeting the optimality conditions, as the change of a joint that a Newton step "
    "of that joint alone would still make within the box, in rad; the worst of all steps. Beyond the box: the worst "
    "violation of a limit before anything is clipped, in rad.",
    "osqp, direct: the package's own step, its workspace kept and warm-started. The others through qpsolvers, at its "
    "defaults.",
)


def peer_metrics(runs: Sequence[Runs]) -> list[Metric]:
    """Return the figures that the gate watches."""
    by_name = {r.method.name: r for r in runs if r.answers}
    ours = by_name.get(OURS)
    if ours is None:
        return []
    metrics = [
        Metric("default: nodes rms mm", ours.rms("node_rms_mm"), 0.10),
        Metric("default: tip mm", ours.rms("tip_mm"), 0.15),
        Metric("default: surface rms mm", ours.rms("surface_rms_mm"), 0.02),
        Metric("default: iterations", ours.median("iterations"), 0.25, target=10.0),
        Metric("peers better on accuracy and time", float(len(better_on_both(runs))), 0.0, target=0.0),
    ]
    for name, noise, target in ((ICP, 0.5, 0.25), (LEAST_SQUARES, 0.4, 0.1), ("pink_points", 0.4, None)):
        if name in by_name:
            title = by_name[name].method.title
            metrics.append(Metric(f"time: default / {title}", ours.time_ratio(by_name[name]), noise, target=target))
    return metrics


if __name__ == "__main__":
    sys.exit(main())
