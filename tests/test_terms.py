"""Terms of the IK step: every H and c against finite differences of the cost it stands for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import SAMPLES

from linear_ik.chain import BASE, Chain, Pose
from linear_ik.cloud_pairs import CloudPairs
from linear_ik.correspondence import Correspondences, Matcher
from linear_ik.element import Element
from linear_ik.profile import Circle, Rectangle
from linear_ik.simulate import simulate
from linear_ik.surface import Surface
from linear_ik.terms import Objective
from linear_ik.terms.continuity import continuity
from linear_ik.terms.damping import damping
from linear_ik.terms.directional_constraint import directional_constraint
from linear_ik.terms.point_residual import point_residual
from linear_ik.terms.point_to_point import point_to_point
from linear_ik.terms.prior import prior
from linear_ik.terms.support import end_support

SEGMENTS = 4
ELEMENT = Element("beam", Rectangle(0.1, 0.3), 2.0, SEGMENTS, start="free")
CHAIN = Chain.of(ELEMENT)
Residuals = Callable[[np.ndarray], np.ndarray]


def configuration(seed: int = 0, reach: float = 0.2) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-0.02, 0.02, BASE), rng.uniform(-reach, reach, 3 * SEGMENTS)])


class Matched:
    """Points of a bent member, matched to the chain at x; then the matches are held."""

    def __init__(self, x: np.ndarray, profile: str = "rectangle", segments: int | None = None) -> None:
        element = replace(ELEMENT, profile=SAMPLES[profile])
        points = simulate(element, bends=["2:y:6", "3:x:-4"], points=400, noise_m=0.002).points
        self.surface = Surface.of(element.profile)
        self.pose = CHAIN.pose(x)
        self.pairs = Matcher(self.surface, CHAIN.segment_length_m).match(self.pose, points, segments)
        self.points = points[self.pairs.order]
        self.weights = np.random.default_rng(1).uniform(0, 4, len(points))

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """sqrt(w) r of the held matches, the chain at x."""
        pose, k = CHAIN.pose(x), self.pairs.segment
        local = np.einsum("pij,pi->pj", pose.rotations[k], self.points - pose.nodes_m[k])
        return np.sqrt(self.weights) * self.surface.offsets(local[:, :2], self.pairs.face)[0]


def points_on(profile: str, segments: int | None = None) -> Callable[[np.ndarray], tuple[Objective, Residuals]]:
    def term(x: np.ndarray) -> tuple[Objective, Residuals]:
        m = Matched(x, profile, segments)
        return point_residual(m.pose, m.pairs, m.weights), m.residuals

    return term


def cloud_pairs(x: np.ndarray) -> tuple[Objective, Residuals]:
    """The paper's term: points of the model pulled to points of the scan, the pairs held."""
    rng = np.random.default_rng(6)
    segment = np.sort(rng.choice([0, 1, 3], 200))  # nothing on the third
    local, weights = rng.uniform([-0.05, -0.15, 0], [0.05, 0.15, 0.5], (200, 3)), rng.uniform(0, 4, 200)

    def place(at: np.ndarray) -> np.ndarray:
        pose = CHAIN.pose(at)
        return np.einsum("pij,pj->pi", pose.rotations[segment], local) + pose.nodes_m[segment]

    target = place(x) + rng.normal(0, 0.01, (200, 3))
    starts = np.searchsorted(segment, np.arange(SEGMENTS + 1))
    pairs = CloudPairs(starts, place(x), target, np.linalg.norm(target - place(x), axis=1))
    objective = point_to_point(CHAIN.pose(x), pairs, weights, np.arange(len(x)))
    return objective, lambda at: (np.sqrt(weights)[:, None] * (place(at) - target)).ravel()


def damped(x: np.ndarray) -> tuple[Objective, Residuals]:
    return damping(len(x), 3.0), lambda at: np.sqrt(3.0) * (at - x)


def continuous(x: np.ndarray) -> tuple[Objective, Residuals]:
    objective = continuity(len(x), 2.0)
    return objective, lambda at: np.sqrt(2.0) * np.diff((at - x)[BASE:].reshape(-1, 3)[1:], axis=0).ravel()


