"""Scans as they are: random scenes, calibration, and what captured scans do, one at a time: `scripts/bench_scenes`.

Every figure is against truth. Every fit is kept on disk: a run that was interrupted goes
on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from benchlib import gate
from benchlib.calibration import calibration_notes, calibration_row, draw_calibration, kinds
from benchlib.named_scenes import CASES
from benchlib.reports import fill_in, write_table
from benchlib.scene_fits import RANDOM, SceneOutcome, run_scenes
from benchlib.scene_tables import case_notes, case_row, metrics, random_notes, random_rows, worst

ROOT = Path(__file__).parent.parent.parent
# Goes with the table: until both are made the page shows neither.
PICTURE = (
    "![squared distances of node errors beside their chi-square density; observed beside stated shares]"
    "(figures/calibration.png)"
)
SCENES, CASE_SEEDS = 500, 8
QUICK_SCENES, QUICK_CASES = 12, ("i_shape, one station", "neighbour at 50 mm", "one face visible")


def main(arguments: list[str] | None = None) -> int:
    """Run what is not in the cache yet, and write tables and pictures."""
    parser = argparse.ArgumentParser(prog="bench_scenes", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "bench_output" / "scenes", help="folder")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_SCENES} scenes and three cases, a minute")
    parser.add_argument("--docs", action="store_true", help="renew docs/scenes.md and docs/figures too")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1), help="processes")
    parser.add_argument("--scenes", type=int, help=f"random scenes; default: {SCENES}, quick {QUICK_SCENES}")
    parser.add_argument("--seed", type=int, default=1, help="of the first random scene; the others follow it")
    parser.add_argument(
        "--worst", type=int, metavar="K", default=0, help="print the K worst failures, claimed ones first"
    )
    gate.add_arguments(parser)
    options = parser.parse_args(arguments)
    scenes = options.scenes if options.scenes is not None else QUICK_SCENES if options.quick else SCENES
    if scenes < 1:
        parser.error("--scenes: at least 1")
    cases = QUICK_CASES if options.quick else tuple(CASES)
    seeds = range(1, (2 if options.quick else CASE_SEEDS) + 1)
    jobs = [(RANDOM, seed) for seed in range(options.seed, options.seed + scenes)]
    jobs += [(case, seed) for case in cases for seed in seeds]
    outcomes = run_scenes(jobs, options.out / "cache", options.workers)
    drawn = [o for o in outcomes if o.kind == RANDOM]
    by_case = {case: [o for o in outcomes if o.kind == case] for case in cases}

    written = write(options.out, drawn, by_case, outcomes)
    pictures = draw_calibration(options.out / "calibration", kinds(outcomes))
    if options.docs:
        draw_calibration(ROOT / "docs" / "figures" / "calibration", kinds(outcomes))
        for name in ("random", "calibration", "cases"):
            text = (options.out / f"{name}.md").read_text(encoding="utf-8")
            if name == "calibration":
                text += f"\n{PICTURE}\n"
            fill_in(ROOT / "docs" / "scenes.md", f"bench_scenes {name}", text)
    print("\n".join(str(path) for path in written + pictures))
    if options.worst:
        print("\n".join(worst(outcomes, options.worst)), file=sys.stderr)
    mode = "quick" if options.quick else "full"
    return gate.finish("bench_scenes", mode, metrics(outcomes, by_case), options)


def write(
    folder: Path,
    drawn: Sequence[SceneOutcome],
    by_case: dict[str, list[SceneOutcome]],
    outcomes: Sequence[SceneOutcome],
) -> list[Path]:
    """Write the three tables, and every outcome as JSON."""
    calibration = [calibration_row(kind, some) for kind, some in kinds(outcomes).items()]
    out = write_table(folder / "random", random_rows(drawn), random_notes(drawn))
    out += write_table(folder / "calibration", calibration, calibration_notes(calibration))
    rows = [case_row(name, some) for name, some in by_case.items()]
    out += write_table(folder / "cases", rows, case_notes(by_case))
    every = folder / "outcomes.json"
    every.write_text(json.dumps([asdict(o) for o in outcomes]) + "\n", encoding="utf-8")
    return [*out, every]


if __name__ == "__main__":
    sys.exit(main())
