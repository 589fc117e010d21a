"""The IK step: terms and joint limits as one box-constrained quadratic program.

    minimise 1/2 dx' H dx + c' dx    subject to    lower <= dx <= upper

OSQP solves it, directly and warm-started; any solver qpsolvers knows can take its
place. A first-order solver meets bounds to a tolerance only, so its solution is put back
into the box: the limits hold to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse

from linear_ik.errors import SettingsError, StepError
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Solver = Callable[[Objective, Array, Array], Array]

TOLERANCE = 1e-9
MOST_ITERATIONS = 20_000
MOST_ROUNDS = 50
SOLVED = 1  # OSQP's status value


def make_solver(name: str) -> Solver:
    """Return a function (objective, lower [n], upper [n]) -> dx [n].

    Raises:
        SettingsError: qpsolvers knows no installed solver of that name.
    """
    if name == "osqp":
        return OsqpStep()
    import qpsolvers

    if name not in qpsolvers.available_solvers:
        raise SettingsError("solver", repr(name), "one of " + ", ".join(sorted(qpsolvers.available_solvers)))
    return lambda objective, lower, upper: _through_qpsolvers(name, objective, lower, upper)


class OsqpStep:
    """OSQP with its workspace kept from step to step, and each step warm-started.

    The program is scaled to a unit diagonal. OSQP starts from the unconstrained step, or
    where that leaves the box from the active-set method's answer: it confirms a right
    start in its first iteration, and iterates from a wrong one.
    """

    def __init__(self) -> None:
        """Start without a workspace; the first step of each size makes one."""
        import osqp

        self._osqp = osqp
        self._workspaces: dict[int, tuple[Any, tuple[Index, Index]]] = {}

    def __call__(self, objective: Objective, lower: Array, upper: Array) -> Array:
        """Return the step [n] within the box, exactly.

        Raises:
            StepError: H is not positive definite or not finite, or the program cannot be solved.
        """
        n = len(lower)
        H, c, scale, factor = _scaled(objective)
        low, high = lower / scale, upper / scale
        x, y = scipy.linalg.cho_solve(factor, -c, check_finite=False), np.zeros(n)
        if not ((x >= low) & (x <= high)).all():
            x, y = _active_set(H, c, low, high, x, y) or (np.minimum(np.maximum(x, low), high), y)
        solver, upper_triangle = self._workspace(n)
        solver.update(q=c, l=low, u=high, Px=H[upper_triangle])
        solver.warm_start(x=x, y=y)
        solution = solver.solve(raise_error=False)
        solved = solution.info.status_val == SOLVED
        # A start that OSQP's first check confirms is the answer, to the last bit.
        if not solved or solution.info.iter > 1:
            x, y = np.asarray(solution.x), np.asarray(solution.y)
            better = _active_set(H, c, low, high, x, y) if np.isfinite(x).all() and np.isfinite(y).all() else None
            if better is None and not solved:
                better = _one_by_one(H, c, low, high, str(solution.info.status))
            x, _ = better or (x, y)
        return _put_back(x, low, high, scale, lower, upper)

    def _workspace(self, n: int) -> tuple[Any, tuple[Index, Index]]:
        if n not in self._workspaces:
            rows, columns = np.triu_indices(n)
            by_column = np.lexsort((rows, columns))
            upper_triangle = rows[by_column], columns[by_column]
            # Named, or OSQP looks for the libraries of other algebras first.
            solver = self._osqp.OSQP(algebra="builtin")
            solver.setup(
                P=scipy.sparse.csc_matrix((np.ones(len(rows)), upper_triangle), shape=(n, n)),
                q=np.zeros(n),
                A=scipy.sparse.identity(n, format="csc"),
                l=np.zeros(n),
                u=np.zeros(n),
                verbose=False,
                eps_abs=TOLERANCE,
                eps_rel=TOLERANCE,
                max_iter=MOST_ITERATIONS,
                check_termination=1,
                polishing=False,
                scaling=0,
                adaptive_rho=True,
            )
            self._workspaces[n] = solver, upper_triangle
        return self._workspaces[n]


def _active_set(H: Array, c: Array, low: Array, high: Array, x: Array, y: Array) -> tuple[Array, Array] | None:
    """Return the minimum and its multipliers by the primal-dual active set method, or None.

    Hold the variables that x and y put on their bounds, solve for the others, look again
    (Hintermueller, Ito and Kunisch 2002). A few rounds where it converges, which it need
    not; so it only tells OSQP where to start, and puts the last bits to a solution.
    """
    for _ in range(MOST_ROUNDS):
        at_low, at_high = y + (x - low) < 0.0, y + (x - high) > 0.0
        held = at_low | at_high
        x = np.where(at_low, low, np.where(at_high, high, 0.0))
        free = ~held
        if free.any():
            x[free] = np.linalg.solve(H[np.ix_(free, free)], -(c[free] + H[np.ix_(free, held)] @ x[held]))
        y = np.where(held, -(H @ x + c), 0.0)
        slack = 1e-12 * (1.0 + np.abs(x))
        if ((x >= low - slack) & (x <= high + slack)).all() and (y[at_low] <= 0.0).all() and (y[at_high] >= 0.0).all():
            return x, y
    return None


def _one_by_one(H: Array, c: Array, low: Array, high: Array, status: str) -> tuple[Array, Array]:
    """Return the minimum and its multipliers of a program that OSQP gave up with ``status``.

    Of programs of 300 ill-conditioned variables with half of them at a limit, one in a
    hundred. Bounded-variable least squares (Stark and Parker 1995, scipy's) holds and
    frees one variable after the other: slow, but it ends.
    """
    from scipy.optimize import lsq_linear

    x, free = low.copy(), high > low  # it wants room between its bounds
    upper = scipy.linalg.cholesky(H[np.ix_(free, free)], check_finite=False)
    pull = c[free] + H[np.ix_(free, ~free)] @ x[~free]
    b = scipy.linalg.solve_triangular(upper, -pull, trans="T", check_finite=False)
    found = lsq_linear(upper, b, (low[free], high[free]), method="bvls", tol=1e-15, max_iter=50 * len(c))
    # To the last bit, what is at a bound.
    x[free] = np.where(found.active_mask < 0, low[free], np.where(found.active_mask > 0, high[free], found.x))
    better = _active_set(H, c, low, high, x, -(H @ x + c))
    if not found.success and better is None:
        raise StepError("IK step", f"OSQP: {status}", "a solved quadratic program")
    return better or (x, -(H @ x + c))


def _through_qpsolvers(name: str, objective: Objective, lower: Array, upper: Array) -> Array:
    import qpsolvers

    H, c, scale, _ = _scaled(objective)
    low, high = lower / scale, upper / scale
    P = scipy.sparse.csc_matrix(H) if name in qpsolvers.sparse_solvers else H
    try:
        x = qpsolvers.solve_qp(P, c, lb=low, ub=high, solver=name)
    except Exception as error:  # each solver raises its own
        raise StepError("IK step", f"{name}: {error}", "a solved quadratic program") from None
    if x is None or not np.isfinite(x).all():
        raise StepError("IK step", f"{name} found no solution", "a solved quadratic program")
    # Interior-point methods stop short of the bounds.
    x, _ = _active_set(H, c, low, high, x, -(H @ x + c)) or (x, None)
    return _put_back(x, low, high, scale, lower, upper)


def _scaled(objective: Objective) -> tuple[Array, Array, Array, tuple[Array, bool]]:
    """Return H and c of the program in dx / scale, whose H has a unit diagonal; scale; H's Cholesky factor.

    Raises:
        StepError: H is not positive definite or not finite.
    """
    diagonal = np.diag(objective.H)
    if not (np.isfinite(objective.H).all() and np.isfinite(objective.c).all() and (diagonal > 0).all()):
        raise StepError("IK step", "H or c not finite, or a variable without information", "a positive definite H")
    scale = 1.0 / np.sqrt(diagonal)
    H = objective.H * scale * scale[:, None]
    try:
        return H, objective.c * scale, scale, scipy.linalg.cho_factor(H, check_finite=False)
    except scipy.linalg.LinAlgError:
        raise StepError("IK step", "H is not positive definite", "damping above 0") from None


def _put_back(x: Array, low: Array, high: Array, scale: Array, lower: Array, upper: Array) -> Array:
    """Return the scaled solution x as dx within the box.

    Scaling there and back would leave a variable on its limit an ulp short of it.
    """
    dx = np.where(x <= low, lower, np.where(x >= high, upper, x * scale))
    return np.asarray(np.minimum(np.maximum(dx, lower), upper))
