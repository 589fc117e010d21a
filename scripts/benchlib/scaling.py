"""How time, memory and iterations grow, and where the time goes: `scripts/bench_scaling`.

Points from 1 k to 10 M on ten segments; then 5 to 300 segments of 0.25 m under the same
points, so that the element grows; then one beam of 2.5 m cut finer. Each size in a
process of its own. Slopes are fitted to the logarithms. Then the fit beside others' work
on the same points, in turns: rigid ICP, least squares, and one closest-point pass of
Open3D's RaycastingScene.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchlib import gate
from benchlib.gate import Metric, repeated
from benchlib.methods.registry import ICP, LEAST_SQUARES
from benchlib.reports import fill_in, write_table
from benchlib.scaling_job import WITHOUT_NORMALS
from benchlib.timing import JobError, load, run_job, say

ROOT = Path(__file__).parent.parent.parent
JOB = "benchlib.scaling_job"
RAYCASTING = "raycasting"
TITLES = {
    ICP: "rigid ICP with its normals",
    ICP + WITHOUT_NORMALS: "rigid ICP without the time of its normals",
    LEAST_SQUARES: "scipy least_squares",
    RAYCASTING: "one raycasting pass",
}
LARGE_POINTS = 100_000
LENGTH_M, SEGMENTS = 2.5, 10
SLOW_S = 20.0


@dataclass(frozen=True)
class Plan:
    """How much to run.

    Attributes:
        mode: of the baseline.
        points: sizes of the clouds, on ten segments.
        segments: numbers of segments of 0.25 m, under ``segment_points`` points.
        finer: numbers of segments of one beam of 2.5 m, under as many.
        segment_points: see above.
        rounds: runs of each size, the fastest counts; of a slow one only the first.
        budget_s: time in which a process repeats a fit.
        timeout_s: of a process.
        ratios: (points, rounds, others) of the comparisons.
    """

    mode: str
    points: tuple[int, ...]
    segments: tuple[int, ...]
    finer: tuple[int, ...]
    segment_points: int
    rounds: int
    budget_s: float
    timeout_s: float
    ratios: tuple[tuple[int, int, tuple[str, ...]], ...]


FULL = Plan(
    "full",
    (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000, 10_000_000),
    (5, 10, 20, 30, 50, 75, 100, 150, 200, 300),
    (20, 50, 100),
    100_000,
    2,
    2.0,
    900.0,
    ((10_000, 15, (ICP, LEAST_SQUARES)), (1_000_000, 5, (RAYCASTING,))),
)
QUICK = Plan(
    "quick",
    (1_000, 3_000, 10_000, 100_000),
    (5, 10, 20),
    (20,),
    10_000,
    1,
    0.5,
    300.0,
    ((10_000, 5, (ICP, LEAST_SQUARES)), (100_000, 3, (RAYCASTING,))),
)
TINY = Plan("tiny", (1_000,), (), (), 1_000, 1, 0.0, 120.0, ())
PLANS = {p.mode: p for p in (FULL, QUICK, TINY)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sizes and the comparisons, write tables and pictures; 1 where the gate is asked for and closed."""
    parser = argparse.ArgumentParser(prog="bench_scaling", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "scaling", help="folder")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_const", dest="plan", const=QUICK, help="to 100 k points, 20 segments")
    size.add_argument("--tiny", action="store_const", dest="plan", const=TINY, help="whether it runs at all")
    parser.add_argument("--docs", action="store_true", help="renew docs/figures and docs/benchmarks.md too")
    parser.add_argument("--most-points", type=int, default=10**9, help="leave out larger clouds")
    parser.add_argument("--rounds", type=int, help=f"runs of each size, the fastest counts ({FULL.rounds})")
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    plan = options.plan or FULL
    rounds = plan.rounds if options.rounds is None else options.rounds
    if rounds < 1 or options.most_points < plan.points[0]:
        parser.error(f"--rounds at least 1, --most-points at least {plan.points[0]}")

    by_points = [measured(n, SEGMENTS, LENGTH_M, plan, rounds) for n in plan.points if n <= options.most_points]
    each_m = LENGTH_M / SEGMENTS
    by_segments = [measured(plan.segment_points, k, each_m * k, plan, rounds) for k in plan.segments]
    finer = [measured(plan.segment_points, k, LENGTH_M, plan, rounds) for k in plan.finer]
    compared = [compare(*c, plan.timeout_s) for c in plan.ratios if c[0] <= options.most_points]

    everything = by_points + by_segments + finer
    slopes = slopes_of(by_points, by_segments)
    notes = [*slopes_said(slopes), *ratios_said(compared), *targets_said(by_points), *NOTES]
    written = write_table(
        options.out / "scaling",
        [row(a) for a in everything],
        notes,
        answers=everything,
        ratios=compared,
        machine_load=load(),
    )
    from benchlib.scaling_plots import draw

    for folder in (options.out, *([ROOT / "docs" / "figures"] if options.docs else [])):
        written += draw(folder, by_points, by_segments, slopes)
    text = written[0].read_text(encoding="utf-8")
    if options.docs:
        fill_in(ROOT / "docs" / "benchmarks.md", "bench_scaling", text)
    print(text)
    print("\n".join(str(path) for path in written))
    made_with = {"rounds": rounds, "segment points": plan.segment_points}
    partial = options.most_points < plan.points[-1]
    metrics = metrics_of(by_points, compared, slopes)
    return gate.finish("bench_scaling", plan.mode, metrics, options, made_with, partial)


