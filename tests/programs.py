"""Quadratic programs in a box, as IK steps pose them, and how to judge a solution."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import lsq_linear

from linear_ik.terms import Objective

Program = tuple[Objective, np.ndarray, np.ndarray]


def random_programs(n: int, count: int, seed: int = 0) -> Iterator[Program]:
    """Dense, triangular and chain-like H = L'L with condition numbers up to 1e15, boxes around or off the minimum."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        if i % 3 == 0:
            L = rng.standard_normal((n + 5, n)) * rng.lognormal(0, 1, n)
        elif i % 3 == 1:
            L = np.tril(0.2 * rng.standard_normal((n, n))) + np.diag(rng.lognormal(0, 2, n))
        else:
            # As in a chain: each joint carries all that comes after it.
            L = np.kron(np.tril(np.ones((n // 3, n // 3))), np.eye(3)) * rng.lognormal(0, 2, n)
        H = L.T @ L
        H += 10.0 ** rng.uniform(-13, -3) * np.diag(H).mean() * np.eye(n)
        c = -H @ rng.normal(0, 0.3, n)
        lower, upper = -rng.uniform(0, 0.4, n), rng.uniform(0, 0.4, n)
        if i % 5 == 0:
            lower, upper = lower - 10, upper + 10
        if i % 7 == 0:
            lower[::4] = upper[::4] = 0.0
        yield Objective(H, c), lower, upper


def violation_of_kkt(program: Program, dx: np.ndarray, near: float = 0.0) -> float:
    """Largest component of the gradient that the box does not hold, the program scaled to a unit diagonal."""
    (H, c), lower, upper = program
    scale = 1 / np.sqrt(np.diag(H))
    gradient = (H @ dx + c) * scale
    at_lower, at_upper = dx <= lower + near * scale, dx >= upper - near * scale
    pull = np.where(at_lower, np.minimum(gradient, 0), np.where(at_upper, np.maximum(gradient, 0), gradient))
    pull[lower == upper] = 0
    return float(np.abs(pull).max() / np.abs(c * scale).max())


def by_bvls(program: Program) -> np.ndarray:
    (H, c), lower, upper = program
    L = np.linalg.cholesky(H)
    found = lsq_linear(L.T, -np.linalg.solve(L, c), (lower, upper), method="bvls", tol=1e-15, max_iter=10_000)
    return np.asarray(found.x)


def assert_within(dx: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    assert (lower <= dx).all() and (dx <= upper).all()
