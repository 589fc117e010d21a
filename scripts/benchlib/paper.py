"""The paper's tests, run by its method and by the default: `scripts/bench_paper`.

Every case of `cases.PAPER` is simulated once and fitted by both methods on the same
cloud. Its figures 3 to 6 are drawn anew, and one table sets what the paper's text says
beside what was measured.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchlib import figures, gate
from benchlib.bound import Bound, cramer_rao
from benchlib.cases import NOISE_M, PAPER, POINTS, Case, named
from benchlib.reports import fill_in, write_table
from benchlib.runs import Run, Yardstick, model_cloud, patched, run, warm_up
from linear_ik import FitSettings, icpik, simulate

ROOT = Path(__file__).parent.parent.parent
QUICK = ("1b", "4c")
QUICK_POINTS, QUICK_ITERATIONS = 1_500, 40
ALIGNED_MM, WANTED_MM = 50.0, 0.5
METHODS = ("icpik", "default")
BY = {
    "icpik": "paper's method, our run",
    "grid": "paper's method, clouds on one grid",
    "default": "default",
}
# Final RMSE by case study, from the text of its section 4.4.
PUBLISHED_RMSE_MM = {"1": (3.0, 6.0), "2": (4.0, 5.0), "3": (4.0, 9.0)}
PUBLISHED_TIP_MM = {"4a": 15.0, "4b": 48.0, "4c": 300.0}


@dataclass(frozen=True)
class Compared:
    """One case, fitted by both methods.

    Attributes:
        case: what was fitted.
        runs: by method; "grid" is the paper's with scan and model sampled on one grid.
        truth_rmse_mm: by method, the paper's RMSE of the true shape: what a perfect fit
            of the same clouds scores.
        bound: on the nodes, for this very scan.
    """

    case: Case
    runs: dict[str, Run]
    truth_rmse_mm: dict[str, float]
    bound: Bound


def main(arguments: list[str] | None = None) -> int:
    """Run the cases, write the table and the pictures, and say where the runs differ from the paper."""
    parser = argparse.ArgumentParser(prog="bench_paper", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "paper", help="folder")
    parser.add_argument("--quick", action="store_true", help=f"cases {' and '.join(QUICK)} with {QUICK_POINTS} points")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated clouds")
    parser.add_argument("--docs", action="store_true", help="renew docs/figures and the table in docs/method.md too")
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    points = QUICK_POINTS if options.quick else POINTS
    most = QUICK_ITERATIONS if options.quick else icpik.MOST_ITERATIONS
    cases = [named(name) for name in QUICK] if options.quick else list(PAPER)
    compared = []
    for case in cases:
        compared.append(compare(case, options.seed, points, most, repeats=1 if options.quick else 5))
        say(compared[-1])

    rows = [row for c in compared for row in table_rows(c)]
    notes = differences(compared)
    written = write_table(options.out / "table1", rows, notes, points=points, seed=options.seed, noise_mm=1e3 * NOISE_M)
    written.append(write_curves(options.out / "curves.json", compared))
    written += draw(options.out, compared, points, options.seed)
    if options.docs:
        written += draw(ROOT / "docs" / "figures", compared, points, options.seed)
        fill_in(ROOT / "docs" / "method.md", "bench_paper", written[0].read_text(encoding="utf-8"))
    print("\n".join(str(path) for path in written))
    return gate.finish("bench_paper", "quick" if options.quick else "full", metrics(compared), options)


def metrics(compared: list[Compared]) -> list[gate.Metric]:
    """Return what the gate holds: the default's worst nodes, and its iterations in the paper's own cases."""
    out = [
        gate.Metric(f"{c.case.name}: worst node, mm", c.runs["default"].max_mm, noise=0.2, target=WANTED_MM)
        for c in compared
    ]
    iterations = [c.runs["default"].iterations for c in compared if c.case.study != "5"]
    return [*out, gate.Metric("median iterations", float(np.median(iterations)), noise=0.2, target=10.0)]


def compare(case: Case, seed: int, points: int, most_iterations: int, repeats: int) -> Compared:
    """Fit one case by both methods on the same cloud, the default ``repeats`` times for its best time.

    A third run is the paper's method with its scan and its model on the same grid, as
    the paper's simulator makes them, each with perturbations of its own.
    """
    element, scan = case.element, case.scan(seed, points)
    yardstick = Yardstick(element, scan)
    warm_up(element, scan)
    paper_settings = FitSettings(method="icpik", max_iterations=most_iterations)
    as_dense = (icpik, "MODEL_POINTS", points)
    with patched(as_dense):
        theirs = run(element, scan, paper_settings, yardstick=yardstick)
    ours = run(element, scan, FitSettings(), yardstick=yardstick, repeats=repeats)
    truth = dict.fromkeys(METHODS, yardstick.at_truth()[0])
    on_grid = case.scan(seed, points, layout="grid")
    cloud = simulate(element, points=points, noise_m=0.0, seed=seed + 1_000, layout="grid")
    grid_yardstick = Yardstick(element, on_grid, cloud=cloud)
    with model_cloud(element, cloud):
        on_one = run(element, on_grid, paper_settings, yardstick=grid_yardstick)
    runs = {"icpik": theirs, "grid": on_one, "default": ours}
    truth["grid"] = grid_yardstick.at_truth()[0]
    return Compared(case, runs, truth, cramer_rao(element, scan, NOISE_M))


def say(compared: Compared) -> None:
    """Report one case on stderr."""
    text = "; ".join(f"{m} {r.max_mm:.3g} mm, {r.iterations} it., {r.time_s:.2f} s" for m, r in compared.runs.items())
    print(f"{compared.case.name}: worst node: {text}", file=sys.stderr, flush=True)


# The table ------------------------------------------------------------------------------


def table_rows(compared: Compared) -> list[dict[str, Any]]:
    """Return what the paper says, our runs of its method, our default."""
    case, published = compared.case, compared.case.published
    none = math.nan
    rows: list[dict[str, Any]] = [
        {
            "case": case.name,
            "": case.words,
            "by": "paper, published",
            "outcome": published.outcome,
            "RMSE mm": published.rmse_mm,
            "RMSE of the truth mm": none,
            "to surface mm": none,
            "tip mm": published.tip_mm,
            "worst node mm": none,
            "nodes rms mm": none,
            "bound rms mm": none,
            "iterations": published.iterations,
            "settled at": none,
            "time s": none,
        }
    ]
    for method in BY:
        r = compared.runs[method]
        rows.append(
            {
                "case": case.name,
                "": case.words,
                "by": BY[method],
                "outcome": outcome(r.max_mm),
                "RMSE mm": r.cloud_rmse_mm,
                "RMSE of the truth mm": compared.truth_rmse_mm[method],
                "to surface mm": r.surface_rmse_mm,
                "tip mm": r.tip_mm,
                "worst node mm": r.max_mm,
                "nodes rms mm": r.rms_mm,
                "bound rms mm": 1e3 * compared.bound.rms_m,
                "iterations": r.iterations,
                "settled at": settled_at(r.cloud_curve_mm),
                "time s": r.time_s,
            }
        )
    return rows


def outcome(worst_mm: float) -> str:
    """Return the verdict on a fit by its worst node."""
    if worst_mm <= WANTED_MM:
        return f"within {WANTED_MM:g} mm"
    return "aligned (as the paper has it)" if worst_mm <= ALIGNED_MM else "failure"


def settled_at(curve: list[float]) -> int:
    """Return the iteration after which a curve stays within 5 % of its whole fall from its final value."""
    values = np.asarray(curve)
    near = np.abs(values - values[-1]) <= 0.05 * abs(values[0] - values[-1]) + 1e-9
    outside = np.flatnonzero(~near)
    return int(outside[-1]) + 1 if len(outside) else 0


def differences(compared: list[Compared]) -> list[str]:
    """Return, in plain sentences, where our run of the paper's method differs from what it published, and why."""
    out = []
    by_name = {c.case.name: c for c in compared}
    runs = {name: c.runs["icpik"] for name, c in by_name.items()}
    grid = {name: c.runs["grid"] for name, c in by_name.items()}
    limit = {name: highest(c.case.published.rmse_mm) for name, c in by_name.items()}
    above = [n for n in by_name if limit[n] < runs[n].cloud_rmse_mm]
    if above:
        floors = [by_name[n].truth_rmse_mm["icpik"] for n in above]
        out.append(
            f"RMSE of {', '.join(above)}: above the published one on the same clouds as the default's. The true shape "
            f"itself scores {min(floors):.1f} to {max(floors):.1f} mm there: between two clouds sampled independently "
            "no fit can score less. With scan and model sampled on one grid, as the paper's simulator samples, the "
            f"truth scores {min(by_name[n].truth_rmse_mm['grid'] for n in above):.1f} mm and more, and our run of the "
            "paper's method "
            + ", ".join(
                f"{grid[n].cloud_rmse_mm:.1f} ({n}, published {by_name[n].case.published.rmse_mm})" for n in above
            )
            + f"; the worst nodes are then {min(grid[n].max_mm for n in above):.0f} to "
            f"{max(grid[n].max_mm for n in above):.0f} mm off. So such an RMSE does not mean that the shape is right."
        )
    still = [n for n in above if limit[n] < grid[n].cloud_rmse_mm]
    if still:
        out.append(
            f"Also on one grid above the published RMSE: {', '.join(still)}. The paper gives neither the grid's "
            "spacing nor its perturbation nor the constants of its weights; all of them shift this figure."
        )
    capped = [name for name, r in runs.items() if r.iterations >= icpik.MOST_ITERATIONS]
    if capped:
        out.append(
            f"Iterations of {', '.join(capped)}: ours runs to the cap of 100, since the largest distance between "
            'corresponding points does not fall below 1 mm with a noise of 1 mm. The column "settled at" is where its '
            "RMSE stops falling, to be compared with the published 40 to 60 and 80+."
        )
    for name, r in runs.items():
        case = by_name[name].case
        if case.study != "5" and (r.max_mm <= ALIGNED_MM) != case.solved_in_paper:
            out.append(
                f"{name}: the paper calls its fit {'aligned' if case.solved_in_paper else 'a complete failure'}, ours "
                f"ends {r.max_mm:.0f} mm off at its worst node, {grid[name].max_mm:.0f} mm on one grid. The constants "
                "that the paper leaves open (the threshold's schedule, the weights, lambda, C and Q) and the sampling "
                "decide this case; the ablation shows how much."
            )
    for name, tip in PUBLISHED_TIP_MM.items():
        if name in runs and by_name[name].case.solved_in_paper:
            ours = f"{runs[name].tip_mm:.0f} mm off, {grid[name].tip_mm:.0f} mm on one grid"
            out.append(f"{name}: tip {ours}; published {tip:.0f}.")
    return out


