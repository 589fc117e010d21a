"""This project: the default, the paper's method, and the default with other solvers of the step."""

from __future__ import annotations

from benchlib.methods.common import Found, Solve, Task, tubes
from linear_ik import Chain, FitSettings, Scan, fit


def default() -> Solve:
    """Return the fit with its default settings."""
    return with_settings(FitSettings())


def icpik() -> Solve:
    """Return the paper's algorithm as built here."""
    return with_settings(FitSettings(method="icpik"))


def with_solver(name: str) -> Solve:
    """Return the default fit, its steps solved by a solver of qpsolvers."""
    return with_settings(FitSettings(solver=name))


def with_settings(settings: FitSettings) -> Solve:
    """Return the fit with some settings."""

    def solve(task: Task) -> Found:
        result = fit(task.element, Scan(task.points), settings)
        return Found(result.nodes_m, lambda: chain_surface(task, result.q), result.iterations)

    return solve


def chain_surface(task: Task, q: object) -> tuple:
    """Return the mesh of the chain at Pinocchio's q [3N]."""
    chain = Chain.of(task.element)
    pose = chain.pose(chain.with_q(q))
    return tubes(task.element, pose.rotations, pose.nodes_m)
