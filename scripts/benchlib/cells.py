"""Cells of the benchmark of accuracy: one scene, one method, some seeds, kept on disk when done."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from benchlib.bound import cramer_rao
from benchlib.cases import NOISE_M, POINTS, named
from benchlib.runs import patched, warm_up
from benchlib.scenes import Scene

# What figures may differ by from release to release though no line of ours changed.
PACKAGES = ("numpy", "scipy", "open3d-cpu", "open3d", "osqp", "qpsolvers", "pin")
# One thread each: workers would otherwise get in each other's way, and sums be added up in another order.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
# What no fit depends on: files, formats and screens.
ROOMS_ABOVE = ("cli", "exports", "readers", "viewer", "viewer_page", "example", "__main__", "report", "batch")


J = TypeVar("J")


@dataclass(frozen=True)
class Outcome:
    """One fit of one seed.

    Attributes:
        seed: of the scene.
        status: the fit's verdict on itself.
        max_mm, rms_mm, tip_mm: node errors: the worst, the root mean square, the last.
        bound_max_mm, bound_rms_mm, bound_tip_mm: the Cramer-Rao bound of the same.
        observable: whether the scan shows every bend.
        time_s: wall time of the fit, beside whatever the other workers did: not to be
            compared between methods; `bench_peers` is for that.
        iterations: of the fit.
    """

    seed: int
    status: str
    max_mm: float
    rms_mm: float
    tip_mm: float
    bound_max_mm: float
    bound_rms_mm: float
    bound_tip_mm: float
    observable: bool
    time_s: float
    iterations: int

    @property
    def succeeded(self) -> bool:
        """Whether every node is within 1 mm, or 3 times the bound where that is more."""
        return self.max_mm <= max(1.0, 3.0 * self.bound_max_mm)

    @property
    def aligned(self) -> bool:
        """Whether it is as good as what the paper calls a success: within 50 mm."""
        return self.max_mm <= 50.0


@dataclass(frozen=True)
class Cell:
    """Some seeds of one scene, for one method.

    Attributes:
        method: "default" or "icpik", or the name of one of `variants`.
        seeds: of the scene.
        scene: of a map, or None.
        case: name of one of the paper's cases, where there is no scene.
        points: of the case, and of icpik's cloud on the model.
    """

    method: str
    seeds: tuple[int, ...]
    scene: Scene | None = None
    case: str = ""
    points: int = POINTS

    def key(self, seed: int) -> str:
        """Return the name of the file that holds the outcome of a seed."""
        scene = None if self.scene is None else self.scene.as_mapping()
        told = json.dumps([self.method, scene, self.case, self.points, seed], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:20]


def run_all(cells: Sequence[Cell], folder: Path, workers: int, code: Sequence[str] = ()) -> dict[Cell, list[Outcome]]:
    """Return the outcomes of every cell, taken from the cache where they are there.

    Args:
        cells: what to run.
        folder: the cache; what was made by other code than today's is not used.
        workers: processes.
        code: files beside this one that the outcomes depend on too.
    """
    jobs = {cell.key(seed): (cell, seed) for cell in cells for seed in cell.seeds}
    found = keep(jobs, _run_one, folder, workers, code)
    return {cell: [Outcome(**found[cell.key(seed)]) for seed in cell.seeds] for cell in cells}


def keep(
    jobs: Mapping[str, J],
    run: Callable[[J], Mapping[str, Any]],
    folder: Path,
    workers: int,
    code: Sequence[str] = (),
    every: int = 50,
) -> dict[str, dict[str, Any]]:
    """Return what each job came to, taken from the cache where it is there.

    Args:
        jobs: by a name that is good for a file.
        run: does one; a function of a module, so that other processes find it. What it
            returns is ready for JSON.
        folder: the cache; what was made by other code than today's is not used.
        workers: processes.
        code: files beside this one that the outcomes depend on too.
        every: how many fits are done between two words on standard error.
    """
    kept = folder / fingerprint(code)
    kept.mkdir(parents=True, exist_ok=True)
    (folder / ".gitignore").write_text("*\n", encoding="utf-8")
    left = [(run, name, job) for name, job in jobs.items() if not (kept / f"{name}.json").exists()]
    print(f"{len(jobs)} fits, {len(jobs) - len(left)} of them done before", file=sys.stderr, flush=True)
    started = time.monotonic()
    for done, (name, outcome) in enumerate(_results(left, workers), start=1):
        path = kept / f"{name}.json"
        path.with_suffix(".new").write_text(json.dumps(outcome), encoding="utf-8")
        path.with_suffix(".new").replace(path)
        if done % every == 0 or done == len(left):
            spent = time.monotonic() - started
            print(f"{done} of {len(left)} fits, {spent:.0f} s", file=sys.stderr, flush=True)
    return {name: json.loads((kept / f"{name}.json").read_text(encoding="utf-8")) for name in jobs}


def _results(jobs: list[tuple[Any, str, Any]], workers: int) -> Iterable[tuple[str, Mapping[str, Any]]]:
    if workers <= 1 or len(jobs) <= 1:
        yield from map(_named, jobs)
        return
    os.environ.update(ONE_THREAD)
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        yield from pool.imap_unordered(_named, jobs, chunksize=1)


def _named(job: tuple[Callable[[Any], Mapping[str, Any]], str, Any]) -> tuple[str, Mapping[str, Any]]:
    run, name, what = job
    return name, run(what)


def _run_one(job: tuple[Cell, int]) -> dict[str, Any]:
    return asdict(run_one(job)[2])


def run_one(job: tuple[Cell, int]) -> tuple[Cell, int, Outcome]:
    """Run one seed of a cell."""
    from linear_ik import FitSettings, fit, icpik
    from linear_ik.settings import Method

    cell, seed = job
    if cell.scene is not None:
        element, scan, noise_m, points = (
            cell.scene.element,
            cell.scene.scan(seed),
            cell.scene.noise_m,
            cell.scene.points,
        )
    else:
        case = named(cell.case)
        element, scan, noise_m, points = case.element, case.scan(seed, cell.points), NOISE_M, cell.points
    bound = cramer_rao(element, scan, noise_m)
    warm_up_once()
    with patched((icpik, "MODEL_POINTS", points)):
        if cell.method in get_args(Method):
            started = time.perf_counter()
            result = fit(element, scan.without_truth(), FitSettings(method=cell.method))  # type: ignore[arg-type]
            nodes, status, iterations = result.nodes_m, result.status, result.iterations
            time_s = time.perf_counter() - started
        else:
            from benchlib.variants import all_variants

            nodes, status, iterations, time_s = all_variants()[cell.method].run(element, scan)
    errors = 1e3 * np.linalg.norm(nodes - scan.nodes_m, axis=1)
    outcome = Outcome(
        seed,
        status,
        float(errors.max()),
        float(np.sqrt(np.mean(errors[1:] ** 2))),
        float(errors[-1]),
        1e3 * float(bound.node_m.max()),
        1e3 * bound.rms_m,
        1e3 * bound.tip_m,
        bound.observable,
        time_s,
        iterations,
    )
    return cell, seed, outcome


@cache
def warm_up_once() -> None:
    """Fit once in each process before anything is timed: the first fit pays for the imports."""
    case = named("1b")
    warm_up(case.element, case.scan(1, 1_000))


def fingerprint(code: Sequence[str] = ()) -> str:
    """Return a hash of what the outcomes depend on: the fit, its URDF templates, the scenes, and the packages below."""
    import linear_ik
    from linear_ik import urdf

    package = Path(str(linear_ik.__file__)).parent
    here = Path(__file__).parent
    sources = [
        p for p in sorted(package.rglob("*.py")) if p.relative_to(package).parts[0].split(".")[0] not in ROOMS_ABOVE
    ]
    sources += [here / name for name in ("cells.py", "scenes.py", "cases.py", "bound.py", *code)]
    sources += sorted(p for p in urdf.template_folder().rglob("*") if p.is_file())
    total = hashlib.sha256()
    for path in sources:
        total.update(path.read_bytes())
    total.update(json.dumps(versions()).encode())
    return total.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Return the versions of `PACKAGES`, as far as they are installed."""
    found = {}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def as_mapping(cell: Cell, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return a cell and its outcomes ready for JSON."""
    return {**asdict(cell), "outcomes": [asdict(o) for o in outcomes]}
