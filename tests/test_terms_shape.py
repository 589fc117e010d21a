"""Terms that know no points: what the paper's C and Q leave free, damping, and how terms add up."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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


def cost(objective: Objective) -> np.ndarray:
    return np.abs(objective.c).max()


def test_continuity_costs_nothing_where_every_joint_bends_alike() -> None:
    assert cost(continuity(angles([[0.3, 0.5, -0.2], *[[0.01, 0.02, 0.03]] * 3]), 1.0)) == 0
    assert cost(continuity(angles([[0, 0, 0], [0, 0.02, 0], [0, 0.05, 0], [0, 0.02, 0]]), 1.0)) > 0.01


@pytest.mark.parametrize("direction", [[0.0, 1.0], [1.0, 0.0], [0.6, 0.8]])
def test_bending_about_one_axis_is_free_whichever_it_is(direction: list[float]) -> None:
    planar = angles([[0.1, 0.3, -0.2], *([0, *(a * np.array(direction))] for a in (0.1, 0.2, -0.05))])
    assert cost(directional_constraint(planar, 1.0)) < 1e-15
    twisted, skew = planar.copy(), planar.copy()
    twisted[BASE + 3] = 0.01
    assert directional_constraint(twisted, 1.0).c[BASE + 3] == pytest.approx(0.01)
    skew[BASE + 4 : BASE + 6] += 0.01 * np.array([-direction[1], direction[0]])
    assert cost(directional_constraint(skew, 1.0)) > 1e-3


def test_a_straight_chain_may_bend_any_way_but_not_twist() -> None:
    H = directional_constraint(np.zeros(BASE + 3 * SEGMENTS), 1.0).H
    assert np.flatnonzero(np.diag(H)).tolist() == list(range(BASE + 3, BASE + 3 * SEGMENTS, 3))


@pytest.mark.parametrize("term", [continuity, directional_constraint])
@pytest.mark.parametrize("segments", [1, 2])
def test_the_first_joint_is_exempt_and_short_chains_are_chains(term: Callable, segments: int) -> None:
    objective = term(np.full(BASE + 3 * segments, 0.1), 1.0)
    assert objective.H.shape == (BASE + 3 * segments,) * 2
    assert not objective.H[: BASE + 3].any() and not objective.c[: BASE + 3].any()


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
