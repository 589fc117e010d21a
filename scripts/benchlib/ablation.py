"""One choice changed at a time, in both methods: `scripts/bench_ablation`.

Three groups: the default with a term, a stage or a solver changed; ways to pair points
in the library's loop without any search; and the paper's method with each constant that
it does not give.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchlib.cells import Cell, Outcome, run_all
from benchlib.reports import fill_in, write_table
from benchlib.scenes import Scene
from benchlib.variants import Variant, default_variants, icpik_variants, pairing_variants

ROOT = Path(__file__).parent.parent.parent
CODE = ("variants.py", "pairings.py", "runs.py")


@dataclass(frozen=True)
class Place:
    """A scene of the ablation: one of the paper's cases, or a scene of the maps.

    Attributes:
        name: column's heading.
        case: of the paper.
        scene: where there is no case.
    """

    name: str
    case: str = ""
    scene: Scene | None = None

    def cell(self, variant: str, seeds: int, points: int) -> Cell:
        """Return the cell of a variant here."""
        return Cell(variant, tuple(range(1, seeds + 1)), self.scene, self.case, points)


@dataclass(frozen=True)
class Group:
    """Variants of one method, compared on the same scenes.

    Attributes:
        name: of the table.
        title: what it compares.
        variants: the first is what the others are changed from.
        places: where.
        seeds: a scene.
    """

    name: str
    title: str
    variants: Sequence[Variant]
    places: tuple[Place, ...]
    seeds: int


CLEAN, KNEE, H_SECTION, HALF = (
    Place("22.5° (1b)", "1b"),
    Place("45° (1c)", "1c"),
    Place("H (3c)", "3c"),
    Place("half missing (4c)", "4c"),
)
WALL = Place("90° arc, wall", scene=Scene(90.0, points=4_000, clutter=0.3))
OPEN_H = Place("60° arc, H, half missing", scene=Scene(60.0, profile="h", points=6_000, faces_missing=("+x", "+y")))


def groups(quick: bool) -> list[Group]:
    """Return what is compared."""
    out = [
        Group(
            "default",
            "The default, one choice changed",
            default_variants(),
            (CLEAN, KNEE, H_SECTION, HALF, WALL, OPEN_H),
            5,
        ),
        Group(
            "pairing",
            "Ways to pair points, from the design, without a search",
            pairing_variants(),
            (CLEAN, KNEE, H_SECTION, HALF),
            5,
        ),
        Group("icpik", "The paper's method, one constant changed", icpik_variants(), (CLEAN, HALF), 5),
    ]
    if quick:
        out = [Group(g.name, g.title, g.variants[:3], g.places[:1], 1) for g in out]
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run what is not in the cache yet, and write one table a group."""
    parser = argparse.ArgumentParser(prog="bench_ablation", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "ablation", help="folder")
    parser.add_argument("--quick", action="store_true", help="three variants a group, one scene, one seed")
    parser.add_argument("--docs", action="store_true", help="renew the tables in docs/method.md too")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="processes")
    options = parser.parse_args(arguments)
    points = 2_000 if options.quick else 10_000
    compared = groups(options.quick)
    cells = {
        (g.name, v.name, p.name): p.cell(v.name, g.seeds, points)
        for g in compared
        for v in g.variants
        for p in g.places
    }
    found = run_all(list(cells.values()), options.out / "cache", options.workers, CODE)
    written: list[Path] = []
    for group in compared:
        outcomes = {
            (v.name, p.name): found[cells[group.name, v.name, p.name]] for v in group.variants for p in group.places
        }
        rows = [row(v, group.places, outcomes) for v in group.variants]
        brief = [brief_row(v, group.places, outcomes) for v in group.variants]
        note = (
            f"{group.title}: median over {group.seeds} seeds of the nodes' rms error in mm, and how many seeds had "
            "every node within 1 mm (or 3 x the bound). Iterations: median over the scenes."
        )
        written += write_table(options.out / group.name, rows, [note], brief, points=points)
        if options.docs:
            text = (options.out / f"{group.name}.md").read_text(encoding="utf-8")
            fill_in(ROOT / "docs" / "method.md", f"bench_ablation {group.name}", text)
    print("\n".join(str(path) for path in written))
    return 0


Outcomes = dict[tuple[str, str], list[Outcome]]


def row(variant: Variant, places: Sequence[Place], outcomes: Outcomes) -> dict[str, Any]:
    """Return the figures of a variant, one number a column."""
    out: dict[str, Any] = {"variant": variant.title}
    for place in places:
        some = outcomes[variant.name, place.name]
        out[f"{place.name}: nodes rms mm"] = float(np.median([o.rms_mm for o in some]))
        out[f"{place.name}: worst node mm"] = max(o.max_mm for o in some)
        out[f"{place.name}: bound mm"] = float(np.median([o.bound_rms_mm for o in some]))
        out[f"{place.name}: seeds"] = len(some)
        out[f"{place.name}: succeeded"] = sum(o.succeeded for o in some)
    return {**out, "iterations": _iterations(variant, outcomes)}


def brief_row(variant: Variant, places: Sequence[Place], outcomes: Outcomes) -> dict[str, Any]:
    """Return the figures of a variant, one column a scene."""
    out: dict[str, Any] = {"variant": variant.title}
    for place in places:
        some = outcomes[variant.name, place.name]
        rms_mm = float(np.median([o.rms_mm for o in some]))
        out[place.name] = f"{rms_mm:.3g} · {sum(o.succeeded for o in some)}/{len(some)}"
    return {**out, "iterations": _iterations(variant, outcomes)}


def _iterations(variant: Variant, outcomes: Outcomes) -> float:
    """Return the median over the scenes. Times are not told: they were taken beside other fits (see `bench_peers`)."""
    return float(
        np.median(
            [np.median([o.iterations for o in some]) for (name, _), some in outcomes.items() if name == variant.name]
        )
    )


if __name__ == "__main__":
    sys.exit(main())
