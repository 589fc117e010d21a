"""Solvers of the step's quadratic program against each other, without a fit around them."""

from __future__ import annotations

import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.gate import Metric
from benchlib.timing import JobError, run_job, say, serve

Array = npt.NDArray[np.float64]
Step = Callable[[Array, Array, Array, Array], Array]

SIZES = (30, 90, 300)
DIRECT = "osqp, direct"
SOLVERS = {
    DIRECT: "osqp",
    "osqp": "osqp",
    "proxqp": "proxsuite",
    "piqp": "piqp",
    "daqp": "daqp",
    "clarabel": "clarabel",
}
MOST_PROGRAMS = 40
REPEATS = 3
# Noise of a ratio of two processes' times, stated: they run one after the other, so a repeat shows little of it.
APART = "times of two processes, one after the other"
QP_NOTES = (
    "Steps of real fits of 10, 30 and 100 segments (30, 90, 300 variables), as they come, and with the box drawn in "
    "until about half of the variables are at a limit. Time: median of a step.",
    "Error: how far the answer is from meeting the optimality conditions, as the change of a joint that a Newton step "
    "of that joint alone would still make within the box, in rad; the worst of all steps. Beyond the box: the worst "
    "violation of a limit before anything is clipped, in rad.",
    "osqp, direct: the package's own step, its workspace kept and warm-started. The others through qpsolvers, at its "
    "defaults.",
)


def qp_rows(sizes: Sequence[int], timeout_s: float) -> list[dict[str, Any]]:
    """Return one row a solver and size, each solver in a process of its own."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="linear_ik_bench_") as folder:
        for size in sizes:
            path = str(Path(folder) / f"{size}.npz")
            run_job("benchlib.qp_steps", {"record": path, "size": size}, timeout_s)
            for solver in SOLVERS:
                try:
                    answer = run_job("benchlib.qp_steps", {"solver": solver, "programs": path}, timeout_s)
                    remark = ""
                except JobError as error:
                    answer, remark = {}, f"failed: {error}"
                rows.append(row(solver, size, answer, remark))
                say(f"steps of {size} variables by {solver}: {remark or str(round(answer['free_ms'], 3)) + ' ms'}")
    return rows


def row(solver: str, size: int, answer: dict[str, Any], remark: str) -> dict[str, Any]:
    """Return one row of the table."""
    nan = math.nan
    return {
        "variables": size,
        "solver": solver,
        "version": answer.get("version", ""),
        "as they come ms": answer.get("free_ms", nan),
        "half at limits ms": answer.get("tight_ms", nan),
        "error rad": answer.get("error_rad", nan),
        "beyond the box rad": answer.get("beyond_rad", nan),
        "unsolved": answer.get("unsolved", nan),
        "remark": remark,
    }


def qp_metrics(rows: Sequence[dict[str, Any]]) -> list[Metric]:
    """Return the figures that the gate watches: the direct step's error, and its time beside the best other's."""
    metrics = []
    for size in sorted({r["variables"] for r in rows}):
        direct = next(r for r in rows if r["variables"] == size and r["solver"] == DIRECT)
        others = [r for r in rows if r["variables"] == size and r["solver"] != DIRECT and not r["remark"]]
        wrong = float(not direct["error rad"] <= 1e-9)
        metrics.append(Metric(f"step of {size}: wrong by more than 1e-9 rad", wrong, 0.0, target=0.0, why="yes or no"))
        if others:
            for key in ("as they come ms", "half at limits ms"):
                best = min(r[key] for r in others)
                metrics.append(
                    Metric(f"step of {size}: {key[:-3]}, direct / best other", direct[key] / best, 0.6, why=APART)
                )
    return metrics


# In a process of its own --------------------------------------------------------------------


def work(job: dict[str, Any]) -> dict[str, Any]:
    """Record programs, or time a solver on recorded ones."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return record(job["record"], job["size"]) if "record" in job else timed(job["solver"], job["programs"])


