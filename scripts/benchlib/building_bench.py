"""`scripts/bench_building`: how well, how fast and in how much memory a whole building is fitted."""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchlib.building import Building, bays_for, building, built_from, stations
from benchlib.building_ifc import write_ifc
from benchlib.building_scan import Seen, scan_building
from linear_ik import FitResult, read_result
from linear_ik.bending import BentElement
from linear_ik.bim import read_design

Array = npt.NDArray[np.float64]

WITHIN_M = 0.002
WIDE = 3.0  # standard deviations that the stated covariance allows
SEEN_A_SEGMENT = 50  # returns on each segment make an element scanned


@dataclass(frozen=True)
class Node:
    """The worst error of one element.

    Attributes:
        across_m: across its true axis.
        along_m: along it.
        deviations: of the stated covariance, the larger of the two directions.
    """

    across_m: float
    along_m: float
    deviations: float


def main() -> int:
    """Make the building, fit it, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--elements", default="40", help="at least so many; several for a slope: 100,300,1000")
    parser.add_argument(
        "--points", type=float, default=5e6, help="returns of all stations, about, for the most elements"
    )
    parser.add_argument("--design", type=Path, help="an IFC file in place of the generated frame; a floor is added")
    parser.add_argument("--stations", type=int, default=0, help="4, or one for every 40 elements")
    parser.add_argument("--format", default="e57", choices=("e57", "las", "laz"), help="LAS and LAZ name no stations")
    parser.add_argument("--workers", default="", help="runs, such as 1,2; of more than 100 elements one run with 2")
    parser.add_argument("--no-contest", action="store_true", help="neighbours do not compete (through the Python API)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for design, scan and results; goes on where it stopped")
    asked = parser.parse_args()
    counts = [1] if asked.design else [int(n) for n in asked.elements.split(",")]
    each: dict[int, tuple[float, float]] = {}
    with tempfile.TemporaryDirectory(prefix="bench_building") as temporary:
        folder = asked.keep or Path(temporary)
        for least in counts:
            own = folder if len(counts) == 1 else folder / str(least)
            own.mkdir(parents=True, exist_ok=True)
            points = int(asked.points * least / max(counts))
            if asked.design:
                plan = built_from(read_design(asked.design), asked.seed)
            else:
                plan = building(*bays_for(least), seed=asked.seed)
            ran = bench(asked, plan, points, own)
            if ran is None:
                return 1
            each |= ran
    if len(each) > 1:
        print()
        for i, name in enumerate(("time", "processor")):
            print(slope(name, {n: seconds[i] for n, seconds in each.items()}))
    return 0


def slope(name: str, each: dict[int, float]) -> str:
    """Return a line on how the seconds an element grow with the number of elements: their exponent by least squares."""
    exponent = float(np.polyfit(np.log(list(each)), np.log(list(each.values())), 1)[0])
    costs = ", ".join(f"{n:,}: {s:.2f}" for n, s in each.items())
    return f"slope       {name} an element goes with their number to the power of {exponent:+.3f} ({costs} s)"


def bench(
    asked: argparse.Namespace, plan: Building, points: int, folder: Path
) -> dict[int, tuple[float, float]] | None:
    """Run a building in a folder; return time and processor seconds an element of its last run, None where it failed.

    They stand under the number of its elements.
    """
    n = len(plan.design.members)
    design, scan = folder / "design.ifc", folder / f"scan.{asked.format}"
    seen_file = folder / "seen.json"
    if not seen_file.exists():
        if asked.design:
            shutil.copyfile(asked.design, design)
        else:
            write_ifc(plan, design)
        places = stations(plan, asked.stations or max(4, n // 40))
        began = time.perf_counter()
        seen = scan_building(plan, places, points, scan, asked.seed)
        print(f"scan        {seen.points:,} points of {len(places)} stations in {time.perf_counter() - began:.0f} s")
        hits = {guid: h.tolist() for guid, h in seen.hits.items()}
        seen_file.write_text(json.dumps({"points": seen.points, "hits": hits}))
    stored = json.loads(seen_file.read_text())
    seen = Seen({guid: np.array(h) for guid, h in stored["hits"].items()}, stored["points"])
    runs = [int(w) for w in (asked.workers or ("1,2" if n <= 100 else "2")).split(",")]
    seconds: dict[int, float] = {}
    for workers in runs:
        out = folder / f"asbuilt-{workers}"
        arguments = [str(design), str(scan), "-o", str(out), "--workers", str(workers)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        peak_mb, exit_code = measured([sys.executable, "-m", "linear_ik", "fit", *arguments])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if exit_code:
            print(f"linear-ik fit ended with {exit_code}")
            return None
        report = json.loads((out / "run.json").read_text())
        timings = report["timings_s"]
        seconds[workers] = timings["first_fits"] + timings["contest"]
        each = seconds[workers] / n
        print(f"\nworkers     {workers}")
        print("seconds     " + ", ".join(f"{name} {value:.1f}" for name, value in timings.items()))
        print(f"an element  {each:.2f} s of fits; {timings['total'] / n:.2f} s of everything")
        busy = f"load {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores"
        print(f"processor   {cpu_s / n:.2f} s an element, everything; {busy}")
        print(f"memory      {peak_mb:,.0f} MB at most, all processes together (their own pages)")
        accuracy(plan, seen, out)
    if len(runs) > 1:
        low, high = min(runs), max(runs)
        print(f"\nthroughput  {seconds[low] / seconds[high]:.2f} times with {high} workers against {low}")
    return {n: (timings["total"] / n, cpu_s / n)}


def accuracy(plan: Building, seen: Seen, out: Path) -> None:
    """Print how many elements are where they are."""
    statuses, wrong, within, scanned, worst = Counter[str](), [], 0, 0, []
    for member in plan.design.members:
        path = out / "elements" / f"{member.guid}.json"
        if not path.exists():
            statuses["failed"] += 1
            continue
        result = read_result(path)
        statuses[result.status] += 1
        error = error_of(result, plan.built[member.guid])
        if result.status == "converged" and error.across_m > WITHIN_M and error.deviations > WIDE:
            wrong.append(member.guid)
        if seen.hits[member.guid].min() >= SEEN_A_SEGMENT:
            scanned += 1
            within += error.across_m <= WITHIN_M
            if error.across_m > WITHIN_M:
                worst.append((error, result.status, member.guid))
    print("status      " + ", ".join(f"{k} {v}" for k, v in statuses.items()))
    share = 100 * within / max(scanned, 1)
    print(f"within 2 mm {within} of {scanned} scanned elements ({share:.1f} %), every node, across the axis")
    print(f"claimed     {len(wrong)} converged wrongly: more than 2 mm across and {WIDE:g} deviations off {wrong}")
    for error, status, guid in worst:
        print(f"  {guid} {1e3 * error.across_m:.1f} mm across ({error.deviations:.1f} deviations), {status}")


def error_of(result: FitResult, truth: BentElement) -> Node:
    """Return an element's worst node, against the true axis at the same place along it."""
    n = result.element.segments
    place = np.linspace(0, len(truth.nodes_m) - 1, n + 1)
    true = np.column_stack([np.interp(place, np.arange(len(truth.nodes_m)), column) for column in truth.nodes_m.T])
    off = result.nodes_m - true
    axis = truth.nodes_m[-1] - truth.nodes_m[0]
    axis /= np.linalg.norm(axis)
    along = off @ axis
    across = off - along[:, None] * axis
    size = np.linalg.norm(across, axis=1)
    unit = across / np.maximum(size, 1e-12)[:, None]
    # A polyline of other segments is itself off the true one by a little.
    variance = np.einsum("ki,kij,kj->k", unit, result.nodes_covariance_m2, unit) + 0.0002**2
    return Node(float(size.max()), float(np.abs(along).max()), float((size / np.sqrt(variance)).max()))


def measured(command: list[str]) -> tuple[float, int]:
    """Run a command; return the most memory of it and its children in MB, and its exit code."""
    process = subprocess.Popen(command)
    peak, over = [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.5):
            peak[0] = max(peak[0], sum(_own_mb(pid) for pid in _family(process.pid)))

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    code = process.wait()
    over.set()
    watcher.join()
    return peak[0], code


def _family(pid: int) -> list[int]:
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return [pid]
    return [pid, *(p for child in children for p in _family(int(child)))]


def _own_mb(pid: int) -> float:
    """Return the proportional set size: shared pages are counted once over all processes."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


if __name__ == "__main__":
    sys.exit(main())
