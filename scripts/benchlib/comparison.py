"""Runs beside what the paper published: the table's rows, and where and why they differ, in words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchlib import gate
from benchlib.bound import Bound
from benchlib.cases import Case
from benchlib.reports import shown
from benchlib.runs import Run
from linear_ik import icpik

ALIGNED_MM, WANTED_MM = 50.0, 0.5
PUBLISHED_TIP_MM = {"4a": 15.0, "4b": 48.0, "4c": 300.0}
BY = {
    "icpik": "paper's method, our run",
    "grid": "paper's method, clouds on one grid",
    "default": "default",
}


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


def metrics(compared: list[Compared]) -> list[gate.Metric]:
    """Return what the gate holds: the default's worst nodes, and its iterations in the paper's own cases."""
    out = [
        gate.Metric(f"{c.case.name}: worst node, mm", c.runs["default"].max_mm, noise=0.2, target=WANTED_MM)
        for c in compared
    ]
    iterations = [c.runs["default"].iterations for c in compared if c.case.study != "5"]
    return [*out, gate.Metric("median iterations", float(np.median(iterations)), noise=0.2, target=10.0)]


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


def brief(rows: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Return the rows for a reader: what belongs together in one column."""

    def pair(row: dict[str, Any], first: str, second: str) -> str:
        beside = shown(row[second])
        return shown(row[first]) if beside == "-" else f"{shown(row[first])} ({beside})"

    return [
        {
            "case": f"{row['case']} {row['']}",
            "by": row["by"],
            "outcome": row["outcome"],
            "RMSE mm (of the truth)": pair(row, "RMSE mm", "RMSE of the truth mm"),
            "to surface mm": shown(row["to surface mm"]),
            "tip mm": shown(row["tip mm"]),
            "worst node mm": shown(row["worst node mm"]),
            "nodes rms mm (bound)": pair(row, "nodes rms mm", "bound rms mm"),
            "iterations (settled at)": pair(row, "iterations", "settled at"),
            "time s": shown(row["time s"]),
        }
        for row in rows
    ]


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
    nearer = [n for n, r in grid.items() if r.rms_mm < by_name[n].runs["default"].rms_mm]
    if nearer:
        out.append(
            f"On one grid the paper's method is nearer than the default in {', '.join(nearer)}: its pairs are then the "
            "same points of the grid, which holds them along the faces as well. No scanner makes such pairs."
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
