"""One method on one cloud, in a process of its own: what `bench_peers` starts."""

from __future__ import annotations

import contextlib
import gc
import statistics
import sys
from typing import Any

from benchlib.methods.common import Found, errors_mm
from benchlib.methods.registry import named
from benchlib.peer_clouds import task_of
from benchlib.timing import peak_bytes, repeated, reset_peak, resident_bytes, serve

WARM_POINTS, WARM_SEED = 1_000, 99


def work(job: dict[str, Any]) -> dict[str, Any]:
    """Load a method, let it solve a small cloud of the same kind, then time and measure it.

    The small cloud is for every method alike: it pays for imports, caches and compilers.

    Args:
        job: method, cloud, points, seed, budget_s.
    """
    (method,) = named([job["method"]])
    solve = method.load()
    with contextlib.suppress(Exception):
        solve(task_of(job["cloud"], WARM_POINTS, WARM_SEED))
    wanted = task_of(job["cloud"], job["points"], job["seed"])
    gc.collect()
    imported = set(sys.modules)
    reset_peak()
    bare = resident_bytes()
    cores: list[float | None] = []

    def call() -> Found:
        found = solve(wanted)
        cores.append(found.core_s)
        return found

    found, times = repeated(call, job["budget_s"])
    peak = peak_bytes()
    known = [core for core in cores if core is not None]
    return {
        "time_s": statistics.median(times),
        "core_s": statistics.median(known) if known else None,
        "calls": len(times),
        "peak_mb": (peak - bare) / 1e6,
        # The memory of what was imported only now would count as the method's.
        "late_imports": sorted({name.split(".")[0] for name in set(sys.modules) - imported}),
        "iterations": found.iterations,
        **errors_mm(wanted, found),
    }


if __name__ == "__main__":
    sys.exit(serve(work))
