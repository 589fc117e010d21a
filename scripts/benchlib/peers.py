"""Everything a user might pick instead, on the same cloud in the same run: `scripts/bench_peers`.

Each method runs in a process of its own, in rounds: a round takes every method once, the
order turning, on one cloud (the round's seed). Ratios are to our default in the same
round, and the median of the rounds is shown. One cloud needs no search of the default's;
two do, and the peers are judged on them as well.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchlib import gate
from benchlib.methods.registry import METHODS, OURS, Method, named
from benchlib.peer_clouds import CLOUDS, Cloud, clouds_named
from benchlib.peers_table import Runs, headline, notes, peer_metrics, rows_of, verdicts
from benchlib.qp_steps import QP_NOTES, SIZES, qp_metrics, qp_rows
from benchlib.reports import fill_in, write_table
from benchlib.timing import JobError, load, rotated, run_job, say

ROOT = Path(__file__).parent.parent.parent
DOCUMENT = ROOT / "docs" / "benchmarks.md"
SLOW_S = 15.0
STEPS = "qp_steps"


@dataclass(frozen=True)
class Plan:
    """How much to run.

    Attributes:
        mode: of the baseline.
        points: of the clouds.
        rounds: clouds of a kind, and runs of each method.
        searched_rounds: the same where the default must search.
        budget_s: time in which a process repeats its method.
        timeout_s: of a process.
        searched_timeout_s: the same where the default must search; slower peers are cut off.
        sizes: variables of the bare steps.
    """

    mode: str
    points: int
    rounds: int
    searched_rounds: int
    budget_s: float
    timeout_s: float
    searched_timeout_s: float
    sizes: tuple[int, ...]

    def limits(self, cloud: Cloud) -> tuple[int, float]:
        """Return rounds and time limit of a cloud."""
        if cloud.searched:
            return self.searched_rounds, self.searched_timeout_s
        return self.rounds, self.timeout_s


FULL = Plan("full", 10_000, 5, 3, 1.0, 600.0, 60.0, SIZES)
QUICK = Plan("quick", 2_000, 1, 1, 0.2, 120.0, 30.0, SIZES[:1])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the methods, write the tables, judge them; 1 where the gate is asked for and closed."""
    parser = argparse.ArgumentParser(prog="bench_peers", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "peers", help="folder")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK.points:,} points, {QUICK.rounds} round")
    parser.add_argument(
        "--rounds", type=int, help=f"clouds of a kind, and runs of each method ({FULL.rounds}; {FULL.searched_rounds})"
    )
    parser.add_argument("--only", metavar="NAMES", help=f"some methods, by commas; {STEPS} for the bare QP steps")
    parser.add_argument("--clouds", metavar="NAMES", help=", ".join(c.name for c in CLOUDS) + ", by commas")
    parser.add_argument("--docs", action="store_true", help="renew the tables in docs/benchmarks.md too")
    parser.add_argument("--list", action="store_true", help="say the methods' names and leave")
    parser.add_argument("--install", action="store_true", help="get the packages that are missing, one by one, by pip")
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    plan = QUICK if options.quick else FULL
    if options.rounds is not None:
        if options.rounds < 1:
            parser.error(f"--rounds {options.rounds}: at least 1")
        plan = replace(plan, rounds=options.rounds, searched_rounds=options.rounds)
    try:
        clouds = clouds_named(options.clouds)
    except ValueError as error:
        parser.error(f"--clouds {error}")
    try:
        methods, steps = chosen(options.only)
    except ValueError as error:
        parser.error(f"--only {error}, {STEPS}")
    if options.list:
        print("\n".join([f"{m.name:20} {m.title}" for m in methods] + [f"{STEPS:20} bare QP steps"]))
        return 0

    failures = install(methods) if options.install else {}
    runs = {c: run_all(methods_on(c, methods), c, plan, failures) for c in clouds}
    runs = {c: some for c, some in runs.items() if some}
    written: list[Path] = []
    headlines = [line for c, some in runs.items() for line in headline(some, c)]
    for cloud, some in runs.items():
        written += write_peers(options.out, cloud, some, plan, [line for line in headlines if cloud.title not in line])
    metrics = [metric for cloud, some in runs.items() for metric in peer_metrics(some, cloud)]
    if steps:
        rows = qp_rows(plan.sizes, plan.timeout_s)
        written += write_table(options.out / STEPS, rows, QP_NOTES)
        metrics += qp_metrics(rows)
    for path in written:
        if path.suffix == ".md":
            text = path.read_text(encoding="utf-8")
            print(text)
            if options.docs:
                fill_in(DOCUMENT, f"bench_peers {path.stem.removeprefix('peers_')}", text)
    print("\n".join(str(path) for path in written))
    made_with = {"points": plan.points, "rounds": [plan.rounds, plan.searched_rounds]}
    partial = options.only is not None or options.clouds is not None
    return gate.finish("bench_peers", plan.mode, metrics, options, made_with, partial)


def write_peers(folder: Path, cloud: Cloud, runs: list[Runs], plan: Plan, beside: list[str]) -> list[Path]:
    """Write the table of one cloud; ``beside`` says how the default's time stands on the other clouds."""
    rounds, _ = plan.limits(cloud)
    about = [f"{r.method.title}: {r.method.about}" for r in runs] if not cloud.searched else []
    return write_table(
        folder / f"peers_{cloud.name}",
        rows_of(runs),
        [*verdicts(runs, cloud), *beside, *about, *notes(cloud, plan.points, rounds)],
        points=plan.points,
        rounds=rounds,
        answers={r.method.name: r.answers for r in runs},
        machine_load=load(),
    )


def methods_on(cloud: Cloud, methods: Sequence[Method]) -> list[Method]:
    """Return the methods for a cloud: where the default must search its steps' solvers are not compared again."""
    return [m for m in methods if m.peer or m.name in (OURS, "icpik") or not cloud.searched]


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


def run_all(methods: Sequence[Method], cloud: Cloud, plan: Plan, failures: Mapping[str, str]) -> list[Runs]:
    """Run every method in every round; one that fails is not asked again, one that is slow only once."""
    rounds, timeout_s = plan.limits(cloud)
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
            about = {"cloud": cloud.name, "points": plan.points, "seed": 1 + i}
            job = {"method": name, **about, "budget_s": plan.budget_s}
            try:
                answer = run_job("benchlib.peer_job", job, timeout_s)
            except JobError as error:
                run.remark = f"failed: {error}"
                say(f"{cloud.title}, round {i + 1}/{rounds}: {run.method.title}: {run.remark}")
                continue
            run.rounds.append(i)
            run.answers.append(answer)
            if rounds > 1 and answer["time_s"] > SLOW_S:
                run.remark = "one round only: slow"
            say(
                f"{cloud.title}, round {i + 1}/{rounds}: {run.method.title}: {answer['time_s']:.3f} s, "
                f"nodes {answer['node_rms_mm']:.3g} mm"
            )
    return list(runs.values())


if __name__ == "__main__":
    sys.exit(main())
