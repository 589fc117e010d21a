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

from benchlib import figures
from benchlib.bound import Bound, cramer_rao
from benchlib.cases import NOISE_M, PAPER, POINTS, Case, named
from benchlib.reports import fill_in, write_table
from benchlib.runs import Run, Yardstick, run, warm_up
from linear_ik import FitSettings

ROOT = Path(__file__).parent.parent.parent
QUICK = ("1b", "4c")
QUICK_POINTS = 2_000
ALIGNED_MM, WANTED_MM = 50.0, 0.5
METHODS = ("icpik", "default")
# Final RMSE by case study, from the text of its section 4.4.
PUBLISHED_RMSE_MM = {"1": (3.0, 6.0), "2": (4.0, 5.0), "3": (4.0, 9.0)}
PUBLISHED_TIP_MM = {"4a": 15.0, "4b": 48.0, "4c": 300.0}


@dataclass(frozen=True)
class Compared:
    """One case, fitted by both methods.

    Attributes:
        case: what was fitted.
        runs: by method.
        truth_rmse_mm: the paper's RMSE of the true shape: what a perfect fit scores.
        bound: on the nodes, for this very scan.
    """

    case: Case
    runs: dict[str, Run]
    truth_rmse_mm: float
    bound: Bound


def main(arguments: list[str] | None = None) -> int:
    """Run the cases, write the table and the pictures, and say where the runs differ from the paper."""
    parser = argparse.ArgumentParser(prog="bench_paper", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build" / "bench" / "paper", help="folder")
    parser.add_argument("--quick", action="store_true", help=f"cases {' and '.join(QUICK)} with {QUICK_POINTS} points")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated clouds")
    parser.add_argument("--docs", action="store_true", help="renew docs/figures and the table in docs/method.md too")
    options = parser.parse_args(arguments)
    points = QUICK_POINTS if options.quick else POINTS
    cases = [named(name) for name in QUICK] if options.quick else list(PAPER)
    compared = []
    for case in cases:
        compared.append(compare(case, options.seed, points, repeats=1 if options.quick else 5))
        say(compared[-1])

    rows = [row for c in compared for row in table_rows(c)]
    notes = differences(compared)
    written = write_table(
        options.output / "table1", rows, notes, points=points, seed=options.seed, noise_mm=1e3 * NOISE_M
    )
    written.append(write_curves(options.output / "curves.json", compared))
    written += draw(options.output, compared, points, options.seed)
    if options.docs:
        written += draw(ROOT / "docs" / "figures", compared, points, options.seed)
        fill_in(ROOT / "docs" / "method.md", "bench_paper", written[0].read_text(encoding="utf-8"))
    print("\n".join(str(path) for path in written))
    return 0


def compare(case: Case, seed: int, points: int, repeats: int) -> Compared:
    """Fit one case by both methods; the default ``repeats`` times, for its best time."""
    element, scan = case.element, case.scan(seed, points)
    yardstick = Yardstick(element, scan)
    warm_up(element, scan)
    runs = {
        method: run(
            element,
            scan,
            FitSettings(method=method),
            yardstick=yardstick,
            repeats=1 if method == "icpik" else repeats,
        )
        for method in METHODS
    }
    return Compared(case, runs, yardstick.at_truth()[0], cramer_rao(element, scan, NOISE_M))


def say(compared: Compared) -> None:
    """Report one case on stderr."""
    text = "; ".join(f"{m} {r.max_mm:.3g} mm, {r.iterations} it., {r.time_s:.2f} s" for m, r in compared.runs.items())
    print(f"{compared.case.name}: worst node: {text}", file=sys.stderr, flush=True)


# The table ------------------------------------------------------------------------------


def table_rows(compared: Compared) -> list[dict[str, Any]]:
    """Return three rows: what the paper says, our run of its method, our default."""
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
    for method, r in compared.runs.items():
        rows.append(
            {
                "case": case.name,
                "": case.words,
                "by": "paper's method, our run" if method == "icpik" else "default",
                "outcome": outcome(r.max_mm),
                "RMSE mm": r.cloud_rmse_mm,
                "RMSE of the truth mm": compared.truth_rmse_mm,
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
    lower = [name for name, c in by_name.items() if highest(c.case.published.rmse_mm) < runs[name].cloud_rmse_mm]
    if lower:
        floors = [by_name[n].truth_rmse_mm for n in lower]
        out.append(
            f"RMSE of {', '.join(lower)}: ours is above the published one. The true shape itself scores "
            f"{min(floors):.1f} to {max(floors):.1f} mm between two independent clouds of this density, so no fit can "
            "reach the published figures on them; they need a model cloud on the same grid as the scan, which the "
            "paper's simulator makes (see the ablation's row of that name)."
        )
    capped = [name for name, r in runs.items() if r.iterations >= 100]
    if capped:
        out.append(
            f"Iterations of {', '.join(capped)}: ours runs to the cap of 100, since the largest distance between "
            'corresponding points cannot fall below 1 mm between independent clouds. The column "settled at" is '
            "where its RMSE stops falling, which is what the published 40 to 60 and 80+ can be compared with."
        )
    for name, r in runs.items():
        case = by_name[name].case
        ours = r.max_mm <= ALIGNED_MM
        if case.study != "5" and ours != case.solved_in_paper:
            out.append(
                f"{name}: the paper calls its fit {'aligned' if case.solved_in_paper else 'a complete failure'}, ours "
                f"ends {r.max_mm:.0f} mm off at its worst node. The constants that the paper leaves open (the "
                "threshold's schedule, the weights, lambda, C and Q) decide this case; the ablation shows how much."
            )
    for name, tip in PUBLISHED_TIP_MM.items():
        if name in runs and runs[name].max_mm <= ALIGNED_MM and by_name[name].case.solved_in_paper:
            out.append(
                f"{name}: tip {runs[name].tip_mm:.0f} mm off, published {tip:.0f} mm: the same order, one cloud each."
            )
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
        shapes = {m: figures.Bent(r.q, np.asarray(r.base_pose)) for m, r in c.runs.items()}
        panels.append((f"{c.case.name}\n{c.case.words}", c.case.element, figures.Bent(scan.q, scan.base_pose), shapes))
    written += figures.draw_shapes(folder / "figure4", panels)
    curves = [
        figures.Curves(c.case.name, c.case.study, m, r.cloud_curve_mm, r.surface_curve_mm, r.node_mm, c.truth_rmse_mm)
        for c in compared
        for m, r in c.runs.items()
    ]
    written += figures.draw_rmse(folder / "figure5", curves, PUBLISHED_RMSE_MM)
    written += figures.draw_nodes(folder / "figure6", curves, PUBLISHED_TIP_MM)
    return written


if __name__ == "__main__":
    sys.exit(main())