def measured(points: int, segments: int, length_m: float, plan: Plan, rounds: int) -> dict[str, Any]:
    """Return what `scaling_job.measure` answers for one size, the fastest of all calls as ``time_s``."""
    about: dict[str, Any] = {"points": points, "segments": segments, "length_m": length_m}
    said = f"{points:,} points, {segments} segments on {length_m:g} m"
    with tempfile.TemporaryDirectory(prefix="linear_ik_bench_") as folder:
        path = str(Path(folder) / "cloud.npy")
        try:
            made = run_job(JOB, {"do": "cloud", "path": path, **about, "seed": 1}, plan.timeout_s)
            job = {"do": "fit", "path": path, **about, **made, "budget_s": plan.budget_s}
            del job["points"]
            answers: list[dict[str, Any]] = []
            while len(answers) < rounds and not (answers and min(answers[0]["times_s"]) > SLOW_S):
                answers.append(run_job(JOB, job, plan.timeout_s))
        except JobError as error:
            say(f"{said}: {error}")
            return {**about, "remark": str(error)}
    times = [t for a in answers for t in a["times_s"]]
    best = {**answers[0], **about, "time_s": min(times), "remark": ""}
    best["peak_bytes"] = statistics.median(a["peak_bytes"] for a in answers)
    say(f"{said}: {best['time_s']:.3f} s, {best['iterations']} iterations")
    return best


def compare(points: int, rounds: int, against: Sequence[str], timeout_s: float) -> dict[str, Any]:
    """Return the ratios of the fit's time to others' on so many points."""
    job = {"do": "ratios", "points": points, "rounds": rounds, "against": list(against)}
    try:
        answer = run_job(JOB, job, timeout_s)
    except JobError as error:
        say(f"ratios at {points:,} points: {error}")
        return {"points": points, "ratios": {}, "remark": str(error)}
    said = ", ".join(f"{r:.2f} x {TITLES[name]}" for name, r in answer["ratios"].items())
    say(f"fit of {points:,} points: {said}")
    return {"points": points, "remark": "", **answer}


# Words and figures ------------------------------------------------------------------------


def row(answer: dict[str, Any]) -> dict[str, Any]:
    """Return one row of the table."""
    nan = math.nan
    out = {
        "points": answer["points"],
        "segments": answer["segments"],
        "length m": answer["length_m"],
        "time s": answer.get("time_s", nan),
        "iterations": answer.get("iterations", nan),
        "memory MB": answer["peak_bytes"] / 1e6 if "peak_bytes" in answer else nan,
        "memory / points": answer["peak_bytes"] / answer["points_bytes"] if "peak_bytes" in answer else nan,
        "nodes rms mm": answer.get("node_rms_mm", nan),
        "worst node mm": answer.get("node_max_mm", nan),
        "status": answer.get("status", answer["remark"]),
    }
    from benchlib.stages import STAGES

    shares = answer.get("stages", {})
    return out | {f"{stage} %": 100.0 * shares[stage] if shares else nan for stage in STAGES}


