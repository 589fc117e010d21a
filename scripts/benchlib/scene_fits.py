"""Fits of staged scenes: errors across and along the axis, beside the bound and the stated covariance."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.bound import UNSEEN_M, node_covariance
from benchlib.cells import keep, warm_up_once
from benchlib.named_scenes import named_scene
from benchlib.random_scenes import Staged, scene
from linear_ik import FitResult, fit

Array = npt.NDArray[np.float64]

CODE = (
    "scene_fits.py",
    "random_scenes.py",
    "named_scenes.py",
    "drawn_profiles.py",
    "surroundings.py",
)
RANDOM = "random"
ALLOWED = 3.0  # times the bound
# A direction that the linear model cannot move at all (a straight member along its axis) has no ellipsoid.
LEAST_SD_M = 2e-5


@dataclass(frozen=True)
class SceneOutcome:
    """One fit.

    Attributes:
        kind: "random", or the name of a case.
        seed: of the scene.
        labels: what kind of scene it was, by column.
        status: the fit's verdict on itself.
        reasons: its sentences.
        across_mm, along_mm: error of the worst node across the member's true axis, and along it.
        bound_across_mm, bound_along_mm: the largest of the bound's deviations.
        excess: largest error over what was allowed for it, of all nodes.
        observable: whether the scan shows every bend.
        distance: [N] squared Mahalanobis distance of each node's error that the stated
            covariance knows of.
        dimensions: [N] of that distance.
        time_s: of the fit.
        iterations: of the fit.
    """

    kind: str
    seed: int
    labels: Mapping[str, str]
    status: str
    reasons: tuple[str, ...]
    across_mm: float
    along_mm: float
    bound_across_mm: float
    bound_along_mm: float
    excess: float
    observable: bool
    distance: tuple[float, ...]
    dimensions: tuple[int, ...]
    time_s: float
    iterations: int

    @property
    def succeeded(self) -> bool:
        """Whether every node is within what was allowed for it."""
        return self.excess <= 1.0

    @property
    def claimed_wrong(self) -> bool:
        """Whether it failed and did not say so: what must not happen."""
        return self.status == "converged" and not self.succeeded

    @property
    def honest(self) -> bool:
        """Whether it said that it may be wrong, and why."""
        return self.status != "converged" and bool(self.reasons)

    @property
    def inside(self) -> list[bool]:
        """Whether each node's error is inside its stated 95 % ellipsoid."""
        return [p <= 0.95 for p in self.probability]

    @property
    def probability(self) -> list[float]:
        """Of each node, the stated probability of an error no larger than its own; [] where nothing was fitted."""
        from scipy.stats import chi2

        if self.status == "not_scanned":
            return []
        pairs = zip(self.distance, self.dimensions, strict=True)
        return [float(chi2.cdf(d, n)) for d, n in pairs if n]


def staged(kind: str, seed: int) -> Staged:
    """Return a scene ready to be fitted, by its kind ("random", or a case) and seed."""
    return scene(seed).stage() if kind == RANDOM else named_scene(kind, seed)


def run_scene(job: tuple[str, int]) -> dict[str, Any]:
    """Fit the scene of a kind and seed, and return its outcome ready for JSON."""
    kind, seed = job
    warm_up_once()
    there = staged(kind, seed)
    started = time.perf_counter()
    result = fit(there.element, there.scan.without_truth())
    return asdict(judged(kind, seed, there, result, time.perf_counter() - started))


def judged(kind: str, seed: int, there: Staged, result: FitResult, time_s: float) -> SceneOutcome:
    """Return what a fit came to, against the truth."""
    error = result.nodes_m - there.scan.nodes_m
    least = node_covariance(there.element, there.scan, there.noise_m)
    axis = axes(there.scan.nodes_m)
    P = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    if there.judged is not None:
        P = np.broadcast_to(np.outer(there.judged, there.judged), P.shape)
    across, along = np.linalg.norm(np.einsum("kij,kj->ki", P, error), axis=1), np.abs(np.sum(error * axis, axis=1))
    bound_across = np.sqrt(np.maximum(np.einsum("kij,kjl,kil->k", P, least, P), 0.0))
    bound_along = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", axis, least, axis), 0.0))
    limit = 1e-3 * there.limit_mm
    excess = across / np.maximum(limit, ALLOWED * bound_across)
    if there.judged is None:
        excess = np.maximum(excess, along / np.maximum(limit, ALLOWED * bound_along))
    distance, dimensions = mahalanobis(error, result.nodes_covariance_m2)
    return SceneOutcome(
        kind,
        seed,
        there.labels,
        result.status,
        tuple(result.reasons),
        1e3 * float(across.max()),
        1e3 * float(along.max()),
        1e3 * float(bound_across.max()),
        1e3 * float(bound_along.max()),
        float(excess.max()),
        bool(bound_across.max() <= UNSEEN_M),
        tuple(distance),
        tuple(dimensions),
        time_s,
        result.iterations,
    )


def axes(nodes_m: Array) -> Array:
    """Return the direction [N+1][3] of the member at each node: of the segments that meet there."""
    along = np.diff(nodes_m, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    mean = np.concatenate([along[:1], along[1:] + along[:-1], along[-1:]])
    return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))


def mahalanobis(error: Array, covariance_m2: Array) -> tuple[list[float], list[int]]:
    """Return the squared distance of errors [K][3] in terms of their covariance [K][3][3], and its dimensions.

    Principal directions with a deviation below 20 um do not count; where none is left
    (a held node) the dimension is 0.
    """
    distances, dimensions = [], []
    for e, C in zip(error, covariance_m2, strict=True):
        variance, V = np.linalg.eigh(C)
        known = variance > LEAST_SD_M**2
        distances.append(float(np.sum((e @ V)[known] ** 2 / variance[known])))
        dimensions.append(int(known.sum()))
    return distances, dimensions


def run_scenes(jobs: Sequence[tuple[str, int]], folder: Path, workers: int) -> list[SceneOutcome]:
    """Return the outcomes of scenes, in their order, from the cache where they are there."""
    named = {_file_name(*job): job for job in jobs}
    found = keep(named, run_scene, folder, workers, CODE, every=10)
    return [outcome_of(found[_file_name(*job)]) for job in jobs]


def _file_name(kind: str, seed: int) -> str:
    return f"{hashlib.sha256(kind.encode()).hexdigest()[:12]}-{seed}"


def outcome_of(mapping: Mapping[str, Any]) -> SceneOutcome:
    """Return an outcome from its JSON."""
    lists = {k: tuple(mapping[k]) for k in ("reasons", "distance", "dimensions")}
    return SceneOutcome(**{**mapping, **lists})
