"""The IK step: thousands of boxes, solved exactly, and refused where there is nothing to solve."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import assert_within, by_bvls, random_programs, violation_of_kkt
from threadpoolctl import threadpool_limits

from linear_ik import ik_step
from linear_ik.errors import StepError
from linear_ik.ik_step import OsqpStep, make_solver
from linear_ik.terms import Objective


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    with threadpool_limits(1):
        yield


# solved -----------------------------------------------------------------------------------


# A thousand boxes of each size; those of 300 variables in parts, which workers can share.
@pytest.mark.parametrize(
    ("n", "count", "compared", "seed"),
    [(30, 1000, 4, 0), (90, 1000, 20, 0), *((300, 200, 60, seed) for seed in range(5))],
)
def test_a_thousand_boxes(n: int, count: int, compared: int, seed: int) -> None:
    solve, at_bounds = make_solver("osqp"), 0
    for i, program in enumerate(random_programs(n, count, seed)):
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


def test_a_program_that_osqp_gives_up_is_solved_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ik_step, "_active_set", lambda *_: None)
    monkeypatch.setattr(ik_step, "MOST_ITERATIONS", 2)
    solve = OsqpStep()
    for program in random_programs(30, 20, seed=7):
        dx = solve(*program)
        assert_within(dx, *program[1:])
        assert violation_of_kkt(program, dx) < 1e-7


def test_a_program_that_nobody_solves_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    unsolved = scipy.optimize.OptimizeResult(x=np.zeros(30), active_mask=np.zeros(30), success=False)
    monkeypatch.setattr(ik_step, "_active_set", lambda *_: None)
    monkeypatch.setattr(ik_step, "MOST_ITERATIONS", 2)
    monkeypatch.setattr(scipy.optimize, "lsq_linear", lambda *_, **__: unsolved)
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
