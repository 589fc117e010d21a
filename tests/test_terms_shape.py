"""Terms that know no points: what the paper's C and Q leave free, damping, and how terms add up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from linear_ik.chain import BASE
from linear_ik.terms import Objective
from linear_ik.terms.continuity import continuity
from linear_ik.terms.damping import Damping
from linear_ik.terms.directional_constraint import directional_constraint

SEGMENTS = 4


# the paper's C and Q --------------------------------------------------------------------


def angles(rows: Sequence[Sequence[float]]) -> np.ndarray:
    """Variables of joints (z, y, x), on an unmoved base."""
    return np.concatenate([np.zeros(BASE), np.ravel(rows)])


def cost(objective: Objective, step: np.ndarray) -> float:
    return float(step @ objective.H @ step / 2)


def test_continuity_costs_nothing_where_every_joint_turns_alike() -> None:
    term = continuity(BASE + 3 * SEGMENTS, 1.0)
    assert cost(term, angles([[0.3, 0.5, -0.2], *[[0.01, 0.02, 0.03]] * 3])) == pytest.approx(0, abs=1e-15)
    uneven = angles([[0, 0, 0], [0, 0.02, 0], [0, 0.05, 0], [0, 0.02, 0]])
    assert cost(term, uneven) == pytest.approx((0.03**2 + 0.03**2) / 2)


@pytest.mark.parametrize("direction", [[0.0, 1.0], [1.0, 0.0], [0.6, 0.8]])
def test_turning_on_about_the_dominant_axis_is_free_whichever_it_is(direction: list[float]) -> None:
    planar = angles([[0.1, 0.3, -0.2], *([0, *(a * np.array(direction))] for a in (0.1, 0.2, -0.05))])
    term = directional_constraint(planar, 1.0)
    assert cost(term, planar) == pytest.approx(0, abs=1e-15)
    twist, skew = np.zeros_like(planar), np.zeros_like(planar)
    twist[BASE + 3] = 0.01
    assert cost(term, twist) == pytest.approx(0.01**2 / 2)
    skew[BASE + 4 : BASE + 6] = 0.01 * np.array([-direction[1], direction[0]])
    assert cost(term, skew) == pytest.approx(0.01**2 / 2)


def test_both_only_resist_steps_as_the_right_hand_side_of_equation_4_says() -> None:
    bent = angles([[0.1, 0.3, -0.2], [0.05, 0.1, 0.0], [0.0, 0.2, -0.1], [0.1, 0.0, 0.1]])
    assert not continuity(len(bent), 1.0).c.any() and not directional_constraint(bent, 1.0).c.any()


def test_a_straight_chain_may_bend_any_way_but_not_twist() -> None:
    H = directional_constraint(np.zeros(BASE + 3 * SEGMENTS), 1.0).H
    assert np.flatnonzero(np.diag(H)).tolist() == list(range(BASE + 3, BASE + 3 * SEGMENTS, 3))


@pytest.mark.parametrize("segments", [1, 2])
def test_the_first_joint_is_exempt_and_short_chains_are_chains(segments: int) -> None:
    x = np.full(BASE + 3 * segments, 0.1)
    for objective in (continuity(len(x), 1.0), directional_constraint(x, 1.0)):
        assert objective.H.shape == (len(x),) * 2
        assert not objective.H[: BASE + 3].any()


# damping ---------------------------------------------------------------------------------


def test_damping_adapts_within_its_bounds() -> None:
    lam = Damping(1e-6)
    assert lam.after(True).weight < lam.weight < lam.after(False).weight
    for improved, bound in ((True, lam.least), (False, lam.most)):
        adapted = lam
        for _ in range(200):
            adapted = adapted.after(improved)
        assert adapted.weight == bound and (adapted.least, adapted.most) == (lam.least, lam.most)


# objectives ------------------------------------------------------------------------------


def test_objectives_add_up() -> None:
    a, b = Objective(np.eye(2), np.array([1.0, 2.0])), Objective(2 * np.eye(2), np.array([0.5, 0.0]))
    assert (a + b).H.tolist() == [[3, 0], [0, 3]] and (a + b).c.tolist() == [1.5, 2.0]
    assert a.H.tolist() == [[1, 0], [0, 1]]
    with pytest.raises(TypeError):
        a + (np.eye(2), np.zeros(2))


def test_information_is_the_mean_over_what_is_told() -> None:
    assert Objective(np.diag([4.0, 0.0, 2.0]), np.zeros(3)).mean_information() == 3.0
    assert Objective(np.zeros((3, 3)), np.zeros(3)).mean_information() == 0.0


def test_some_variables_of_an_objective() -> None:
    H = np.arange(9.0).reshape(3, 3)
    part = Objective(H, np.array([1.0, 2.0, 3.0])).of(np.array([2, 0]))
    assert part.H.tolist() == [[8, 6], [2, 0]] and part.c.tolist() == [3, 1]