def highest(published: str) -> float:
    """Return the upper end of a published range such as "4 to 5" or "< 6"; inf where there is none."""
    numbers = [float(word) for word in published.replace("<", " ").split() if word.replace(".", "").isdigit()]
    return max(numbers, default=math.inf)


# The pictures ---------------------------------------------------------------------------


def write_curves(path: Path, compared: list[Compared]) -> Path:
    """Write the curves of every run as JSON."""
    runs = {c.case.name: {m: r.as_mapping() for m, r in c.runs.items()} for c in compared}
    path.write_text(json.dumps(runs) + "\n", encoding="utf-8")
    return path


def draw(folder: Path, compared: list[Compared], points: int, seed: int) -> list[Path]:
    """Draw figures 3 to 6 into a folder."""
    column = named("2a")
    written = figures.draw_scan(
        folder / "figure3", column.scan(seed, points).points, f"circular section, {points:,} points"
    )
    panels = []
    for c in compared:
        scan = c.case.scan(seed, 100)
        shapes = {m: figures.Bent(c.runs[m].q, np.asarray(c.runs[m].base_pose)) for m in METHODS}
        panels.append((f"{c.case.name}\n{c.case.words}", c.case.element, figures.Bent(scan.q, scan.base_pose), shapes))
    written += figures.draw_shapes(folder / "figure4", panels)
    curves = [
        figures.Curves(
            c.case.name, c.case.study, m, r.cloud_curve_mm, r.surface_curve_mm, r.node_mm, c.truth_rmse_mm[m]
        )
        for c in compared
        for m, r in c.runs.items()
    ]
    written += figures.draw_rmse(folder / "figure5", curves, PUBLISHED_RMSE_MM)
    of_methods = [c for c in curves if c.method in METHODS]
    written += figures.draw_nodes(folder / "figure6", of_methods, PUBLISHED_TIP_MM)
    return written


if __name__ == "__main__":
    sys.exit(main())
