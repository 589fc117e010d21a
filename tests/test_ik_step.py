"""The IK step: thousands of boxes, solved exactly, and refused where there is nothing to solve."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from threadpoolctl import threadpool_limits

from linear_ik import ik_step
from linear_ik.errors import SettingsError, StepError
from linear_ik.ik_step import OsqpStep, Solver, make_solver
from linear_ik.terms import Objective

Program = tuple[Objective, np.ndarray, np.ndarray]


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


# solved -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "count", "compared"), [(30, 1000, 4), (90, 1000, 20), (300, 50, 15)])
def test_a_thousand_boxes(n: int, count: int, compared: int) -> None:
    solve, at_bounds = make_solver("osqp"), 0
    for i, program in enumerate(random_programs(n, count)):
        objective, lower, upper = program
        dx = solve(objective, lower, upper)
        assert_within(dx, lower, upper)
        assert violation_of_kkt(program, dx) < 1e-12
        at_bounds += np.count_nonzero((dx == lower) | (dx == upper))
        if i % compared == 0 and (lower < upper).all():
            other = by_bvls(program)
            value, best = (0.5 * x @ objective.H @ x + objective.c @ x for x in (dx, other))
            assert value <= best + 1e-12 * abs(best)
    assert at_bounds > 0.3 * n * count


@pytest.mark.parametrize("n", [3, 30, 90])
def test_the_step_is_that_of_an_independent_solver(n: int) -> None:
    solve, rng = make_solver("osqp"), np.random.default_rng(1)
    for _ in range(20):
        A = rng.standard_normal((2 * n, n))
        objective = Objective(A.T @ A, rng.standard_normal(n) * n)
        program = objective, -rng.uniform(0, 0.3, n), rng.uniform(0, 0.3, n)
        np.testing.assert_allclose(solve(*program), by_bvls(program), rtol=0, atol=1e-11)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), n=st.integers(1, 12), room=st.floats(0, 2), off=st.floats(-1, 1))
def test_any_box_holds_and_is_solved(seed: int, n: int, room: float, off: float) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n + 2, n))
    lower = off + rng.uniform(-room, 0, n)
    program = Objective(A.T @ A + 1e-9 * np.eye(n), rng.standard_normal(n)), lower, lower + rng.uniform(0, room, n)
    dx = OSQP(*program)
    assert_within(dx, *program[1:])
    assert violation_of_kkt(program, dx) < 1e-12


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


def test_a_minimum_within_the_box_is_newtons_step() -> None:
    for objective, _, _ in random_programs(30, 20, seed=4):
        n = len(objective.c)
        newton = np.linalg.solve(objective.H, -objective.c)
        for wide in (np.full(n, 1e3), np.full(n, np.inf)):
            np.testing.assert_allclose(OSQP(objective, -wide, wide), newton, rtol=1e-4, atol=1e-9)


def test_held_variables_stay_and_the_others_go_on_without_them() -> None:
    H = np.array([[2.0, 1.0], [1.0, 2.0]])
    dx = OSQP(Objective(H, np.array([-1.0, -1.0])), np.array([0.1, -1.0]), np.array([0.1, 1.0]))
    np.testing.assert_allclose(dx, [0.1, 0.45], rtol=1e-15)
    everything = np.array([0.1, -0.2])
    assert OSQP(Objective(H, np.ones(2)), everything, everything).tolist() == [0.1, -0.2]


def test_joints_go_on_past_one_that_is_stopped() -> None:
    # Clipping Newton's step would leave the second joint where the first one's help had put it.
    H = np.array([[4.0, 2.0], [2.0, 2.0]])
    c = -H @ np.array([1.0, 0.0])
    dx = OSQP(Objective(H, c), np.array([-0.5, -1.0]), np.array([0.5, 1.0]))
    np.testing.assert_allclose(dx, [0.5, 0.5], rtol=1e-12)


# OSQP itself --------------------------------------------------------------------------------


def test_osqp_finds_what_the_active_set_method_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ik_step, "_active_set", lambda *_: None)
    solve = OsqpStep()
    for program in random_programs(30, 60, seed=5):
        objective, lower, upper = program
        objective = Objective(objective.H + 1e-4 * np.diag(np.diag(objective.H)), objective.c)
        dx = solve(objective, lower, upper)
        assert_within(dx, lower, upper)
        assert violation_of_kkt((objective, lower, upper), dx, near=1e-6) < 1e-6


def test_osqp_corrects_a_wrong_start(monkeypatch: pytest.MonkeyPatch) -> None:
    rightly = ik_step._active_set
    calls = []

    def wrongly(*arguments: np.ndarray) -> object:
        calls.append(arguments)
        return (arguments[2], arguments[5]) if len(calls) % 2 else rightly(*arguments)

    programs = [p for p in random_programs(30, 40, seed=6) if (p[2] < 1).all() and (p[1] < p[2]).all()]
    monkeypatch.setattr(ik_step, "_active_set", wrongly)
    solve = OsqpStep()
    for program in programs:
        assert violation_of_kkt(program, solve(*program)) < 1e-7
        # Once for the start, once for the last bits.
        assert len(calls) == 2
        calls.clear()


def test_a_solver_that_gives_up_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ik_step, "_active_set", lambda *_: None)
    monkeypatch.setattr(ik_step, "MOST_ITERATIONS", 2)
    program = next(p for i, p in enumerate(random_programs(30, 10, seed=7)) if i == 2)
    with pytest.raises(StepError, match="maximum iterations"):
        OsqpStep()(*program)


def test_one_step_owes_nothing_to_the_ones_before() -> None:
    solve = make_solver("osqp")
    programs = [p for n in (6, 30, 6, 30) for p in random_programs(n, 5, seed=n)]
    for program in programs:
        np.testing.assert_array_equal(solve(*program), OsqpStep()(*program))


def test_the_program_is_left_as_it_was() -> None:
    (H, c), lower, upper = program = next(random_programs(30, 1))
    copies = [a.copy() for a in (H, c, lower, upper)]
    OSQP(*program)
    for now, then in zip((H, c, lower, upper), copies, strict=True):
        np.testing.assert_array_equal(now, then)


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    solve = make_solver("osqp")
    for program in random_programs(30, 30):
        solve(*program)
    with pytest.raises(StepError):
        solve(Objective(-np.eye(30), np.zeros(30)), -np.ones(30), np.ones(30))
    assert capfd.readouterr() == ("", "")


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
