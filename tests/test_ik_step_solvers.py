"""The IK step by every solver installed and one made up: the same step, or an error that says so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import qpsolvers
from programs import assert_within, by_bvls, random_programs, violation_of_kkt
from threadpoolctl import threadpool_limits

from linear_ik import ik_step
from linear_ik.errors import SettingsError, StepError
from linear_ik.ik_step import OsqpStep, Solver, make_solver
from linear_ik.terms import Objective


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    with threadpool_limits(1):
        yield


def through_qpsolvers(name: str) -> Solver:
    return lambda objective, lower, upper: ik_step._through_qpsolvers(name, objective, lower, upper)


SOLVERS = {"directly": OsqpStep(), **{name: through_qpsolvers(name) for name in qpsolvers.available_solvers}}
ANY_SOLVER = pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS.keys())
# qpsolvers announces that it will raise its errors one day.
QUIET = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning", "ignore::UserWarning")
OSQP = OsqpStep()


@ANY_SOLVER
@QUIET
def test_every_solver_takes_the_same_step(solver: Solver) -> None:
    for objective, lower, upper in random_programs(30, 60, seed=2):
        if (lower == upper).any():  # not every solver takes such
            continue
        dx = solver(objective, lower, upper)
        assert_within(dx, lower, upper)
        assert violation_of_kkt((objective, lower, upper), dx) < 1e-12
        well = Objective(objective.H + 1e-6 * np.diag(np.diag(objective.H)), objective.c)
        np.testing.assert_allclose(solver(well, lower, upper), OSQP(well, lower, upper), rtol=0, atol=1e-9)


@ANY_SOLVER
@QUIET
def test_a_limit_that_is_pressed_is_reached_to_the_last_bit(solver: Solver) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        limit = rng.uniform(0.01, 1.0, 6)
        H = np.diag(rng.lognormal(0, 3, 6))
        away = np.sign(rng.standard_normal(6))
        dx = solver(Objective(H, -H @ (10 * away)), -limit, limit)
        assert dx.tolist() == (away * limit).tolist()


# refused ----------------------------------------------------------------------------------

GOOD = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])


@ANY_SOLVER
@pytest.mark.parametrize(
    ("H", "c"),
    [
        (np.full((3, 3), np.nan), np.ones(3)),
        (np.where(GOOD == 0.5, np.inf, GOOD), np.ones(3)),
        (GOOD, np.array([1.0, np.nan, 1.0])),
        (GOOD, np.array([1.0, np.inf, 1.0])),
        (np.zeros((3, 3)), np.ones(3)),
        (np.diag([1.0, 0.0, 1.0]), np.ones(3)),
        (-GOOD, np.ones(3)),
        (np.ones((3, 3)), np.ones(3)),
        (np.array([[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]]), np.ones(3)),
    ],
    ids="nan infinite nan-gradient infinite-gradient zero idle-variable negative singular indefinite".split(),
)
def test_what_is_no_program_is_refused(
    solver: Solver, H: np.ndarray, c: np.ndarray, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(StepError) as raised:
        solver(Objective(H, c), -np.ones(3), np.ones(3))
    assert raised.value.expected
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("name", ["", "OSQP", "simplex", "osqp "])
def test_an_unknown_solver_is_refused_and_the_known_ones_named(name: str) -> None:
    with pytest.raises(SettingsError) as raised:
        make_solver(name)
    assert repr(name) in raised.value.what
    assert all(known in raised.value.expected for known in qpsolvers.available_solvers)


# a solver of qpsolvers' that is made up ------------------------------------------------------


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """A solver of ours among qpsolvers', which answers as it is told, or rightly."""
    told: dict[str, object] = {}

    def solve_qp(P: np.ndarray, q: np.ndarray, lb: np.ndarray, ub: np.ndarray, solver: str) -> object:
        assert solver == "made-up"
        answer = told.get("answer", by_bvls)
        if isinstance(answer, Exception):
            raise answer
        return answer((Objective(P, q), lb, ub)) if callable(answer) else answer

    monkeypatch.setattr(qpsolvers, "available_solvers", [*qpsolvers.available_solvers, "made-up"])
    monkeypatch.setattr(qpsolvers, "solve_qp", solve_qp)
    return told


def test_any_solver_of_qpsolvers_can_take_its_place(made_up: dict[str, object]) -> None:
    solve, compared = make_solver("made-up"), 0
    for objective, lower, upper in random_programs(30, 30, seed=8):
        if (lower < upper).all():
            dx = solve(objective, lower, upper)
            assert_within(dx, lower, upper)
            assert violation_of_kkt((objective, lower, upper), dx) < 1e-10
            compared += 1
    assert compared > 20


@pytest.mark.parametrize("short", [1e-9, 1e-7, 1e-5])
def test_a_solver_that_stops_short_of_the_limits_is_carried_there(made_up: dict[str, object], short: float) -> None:
    made_up["answer"] = lambda program: np.clip(by_bvls(program), program[1] + short, program[2] - short)
    solve = make_solver("made-up")
    for objective, lower, upper in random_programs(30, 12, seed=9):
        if (lower < upper).all():
            dx, exact = solve(objective, lower, upper), OSQP(objective, lower, upper)
            at = (exact == lower) | (exact == upper)
            np.testing.assert_array_equal(dx[at], exact[at])
            np.testing.assert_allclose(dx, exact, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    "answer", [None, np.full(3, np.nan), ValueError("so what"), RuntimeError(), qpsolvers.exceptions.SolverError("no")]
)
def test_a_solver_that_fails_is_a_step_error(made_up: dict[str, object], answer: object) -> None:
    made_up["answer"] = answer
    with pytest.raises(StepError, match="made-up"):
        make_solver("made-up")(Objective(GOOD, np.ones(3)), -np.ones(3), np.ones(3))
