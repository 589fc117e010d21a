"""One size of `bench_scaling`, in a process of its own."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from benchlib.methods.common import Array, Task, tubes
from benchlib.methods.registry import named
from benchlib.peer_clouds import task
from benchlib.peer_job import WARM_POINTS, WARM_SEED
from benchlib.timing import alternating, peak_bytes, ratio, repeated, reset_peak, resident_bytes, serve
from linear_ik import Chain, Scan, fit

WITHOUT_NORMALS = " without normals"


def work(job: dict[str, Any]) -> dict[str, Any]:
    """Do one of the jobs: make a cloud, measure a fit of it, compare fits with others."""
    jobs: dict[str, Callable[..., dict[str, Any]]] = {"cloud": cloud, "fit": measure, "ratios": ratios}
    return jobs[job.pop("do")](**job)


def cloud(path: str, points: int, segments: int, length_m: float, seed: int) -> dict[str, Any]:
    """Simulate a cloud and keep it: the process that fits it must not have held more than it needs."""
    made = task(points, seed, segments, length_m)
    np.save(path, made.points)
    return {"nodes_m": made.nodes_m.tolist()}


def measure(path: str, segments: int, length_m: float, nodes_m: list[list[float]], budget_s: float) -> dict[str, Any]:
    """Return time, memory, errors and stages of the fit of a cloud."""
    warm = task(WARM_POINTS, WARM_SEED)
    fit(warm.element, Scan(warm.points))
    element = task(2 * segments, WARM_SEED, segments, length_m).element
    gc.collect()
    reset_peak()
    bare = resident_bytes()
    points = np.load(path)
    result, times = repeated(lambda: fit(element, Scan(points)), budget_s)
    peak = peak_bytes()
    error = 1e3 * np.linalg.norm(result.nodes_m - np.array(nodes_m), axis=1)
    # Last: from here on every call costs a little more.
    from benchlib.stages import instrument

    clock = instrument()
    fit(warm.element, Scan(warm.points))
    clock.reset()
    for _ in times:
        fit(element, Scan(points))
    return {
        "times_s": times,
        "peak_bytes": peak - bare,
        "points_bytes": points.nbytes,
        "iterations": result.iterations,
        "status": result.status,
        "node_rms_mm": float(np.sqrt(np.mean(error[1:] ** 2))),
        "node_max_mm": float(error.max()),
        "stages": clock.shares(),
        "timings_s": result.timings_s,
    }


def ratios(points: int, rounds: int, against: list[str]) -> dict[str, Any]:
    """Return the times of the fit and of others on the same cloud, in turns, and the ratios of the fit's to them.

    Args:
        points: of the cloud.
        rounds: times of each, after one that does not count.
        against: "raycasting", or names of the methods of `bench_peers`.
    """
    wanted = task(points, 1)
    cores: dict[str, list[float]] = {}
    calls: dict[str, Callable[[], object]] = {"fit": lambda: fit(wanted.element, Scan(wanted.points))}
    for name in against:
        calls[name] = raycasting(wanted) if name == "raycasting" else solving(name, wanted, cores)
    alternating(calls, 1)
    cores.clear()
    times = alternating(calls, rounds)
    times |= {f"{name}{WITHOUT_NORMALS}": seconds for name, seconds in cores.items()}
    return {"times_s": times, "ratios": {name: ratio(times["fit"], times[name]) for name in times if name != "fit"}}


def solving(name: str, wanted: Task, cores: dict[str, list[float]]) -> Callable[[], object]:
    """Return the call of a method on a task, which notes in ``cores`` what it took without normals."""
    (method,) = named([name])
    solve = method.load()

    def call() -> None:
        core_s = solve(wanted).core_s
        if core_s is not None:
            cores.setdefault(name, []).append(core_s)

    return call


def raycasting(wanted: Task) -> Callable[[], object]:
    """Return one closest-point pass of Open3D over the points, to the true surface: scene, conversion and query."""
    import open3d as o3d

    chain = Chain.of(wanted.element)
    q = np.zeros(3 * wanted.element.segments)
    q[3 * 7 + 2] = np.radians(22.5)  # z, y, x of segment 8
    pose = chain.pose(chain.with_q(q))
    vertices, triangles = tubes(wanted.element, pose.rotations, pose.nodes_m)

    def call() -> Array:
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles))
        hit = scene.compute_closest_points(o3d.core.Tensor(wanted.points.astype(np.float32)))
        found: Array = hit["points"].numpy()
        return found

    return call


if __name__ == "__main__":
    sys.exit(serve(work))