def directional(x: np.ndarray) -> tuple[Objective, Residuals]:
    # The dominant axis is that of the chain as it is now.
    u = np.linalg.svd(x[BASE + 3 :].reshape(-1, 3)[:, 1:])[2][0]

    def residuals(at: np.ndarray) -> np.ndarray:
        turned = (at - x)[BASE + 3 :].reshape(-1, 3)
        across = turned[:, 1:] - np.outer(turned[:, 1:] @ u, u)
        return np.sqrt(5.0) * np.column_stack([turned[:, 0], across]).ravel()

    return directional_constraint(x, 5.0), residuals


def expected(x: np.ndarray) -> tuple[Objective, Residuals]:
    rng = np.random.default_rng(2)
    mean, information = rng.normal(0, 0.1, len(x)), rng.uniform(0, 5, len(x))
    return prior(x, mean, information), lambda at: np.sqrt(information) * (at - mean)


def held(end: str) -> Callable[[np.ndarray], tuple[Objective, Residuals]]:
    element = replace(ELEMENT, end=end, end_tolerance_m=0.004)

    def residuals(at: np.ndarray) -> np.ndarray:
        pose = CHAIN.pose(at)
        off_m = pose.nodes_m[-1] - [0, 0, 2.0]
        slope = 0.5 * pose.rotations[-1] @ [0, 0, 1]
        rows = {"roller": off_m[:2], "pinned": off_m, "fixed": [*off_m, *slope[:2]]}[end]
        return np.sqrt(7.0) * np.asarray(rows) / 0.004

    return lambda x: (end_support(element, CHAIN.pose(x), 7.0), residuals)


TERMS: dict[str, Callable[[np.ndarray], tuple[Objective, Residuals]]] = {
    **{f"points on {name}": points_on(name) for name in SAMPLES},
    "points on two segments": points_on("rectangle", 2),
    "points on points": cloud_pairs,
    "damping": damped,
    "continuity": continuous,
    "directional constraint": directional,
    "prior": expected,
    **{f"end {end}": held(end) for end in ("roller", "pinned", "fixed")},
}
EVERY = pytest.mark.parametrize("term", TERMS.values(), ids=TERMS.keys())


def differentiated(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=-1)


@EVERY
@pytest.mark.parametrize("seed", [0, 1])
def test_c_is_the_gradient_of_the_cost(term: Callable, seed: int) -> None:
    x = configuration(seed)
    objective, residuals = term(x)
    gradient = differentiated(lambda at: np.sum(residuals(at) ** 2) / 2, x)
    np.testing.assert_allclose(objective.c, gradient, rtol=0, atol=1e-6 * max(1, np.abs(gradient).max()))


@EVERY
@pytest.mark.parametrize("seed", [0, 1])
def test_h_is_the_gauss_newton_hessian_of_the_cost(term: Callable, seed: int) -> None:
    x = configuration(seed)
    objective, residuals = term(x)
    A = differentiated(residuals, x)
    np.testing.assert_allclose(objective.H, A.T @ A, rtol=0, atol=1e-6 * np.abs(objective.H).max())


@EVERY
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32), reach=st.floats(0, 3))
def test_h_is_symmetric_and_positive_semidefinite(term: Callable, seed: int, reach: float) -> None:
    H = term(configuration(seed, reach))[0].H
    np.testing.assert_array_equal(H, H.T)
    assert np.linalg.eigvalsh(H).min() >= -1e-12 * np.abs(H).max()


# points ----------------------------------------------------------------------------------


def brute_force(pose: Pose, pairs: Correspondences, weights: np.ndarray) -> Objective:
    """H and c as a sum over points, each with a Jacobian row of its own."""
    nv = pose.J.shape[1]
    H, c = np.zeros((nv, nv)), np.zeros(nv)
    for i, k in enumerate(pairs.segment):
        R, J = pose.rotations[k], pose.segment_jacobian(k + 1)
        p, normal = pose.nodes_m[k] + R @ pairs.local[i], R[:, :2] @ pairs.gradient[i]
        row = -normal @ (J[:3] + np.cross(J[3:].T, p).T)
        H += weights[i] * np.outer(row, row)
        c += weights[i] * pairs.residual_m[i] * row
    return Objective(H, c)