def slopes_of(by_points: list[dict[str, Any]], by_segments: list[dict[str, Any]]) -> dict[str, float]:
    """Return the fitted slopes of log figure over log size, by what they are of."""
    large = [a for a in by_points if a["points"] >= LARGE_POINTS]
    of = {
        "time over points": (by_points, "points", "time_s"),
        f"time over points, {LARGE_POINTS:,} and more": (large, "points", "time_s"),
        f"memory over points, {LARGE_POINTS:,} and more": (large, "points", "peak_bytes"),
        "iterations over points": (by_points, "points", "iterations"),
        "time over segments": (by_segments, "segments", "time_s"),
        "iterations over segments": (by_segments, "segments", "iterations"),
    }
    return {name: slope(*what) for name, what in of.items()}


def slope(answers: list[dict[str, Any]], size: str, figure: str) -> float:
    """Return the slope of the line through the logarithms, NaN with less than two sizes."""
    known = [(a[size], a[figure]) for a in answers if a.get(figure, 0) > 0]
    if len(known) < 2:
        return math.nan
    x, y = np.log(np.array(known, dtype=float)).T
    return float(np.polyfit(x, y, 1)[0])


def slopes_said(slopes: dict[str, float]) -> list[str]:
    """Return the slopes in sentences."""
    return [f"Slope (log-log), {name}: {value:.2f}" for name, value in slopes.items() if not math.isnan(value)]


def ratios_said(compared: list[dict[str, Any]]) -> list[str]:
    """Return the ratios in sentences."""
    return [
        f"Fit of {c['points']:,} points: {value:.2f} x {TITLES[name]} (in turns, median of {len(c['times_s']['fit'])})"
        for c in compared
        for name, value in c["ratios"].items()
    ]


def targets_said(by_points: list[dict[str, Any]]) -> list[str]:
    """Return where the time goes at 10 k and 1 M points."""
    out = []
    for a in by_points:
        if a["points"] in (10_000, 1_000_000) and a.get("stages"):
            shares = sorted(a["stages"].items(), key=lambda item: -item[1])
            said = ", ".join(f"{stage} {100 * share:.0f} %" for stage, share in shares if share >= 0.005)
            out.append(f"Where the time of {a['points']:,} points goes ({a['time_s']:.3f} s): {said}")
    return out


NOTES = (
    "Time: the fastest call of all rounds, after one fit of 1,000 points. Memory: the most that the process held, the "
    "points included, above what it held after its imports and that fit; beside the bytes of the points as 64-bit "
    "floats.",
    "Stages: as many fits again with every function of the package wrapped, by module; a stage's time is its own. Rest "
    "is what is in no stage, such as the copy of the points and the loop itself.",
)


SLOPES = "of times of processes one after the other; a repeat would take the whole run again"


def metrics_of(
    by_points: list[dict[str, Any]], compared: list[dict[str, Any]], slopes: dict[str, float]
) -> list[Metric]:
    """Return the figures that the gate watches."""
    targets = {(10_000, ICP): 0.25, (10_000, LEAST_SQUARES): 0.1, (1_000_000, RAYCASTING): 2.0}
    metrics = []
    for c in compared:
        for name in c["ratios"]:
            title = f"time: fit of {c['points']:,} points / {TITLES[name]}"
            rounds = [a / b for a, b in zip(c["times_s"]["fit"], c["times_s"][name], strict=True)]
            metrics.append(repeated(title, rounds, target=targets.get((c["points"], name))))
    for a in by_points:
        if "peak_bytes" not in a:
            continue
        size = f"{a['points']:,} points"
        metrics.append(Metric(f"nodes rms mm, {size}", a["node_rms_mm"], 0.15))
        if a["points"] >= 1_000_000:
            metrics.append(Metric(f"memory / points, {size}", a["peak_bytes"] / a["points_bytes"], 0.15, target=3.0))
            metrics.append(Metric(f"worst node mm, {size}", a["node_max_mm"], 0.2, target=0.2))
    for name in ("time over points", "time over segments"):
        if not math.isnan(slopes[name]):
            metrics.append(Metric(f"slope, {name}", slopes[name], 0.25, why=SLOPES))
    return metrics


if __name__ == "__main__":
    sys.exit(main())
