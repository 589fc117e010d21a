"""How exact, and how far: node errors beside the Cramer-Rao bound, and maps of success: `scripts/bench_accuracy`.

First the paper's cases over many seeds. Then maps over pairs of quantities; a fit
succeeds where its worst node is within 1 mm, or within 3 times the bound of that very
scan. Every fit is kept on disk: a run that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib import gate
from benchlib.cases import PAPER
from benchlib.cells import Cell, Outcome, as_mapping, run_all
from benchlib.maps import SuccessMap, draw_efficiency, draw_maps
from benchlib.reports import fill_in, shown, write_table
from benchlib.scenes import MAP_POINTS, MapPlan, map_plans

ROOT = Path(__file__).parent.parent.parent
METHODS = ("icpik", "default")
EFFICIENT = 1.2
RESAMPLES = 2_000
WANTED_MM = 0.5

Array = npt.NDArray[np.float64]
Places = dict[tuple[str, int, int, str], list[Outcome]]


@dataclass(frozen=True)
class Plan:
    """How much to run.

    Attributes:
        cases: names of the paper's.
        case_seeds: by method.
        map_seeds: by method.
        points: of the cases' clouds.
        maps: the maps' names; all when empty.
        thin: leave out so many of the maps' rows and columns.
    """

    cases: tuple[str, ...]
    case_seeds: dict[str, int]
    map_seeds: dict[str, int]
    points: int
    maps: tuple[str, ...] = ()
    thin: int = 1


FULL = Plan(tuple(c.name for c in PAPER), {"default": 24, "icpik": 24}, {"default": 6, "icpik": 4}, 10_000)
QUICK = Plan(("1b", "4c"), {"default": 3, "icpik": 1}, {"default": 1, "icpik": 1}, 2_000, ("joints that bend",), 3)


def main(arguments: list[str] | None = None) -> int:
    """Run what is not in the cache yet, and write tables and pictures."""
    parser = argparse.ArgumentParser(prog="bench_accuracy", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "accuracy", help="folder")
    parser.add_argument("--quick", action="store_true", help="two cases, one small map, few seeds")
    parser.add_argument("--docs", action="store_true", help="renew docs/figures and the tables in docs/method.md too")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="processes")
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    plan = QUICK if options.quick else FULL
    maps = [m.thinned(plan.thin) for m in map_plans() if not plan.maps or m.title in plan.maps]
    case_cells = {
        (name, m): Cell(m, tuple(range(1, plan.case_seeds[m] + 1)), case=name, points=plan.points)
        for name in plan.cases
        for m in METHODS
    }
    map_cells = {
        (m.title, i, j, method): Cell(method, tuple(range(1, plan.map_seeds[method] + 1)), m.scene(i, j))
        for m in maps
        for i in range(len(m.y))
        for j in range(len(m.totals_deg))
        for method in METHODS
        if m.scene(i, j).possible
    }
    found = run_all([*case_cells.values(), *map_cells.values()], options.out / "cache", options.workers)
    by_case = {key: found[cell] for key, cell in case_cells.items()}
    by_place = {key: found[cell] for key, cell in map_cells.items()}

    rows = [efficiency_row(name, m, by_case[name, m]) for name in plan.cases for m in METHODS]
    violations = beyond_default(by_place)
    written = write_table(options.out / "efficiency", rows, efficiency_notes(rows), brief(rows))
    written += write_table(
        options.out / "maps", [map_row(m, by_place) for m in maps], map_notes(by_place, violations, plan)
    )
    cells = [as_mapping(cell, outcomes) for cell, outcomes in found.items()]
    (options.out / "cells.json").write_text(json.dumps(cells) + "\n", encoding="utf-8")
    folders = [options.out, *([ROOT / "docs" / "figures"] if options.docs else [])]
    for folder in folders:
        written += draw(folder, plan, by_case, maps, by_place)
    if options.docs:
        document = ROOT / "docs" / "method.md"
        for name in ("efficiency", "maps"):
            text = (options.out / f"{name}.md").read_text(encoding="utf-8")
            fill_in(document, f"bench_accuracy {name}", text)
    print("\n".join(str(path) for path in written))
    mode = "quick" if options.quick else "full"
    made_with = {"points": plan.points, "seeds": plan.case_seeds, "map seeds": plan.map_seeds, "thin": plan.thin}
    return gate.finish("bench_accuracy", mode, metrics(rows, maps, by_place, violations), options, made_with)


def metrics(
    rows: Sequence[dict[str, Any]], maps: Sequence[MapPlan], places: Places, violations: Sequence[str]
) -> list[gate.Metric]:
    """Return what the gate holds: errors relative to the bound, shares of success, and whose reach is wider."""
    ours = [row for row in rows if row["method"] == "default"]
    out = [gate.Metric(f"{r['case']}: nodes / bound", r["nodes / bound"], noise=0.05, target=EFFICIENT) for r in ours]
    out += [
        gate.Metric(f"{m.title}: success, %", map_row(m, places)["default succeed %"], noise=0.02, better="higher")
        for m in maps
    ]
    beyond = gate.Metric("fits where the paper's method reaches farther", float(len(violations)), noise=0.0, target=0.0)
    return [*out, beyond]


# Errors beside the bound ----------------------------------------------------------------


def efficiency_row(name: str, method: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the errors of one case and method over its seeds, beside the bound.

    The ratios are of root mean squares, over the seeds and nodes: the bound is on those.
    """
    rms, tip, worst = (np.array([getattr(o, f"{k}_mm") for o in outcomes]) for k in ("rms", "tip", "max"))
    bound_rms, bound_tip = (np.array([getattr(o, f"bound_{k}_mm") for o in outcomes]) for k in ("rms", "tip"))
    low, high = interval(rms, bound_rms)
    return {
        "case": name,
        "method": method,
        "seeds": len(outcomes),
        "nodes rms mm": root_mean_square(rms),
        "bound mm": root_mean_square(bound_rms),
        "nodes / bound": root_mean_square(rms) / root_mean_square(bound_rms),
        "nodes / bound, low": low,
        "nodes / bound, high": high,
        "mean nodes / bound": float(np.mean(rms / bound_rms)),
        "tip rms mm": root_mean_square(tip),
        "tip bound mm": root_mean_square(bound_tip),
        "tip / bound": root_mean_square(tip) / root_mean_square(bound_tip),
        "worst node mm": float(worst.max()),
        "converged": f"{sum(o.status == 'converged' for o in outcomes)}/{len(outcomes)}",
        "iterations": float(np.median([o.iterations for o in outcomes])),
    }