@pytest.mark.parametrize("profile", ["rectangle", "circle", "t_shape", "polygon"])
@pytest.mark.parametrize("segments", [None, 1, 3])
def test_moments_sum_up_to_the_points_own_jacobians(profile: str, segments: int | None) -> None:
    m = Matched(configuration(3), profile, segments)
    summed, brute = point_residual(m.pose, m.pairs, m.weights), brute_force(m.pose, m.pairs, m.weights)
    np.testing.assert_allclose(summed.H, brute.H, rtol=0, atol=1e-13 * np.abs(brute.H).max())
    np.testing.assert_allclose(summed.c, brute.c, rtol=0, atol=1e-13 * np.abs(brute.c).max())
    beyond = BASE + 3 * (segments or SEGMENTS)
    assert not summed.H[beyond:].any() and not summed.c[beyond:].any()


def test_a_long_chain_sums_up_too() -> None:
    element = Element("long", Circle(0.05), 6.0, 23)
    chain = Chain.of(element)
    points = simulate(element, bends=["12:y:20"], points=500).points
    pose = chain.pose(np.random.default_rng(0).uniform(-0.02, 0.02, chain.nv))
    pairs = Matcher(Surface.of(element.profile), chain.segment_length_m).match(pose, points)
    weights = np.ones(len(points))
    summed, brute = point_residual(pose, pairs, weights), brute_force(pose, pairs, weights)
    np.testing.assert_allclose(summed.H, brute.H, rtol=0, atol=1e-13 * np.abs(brute.H).max())


@given(chosen=st.sets(st.integers(0, BASE + 3 * SEGMENTS - 1), min_size=1))
@settings(max_examples=30, deadline=None)
def test_some_variables_are_those_of_all(chosen: set[int]) -> None:
    m, columns = MATCHED, np.array(sorted(chosen))
    whole, part = point_residual(m.pose, m.pairs, m.weights), point_residual(m.pose, m.pairs, m.weights, columns)
    np.testing.assert_allclose(part.H, whole.of(columns).H, rtol=1e-12)
    np.testing.assert_allclose(part.c, whole.of(columns).c, rtol=1e-12)


MATCHED = Matched(configuration(4))


def test_points_without_weight_pull_nothing() -> None:
    objective = point_residual(MATCHED.pose, MATCHED.pairs, np.zeros(len(MATCHED.points)))
    assert not objective.H.any() and not objective.c.any()


def test_a_step_along_the_term_brings_the_points_to_the_surface() -> None:
    element = replace(ELEMENT, start="fixed")
    chain = Chain.of(element)
    scan = simulate(element, bends=["2:y:1", "3:x:-1"], points=2000, noise_m=0.0)
    matcher, x = Matcher(Surface.of(element.profile), chain.segment_length_m), np.zeros(chain.nv)
    moving = np.arange(BASE, chain.nv)
    for _ in range(6):
        pose = chain.pose(x)
        pairs = matcher.match(pose, scan.points)
        objective = point_residual(pose, pairs, np.ones(2000), moving)
        x[moving] -= np.linalg.solve(objective.H, objective.c)
    assert np.abs(chain.pose(x).nodes_m - scan.nodes_m).max() < 1e-9


def test_damping_shortens_the_step_and_does_not_turn_it_to_a_bias() -> None:
    points = point_residual(MATCHED.pose, MATCHED.pairs, MATCHED.weights)
    n = len(points.c)
    steps = [np.linalg.norm(np.linalg.solve(*(points + damping(n, w)))) for w in (1e-2, 1.0, 1e2, 1e4)]
    assert steps == sorted(steps, reverse=True) and steps[-1] < 0.1 * steps[0]
    assert not damping(n, 5.0).c.any()
