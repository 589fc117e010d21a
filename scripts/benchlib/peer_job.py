"""One method on one cloud, in a process of its own: what `bench_peers` starts."""

from __future__ import annotations

import contextlib
import gc
import sys
from typing import Any

from benchlib.methods.common import Task, errors_mm
from benchlib.methods.registry import named
from benchlib.timing import peak_bytes, repeated, reset_peak, resident_bytes, serve
from linear_ik import Element, Rectangle, simulate

LENGTH_M, SEGMENTS, NOISE_M = 2.5, 10, 0.001
WARM_POINTS, WARM_SEED = 1_000, 99


def task(points: int, seed: int, segments: int = SEGMENTS, length_m: float = LENGTH_M) -> Task:
    """Return the beam 0.1 x 0.3 m, bent by 22.5 degrees at its eighth segment of ten, or as far along."""
    element = Element("beam", Rectangle(x_dim=0.1, y_dim=0.3), length_m, segments)
    at = max(1, round(0.8 * segments))
    return Task.of(element, simulate(element, bends=(f"{at}:y:22.5",), points=points, noise_m=NOISE_M, seed=seed))


def work(job: dict[str, Any]) -> dict[str, Any]:
    """Load a method, let it import what it likes on a small cloud, then time and measure it.

    Args:
        job: method, points, seed, budget_s.
    """
    (method,) = named([job["method"]])
    solve = method.load()
    if method.lazy:
        with contextlib.suppress(Exception):
            solve(task(WARM_POINTS, WARM_SEED))
    gc.collect()
    reset_peak()
    bare = resident_bytes()
    wanted = task(job["points"], job["seed"])
    found, times = repeated(lambda: solve(wanted), job["budget_s"])
    peak = peak_bytes()
    return {
        "time_s": min(times),
        "calls": len(times),
        "peak_mb": (peak - bare) / 1e6,
        "iterations": found.iterations,
        **errors_mm(wanted, found),
    }


if __name__ == "__main__":
    sys.exit(serve(work))