def record(path: str, size: int) -> dict[str, Any]:
    """Keep the programs of a fit of ``size`` / 3 segments, as they come and with the box drawn in."""
    from unittest.mock import patch

    from benchlib.peer_clouds import task
    from linear_ik import Scan, fit
    from linear_ik.ik_step import OsqpStep

    programs: list[tuple[Array, Array, Array, Array]] = []
    solve = OsqpStep.__call__

    def noted(self: OsqpStep, objective: Any, lower: Array, upper: Array) -> Array:
        dx = solve(self, objective, lower, upper)
        if len(lower) == size:
            programs.append((objective.H.copy(), objective.c.copy(), lower.copy(), upper.copy()))
        return dx

    wanted = task(10_000, 1, size // 3)
    with patch.object(OsqpStep, "__call__", noted):
        fit(wanted.element, Scan(wanted.points))
    chosen = programs[:: max(1, len(programs) // MOST_PROGRAMS)][:MOST_PROGRAMS]
    tight = []
    rng = np.random.default_rng(0)
    for H, c, _, _ in chosen:
        reach = np.abs(np.linalg.solve(H, c)) * rng.lognormal(0.0, 1.0, size)
        tight.append((H, c, -reach, reach))
    kinds = {"free": chosen, "tight": tight}
    np.savez(path, **{f"{k}_{i}": np.array([x[i] for x in ps]) for k, ps in kinds.items() for i in range(4)})
    return {"programs": len(chosen)}


def timed(solver: str, path: str) -> dict[str, Any]:
    """Return times, errors and failures of one solver over the recorded programs."""
    step = maker(solver)
    answer: dict[str, Any] = {"version": version(SOLVERS[solver]), "error_rad": 0.0, "beyond_rad": 0.0, "unsolved": 0}
    with np.load(path) as file:
        for kind in ("free", "tight"):
            programs = list(zip(*(file[f"{kind}_{i}"] for i in range(4)), strict=True))
            times = []
            for _ in range(REPEATS):
                for program in programs:
                    started = time.perf_counter()
                    dx = step(*program)
                    times.append(time.perf_counter() - started)
                    if dx is None or not np.isfinite(dx).all():
                        answer["unsolved"] += 1
                        continue
                    error, beyond = shortcomings(*program, dx)
                    answer["error_rad"] = max(answer["error_rad"], error)
                    answer["beyond_rad"] = max(answer["beyond_rad"], beyond)
            answer[f"{kind}_ms"] = 1e3 * statistics.median(times)
    answer["unsolved"] //= REPEATS
    return answer


def maker(solver: str) -> Step:
    """Return a function (H, c, lower, upper) -> dx, its imports done."""
    import warnings

    import qpsolvers
    import scipy.sparse

    from linear_ik.ik_step import OsqpStep
    from linear_ik.terms import Objective

    warnings.simplefilter("ignore")
    if solver == DIRECT:
        own = OsqpStep()
        return lambda H, c, lower, upper: own(Objective(H, c), lower, upper)
    sparse = solver in qpsolvers.sparse_solvers and solver not in qpsolvers.dense_solvers

    def step(H: Array, c: Array, lower: Array, upper: Array) -> Array:
        P = scipy.sparse.csc_matrix(H) if sparse else H
        return qpsolvers.solve_qp(P, c, lb=lower, ub=upper, solver=solver)

    return step


def shortcomings(H: Array, c: Array, lower: Array, upper: Array, dx: Array) -> tuple[float, float]:
    """Return how far dx is from optimal, and beyond its box; both in rad."""
    inside = np.clip(dx, lower, upper)
    newton = inside - (H @ inside + c) / np.diag(H)
    error = float(np.abs(np.clip(newton, lower, upper) - inside).max())
    return error, float(np.abs(dx - inside).max())


if __name__ == "__main__":
    sys.exit(serve(work))