def root_mean_square(values: Array) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


def interval(errors: Array, bounds: Array) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of root mean squares, by drawing the seeds anew with replacement."""
    drawn = np.random.default_rng(0).integers(len(errors), size=(RESAMPLES, len(errors)))
    ratios = np.sqrt((errors[drawn] ** 2).mean(axis=1) / (bounds[drawn] ** 2).mean(axis=1))
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(low), float(high)


def brief(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows for a reader: the interval beside its ratio."""
    out = []
    for row in rows:
        told = {key: value for key, value in row.items() if not key.endswith((", low", ", high"))}
        ends = (shown(row[f"nodes / bound, {end}"]) for end in ("low", "high"))
        told["nodes / bound"] = f"{shown(row['nodes / bound'])} ({' to '.join(ends)})"
        out.append(told)
    return out


def efficiency_notes(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return what the default misses of what it must show, or that it misses nothing."""
    ours = [row for row in rows if row["method"] == "default"]
    late = [f"{r['case']} ({r['nodes / bound']:.2f})" for r in ours if r["nodes / bound"] > EFFICIENT]
    tips = [f"{r['case']} ({r['tip / bound']:.2f})" for r in ours if r["tip / bound"] > EFFICIENT]
    far = [f"{r['case']} ({r['worst node mm']:.2f} mm)" for r in ours if r["worst node mm"] > WANTED_MM]
    return [
        "In brackets the 95 % interval of the ratio over the seeds, drawn anew with replacement.",
        f"Default, nodes above {EFFICIENT} x the bound: {', '.join(late) or 'none'}.",
        f"Default, tip above {EFFICIENT} x the bound: {', '.join(tips) or 'none'}.",
        f"Default, worst node of any seed above {WANTED_MM} mm: {', '.join(far) or 'none'}.",
        "Below 1 is possible: the bound is for unbiased methods, and the default knows from the scan itself how much "
        "its member bends (its prior).",
    ]


# Maps -----------------------------------------------------------------------------------


def beyond_default(places: Places) -> list[str]:
    """Return the fits that the paper's method succeeds with and the default does not, by either measure."""
    out = []
    for (title, i, j, method), outcomes in places.items():
        if method != "icpik":
            continue
        ours = {o.seed: o for o in places[title, i, j, "default"]}
        for theirs in outcomes:
            mine = ours[theirs.seed]
            for measure in ("succeeded", "aligned"):
                if getattr(theirs, measure) and not getattr(mine, measure):
                    out.append(
                        f"{title}, row {i}, column {j}, seed {theirs.seed}: {measure} with {theirs.max_mm:.2f} mm, "
                        f"the default {mine.max_mm:.2f} mm (bound {mine.bound_max_mm:.2f} mm)"
                    )
    return out


def map_row(plan: MapPlan, places: Places) -> dict[str, Any]:
    """Return the shares of one map, over its cells that show every bend."""
    row: dict[str, Any] = {"map": plan.title}
    for method in METHODS:
        outcomes = [o for (title, _, _, m), some in places.items() if (title, m) == (plan.title, method) for o in some]
        seen = [o for o in outcomes if o.observable]
        row[f"{method} fits"] = len(outcomes)
        row[f"{method} succeed %"] = 100.0 * float(np.mean([o.succeeded for o in seen]))
        row[f"{method} within 50 mm %"] = 100.0 * float(np.mean([o.aligned for o in seen]))
        row[f"{method} wrong but converged"] = sum(o.status == "converged" and not o.succeeded for o in outcomes)
    return row


def map_notes(places: Places, violations: Sequence[str], plan: Plan) -> list[str]:
    """Return how the maps were made, and where the default fails."""
    failed = [
        f"{title}, row {i}, column {j}: {sum(not o.succeeded for o in some)} of {len(some)} seeds, worst "
        f"{max(o.max_mm for o in some):.2f} mm"
        for (title, i, j, method), some in places.items()
        if method == "default" and not all(o.succeeded for o in some)
    ]
    return [
        f"Seeds a cell: {plan.map_seeds['default']} for the default, {plan.map_seeds['icpik']} of the same for the "
        f"paper's method, which is slow; {MAP_POINTS} points a scan (100 a segment where there are more than 40), "
        "and as many on the paper's model. Shares are over the scans that show every bend.",
        f"Fits where the paper's method succeeds, or comes within 50 mm, and the default does not: {len(violations)}.",
        *violations,
        f"Cells in which the default fails for some seed (rows and columns from 0): {len(failed)}.",
        *failed,
    ]


def draw(
    folder: Path, plan: Plan, by_case: dict[tuple[str, str], list[Outcome]], maps: Sequence[MapPlan], places: Places
) -> list[Path]:
    """Draw errors beside the bound, and the maps by both measures of success."""
    written = []
    for kind, words in (("rms", "root mean square of the nodes' errors"), ("tip", "error of the tip")):
        errors = {m: [np.array([getattr(o, f"{kind}_mm") for o in by_case[c, m]]) for c in plan.cases] for m in METHODS}
        bounds = [float(np.mean([getattr(o, f"bound_{kind}_mm") for o in by_case[c, "default"]])) for c in plan.cases]
        written += draw_efficiency(folder / f"bound_{kind}", plan.cases, errors, bounds, words)
    for measure in ("succeeded", "aligned"):
        written += draw_maps(folder / f"maps_{measure}", [success_map(m, places, measure) for m in maps])
    return written


def success_map(plan: MapPlan, places: Places, measure: str) -> SuccessMap:
    """Return a map ready to be drawn."""
    shape = (len(plan.y), len(plan.totals_deg))
    share = {method: np.full(shape, np.nan) for method in METHODS}
    observable = np.ones(shape, dtype=bool)
    for (title, i, j, method), outcomes in places.items():
        if title == plan.title:
            share[method][i, j] = np.mean([getattr(o, measure) for o in outcomes])
            observable[i, j] &= np.mean([o.observable for o in outcomes]) > 0.5
    columns = [f"{total:g}" for total in plan.totals_deg]
    return SuccessMap(
        plan.title, "bends in total, degrees", columns, plan.y_label, [label for label, _ in plan.y], share, observable
    )


if __name__ == "__main__":
    sys.exit(main())
