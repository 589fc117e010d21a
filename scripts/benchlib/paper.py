"""The paper's tests, run by its method and by the default: `scripts/bench_paper`.

Every case of `cases.PAPER` is simulated once and fitted by both methods on the same
cloud. Its figures 3 to 6 are drawn anew, and one table sets what the paper's text says
beside what was measured.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchlib import figures, gate
from benchlib.bound import cramer_rao
from benchlib.cases import NOISE_M, PAPER, POINTS, Case, named
from benchlib.comparison import PUBLISHED_TIP_MM, Compared, brief, differences, metrics, table_rows
from benchlib.reports import fill_in, write_table
from benchlib.runs import Yardstick, model_cloud, patched, run, warm_up
from linear_ik import FitSettings, icpik, simulate

ROOT = Path(__file__).parent.parent.parent
QUICK = ("1b", "4c")
QUICK_POINTS = 1_500
WARM_POINTS, WARM_ITERATIONS, REPEATS = 1_000, 3, 3
METHODS = ("icpik", "default")
# Final RMSE by case study, from the text of its section 4.4.
PUBLISHED_RMSE_MM = {"1": (0.1, 6.0), "3": (4.0, 9.0)}


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
    cases = [named(name) for name in QUICK] if options.quick else list(PAPER)
    compared = []
    for case in cases:
        compared.append(compare(case, options.seed, points, repeats=1 if options.quick else REPEATS))
        say(compared[-1])

    rows = [row for c in compared for row in table_rows(c)]
    notes = [*differences(compared), timing_note(1 if options.quick else REPEATS)]
    about = {"points": points, "seed": options.seed, "noise_mm": 1e3 * NOISE_M}
    written = write_table(options.out / "table1", rows, notes, brief(rows), **about)
    written.append(write_curves(options.out / "curves.json", compared))
    written += draw(options.out, compared, points, options.seed)
    if options.docs:
        written += draw(ROOT / "docs" / "figures", compared, points, options.seed)
        fill_in(ROOT / "docs" / "method.md", "bench_paper", written[0].read_text(encoding="utf-8"))
    print("\n".join(str(path) for path in written))
    mode = "quick" if options.quick else "full"
    return gate.finish("bench_paper", mode, metrics(compared), options, {"points": points, "seed": options.seed})


def compare(case: Case, seed: int, points: int, repeats: int) -> Compared:
    """Fit one case by both methods on the same cloud, by the same protocol (see `timing_note`).

    A third run is the paper's method with its scan and its model on the same grid, as
    the paper's simulator makes them, each with perturbations of its own.
    """
    element, scan = case.element, case.scan(seed, points)
    yardstick = Yardstick(element, scan)
    paper_settings = FitSettings(method="icpik")
    small = case.scan(seed, WARM_POINTS)
    for settings in (replace(paper_settings, max_iterations=WARM_ITERATIONS), FitSettings()):
        warm_up(element, small, settings)
    as_dense = (icpik, "MODEL_POINTS", points)
    with patched(as_dense):
        theirs = run(element, scan, paper_settings, yardstick=yardstick, repeats=repeats)
    ours = run(element, scan, FitSettings(), yardstick=yardstick, repeats=repeats)
    truth = dict.fromkeys(METHODS, yardstick.at_truth()[0])
    on_grid = case.scan(seed, points, layout="grid")
    cloud = simulate(element, points=points, noise_m=0.0, seed=seed + 1_000, layout="grid")
    grid_yardstick = Yardstick(element, on_grid, cloud=cloud)
    with model_cloud(element, cloud):
        on_one = run(element, on_grid, paper_settings, yardstick=grid_yardstick, repeats=repeats)
    runs = {"icpik": theirs, "grid": on_one, "default": ours}
    truth["grid"] = grid_yardstick.at_truth()[0]
    return Compared(case, runs, truth, cramer_rao(element, scan, NOISE_M))


def timing_note(repeats: int) -> str:
    """Return how the times came about."""
    return (
        f"Time: of the whole fit, the median of {repeats} in one process, after one fit of {WARM_POINTS:,} points that "
        "does not count; the same for every row. The rows' fits follow each other, so on a busy machine see "
        "`bench_peers` for ratios."
    )


def say(compared: Compared) -> None:
    """Report one case on stderr."""
    text = "; ".join(f"{m} {r.max_mm:.3g} mm, {r.iterations} it., {r.time_s:.2f} s" for m, r in compared.runs.items())
    print(f"{compared.case.name}: worst node: {text}", file=sys.stderr, flush=True)


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
