"""Uncertainty: covariances against plain inverses and against the scatter they promise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linear_ik.chain import BASE, Pose
from linear_ik.correspondence import Correspondences
from linear_ik.element import Element, PlacementTolerance
from linear_ik.problem import AXIAL, Problem
from linear_ik.profile import Circle, Profile, Rectangle, TShape
from linear_ik.scan import Scan
from linear_ik.simulate import simulate
from linear_ik.terms import Objective
from linear_ik.terms.point_residual import point_residual
from linear_ik.terms.prior import prior
from linear_ik.uncertainty import covariance, noise_of, point_noise, pressed_limits

BENDS = ("2:y:8", "4:x:-5")


def residuals_only(residual_m: np.ndarray) -> Correspondences:
    n = len(residual_m)
    none = np.zeros(n, dtype=np.intp)
    return Correspondences(none, np.array([0, n]), none, np.zeros((n, 3)), residual_m, np.zeros((n, 2)), residual_m)


class Fitted:
    """A member at its true shape, the points matched, all terms of the fit added up."""

    def __init__(self, bends: Sequence[str] = BENDS, noise_m: float = 0.001, **changes: object) -> None:
        fields = {"name": "e", "profile": Rectangle(0.1, 0.3), "length_m": 2.0, "segments": 4}
        self.element = Element(**{**fields, **changes})  # type: ignore[arg-type]
        scan = simulate(self.element, bends=bends, points=3000, noise_m=0.0)
        self.problem = Problem.of(self.element, Scan(scan.points))
        self.x = self.problem.chain.with_q(scan.q)
        self.pose: Pose = self.problem.chain.pose(self.x)
        self.pairs = self.problem.matcher.match(self.pose, self.problem.points)
        self.noise_m = noise_m
        points = point_residual(self.pose, self.pairs, np.ones(3000))
        information = (noise_m / self.problem.prior_sd) ** 2
        self.objective = points + prior(self.x, self.x, information)

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        return covariance(self.problem, self.pose, self.objective, self.noise_m)


# noise ------------------------------------------------------------------------------------


@pytest.mark.parametrize("sd", [0.0003, 0.001, 0.004])
def test_noise_is_the_standard_deviation_of_normal_residuals(sd: float) -> None:
    residual = np.random.default_rng(0).normal(0, sd, 20_000)
    assert noise_of(residuals_only(residual)) == pytest.approx(sd, rel=0.03)


def test_a_fifth_of_strays_does_not_double_the_noise() -> None:
    rng = np.random.default_rng(1)
    residual = np.concatenate([rng.normal(0, 0.001, 8000), rng.uniform(0.01, 0.5, 2000)])
    assert 0.001 < noise_of(residuals_only(residual)) < 0.0015
    weights = np.concatenate([np.ones(8000), np.zeros(2000)])
    assert noise_of(residuals_only(residual), weights) == pytest.approx(0.001, rel=0.05)


def test_noise_has_a_floor_and_a_ceiling() -> None:
    assert noise_of(residuals_only(np.zeros(10))) > 0
    assert noise_of(residuals_only(np.full(10, 3.0))) == 0.01
    for nothing in (noise_of(residuals_only(np.zeros(0))), noise_of(residuals_only(np.ones(5)), np.zeros(5))):
        assert 0 < nothing <= 0.01


@given(st.lists(st.floats(-10, 10), max_size=20), st.integers(0, 2**32))
def test_noise_is_always_a_number(residual: list[float], seed: int) -> None:
    weights = np.random.default_rng(seed).integers(0, 2, len(residual)).astype(float)
    assert 0 < noise_of(residuals_only(np.array(residual)), weights) <= 0.01


@pytest.mark.parametrize("noise_m", [0.0005, 0.001, 0.003])
@pytest.mark.parametrize(
    ("profile", "points"),
    [(Rectangle(0.1, 0.3), 10_000), (Circle(0.15), 40_000), (TShape(0.2, 0.2, 0.02, 0.02), 40_000)],
)
def test_patches_tell_the_noise_before_any_fit(profile: Profile, points: int, noise_m: float) -> None:
    cloud = simulate(Element("e", profile, 2.5), points=points, noise_m=noise_m).points
    assert point_noise(cloud, cloud, np.random.default_rng(0)) == pytest.approx(noise_m, rel=0.4)


@pytest.mark.parametrize("count", [6, 12, 30])
def test_a_handful_of_points_has_a_finite_noise(count: int) -> None:
    cloud = np.random.default_rng(2).uniform(size=(count, 3))
    assert np.isfinite(point_noise(cloud, cloud, np.random.default_rng(0)))


# covariance -------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["fixed", "pinned", "roller", "free"])
@pytest.mark.parametrize("profile", [Rectangle(0.1, 0.3), Circle(0.1)], ids=["beam", "pipe"])
def test_it_is_the_inverse_of_the_information(start: str, profile: Profile) -> None:
    fit = Fitted(start=start, profile=profile, noise_m=0.002)
    S, nodes = fit.covariance()
    # A slide that the fit held is as free as it is to the scan.
    moving = fit.problem.released().variables if fit.problem.may_slide else fit.problem.variables
    information = fit.objective.of(moving).H / 0.002**2
    # A free base and the first joint turn the same member: one is told from the other by the prior alone.
    product = S[np.ix_(moving, moving)] @ information
    np.testing.assert_allclose(product, np.eye(len(moving)), rtol=0, atol=1e-3)
    sd = np.sqrt(S[moving, moving])
    np.testing.assert_allclose(S / S.max(), S.T / S.max(), rtol=0, atol=1e-10)
    assert (sd > 0).all() and (sd <= 1.001 * fit.problem.prior_sd[moving]).all()
    held = np.setdiff1d(np.arange(len(S)), moving)
    assert not S[held].any() and not S[:, held].any()
    assert nodes.shape == (5, 3, 3)


def test_nodes_take_theirs_by_the_chain_rule() -> None:
    fit = Fitted(start="free")
    S, nodes = fit.covariance()
    A, h = np.empty((5, 3, len(fit.x))), 1e-6
    for i, step in enumerate(h * np.eye(len(fit.x))):
        chain = fit.problem.chain
        A[:, :, i] = (chain.pose(fit.x + step).nodes_m - chain.pose(fit.x - step).nodes_m) / (2 * h)
    for k in range(5):
        np.testing.assert_allclose(nodes[k], A[k] @ S @ A[k].T, rtol=1e-6, atol=1e-12)
        assert np.linalg.eigvalsh(nodes[k]).min() > -1e-15


def test_a_fixed_start_is_certain_and_the_tip_the_least() -> None:
    _, nodes = Fitted().covariance()
    sd = np.sqrt(np.trace(nodes, axis1=1, axis2=2))
    assert sd[0] == 0 and sd[-1] > sd[1] > 0


def test_more_noise_is_more_uncertainty() -> None:
    # Of the points alone: a prior does not grow with the noise.
    fit = Fitted()
    points = point_residual(fit.pose, fit.pairs, np.ones(3000))
    one, three = (covariance(fit.problem, fit.pose, points, noise_m)[1] for noise_m in (0.001, 0.003))
    np.testing.assert_allclose(three, 9 * one, rtol=1e-9)


def test_a_slide_that_nothing_shows_keeps_its_prior() -> None:
    tolerance = PlacementTolerance(0.03, 2.0)
    straight, bent = (Fitted(bends, start="free", placement_tolerance=tolerance) for bends in ([], BENDS))
    assert AXIAL not in straight.problem.variables
    S, nodes = straight.covariance()
    assert S[AXIAL, AXIAL] == pytest.approx(0.03**2 / 3, rel=1e-6)
    np.testing.assert_allclose(nodes[:, 2, 2], 0.03**2 / 3, rtol=1e-3)
    assert (nodes[:, [0, 1], [0, 1]] < 0.001**2).all()
    # A bend shows it.
    assert np.sqrt(bent.covariance()[0][AXIAL, AXIAL]) < 0.005


def test_the_scatter_of_many_scans_is_what_it_promises() -> None:
    fit, scans = Fitted(start="free"), 600
    rng, held = np.random.default_rng(3), fit.problem.released()
    moving, nodes = held.variables, fit.pose.node_jacobians()
    sqrt_prior = fit.noise_m / fit.problem.prior_sd[moving]
    steps = np.empty((scans, len(moving)))
    for i in range(scans):
        # A new scan of the same shape, and a prior that is right about it.
        noisy = replace(fit.pairs, residual_m=fit.noise_m * rng.standard_normal(3000))
        pull = point_residual(fit.pose, noisy, np.ones(3000), moving).c
        pull = pull + sqrt_prior * fit.noise_m * rng.standard_normal(len(moving))
        steps[i] = -np.linalg.solve(fit.objective.of(moving).H, pull)
    S, node_covariance = covariance(held, fit.pose, fit.objective, fit.noise_m)
    S = S[np.ix_(moving, moving)]
    np.testing.assert_allclose(steps.var(axis=0), np.diag(S), rtol=0.25)
    mahalanobis = np.einsum("si,ij,sj->s", steps, np.linalg.inv(S), steps)
    assert mahalanobis.mean() == pytest.approx(len(moving), rel=0.04)
    moved = np.einsum("kai,si->ska", nodes[:, :, moving], steps)
    for k in range(5):
        scatter = np.cov(moved[:, k, :2].T)
        np.testing.assert_allclose(scatter.diagonal(), node_covariance[k, :2, :2].diagonal(), rtol=0.25)


# pressed limits --------------------------------------------------------------------------------


ALIKE_M = np.full(4, 0.001)  # what the points of each segment scatter


def pressed(
    at: float,
    push_sd: float,
    limit_deg: float = 10.0,
    variable: int = BASE + 4,
    scatter_m: np.ndarray = ALIKE_M,
) -> np.ndarray:
    """Which limits count as pressed: one angle at ``at`` of its limit, pulled by ``push_sd`` deviations."""
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 4, joint_limit_deg=limit_deg)
    problem = Problem.of(element, Scan(np.zeros((1, 3))))
    n, sd = problem.chain.nv, 0.001
    x = np.zeros(n)
    x[variable] = at * problem.chain.upper[variable]
    push = np.zeros(n)
    push[variable] = push_sd * sd
    H = 1e6 * np.eye(n)
    return pressed_limits(problem, x, Objective(H, -H @ push), sd**2 * np.eye(n), scatter_m)


@pytest.mark.parametrize("variable", [BASE, BASE + 4, BASE + 5])
@pytest.mark.parametrize("side", [1, -1])
def test_a_limit_is_pressed_where_the_points_want_beyond_it(side: int, variable: int) -> None:
    found = pressed(side * 1.0, side * 5.0, variable=variable)
    assert np.flatnonzero(found).tolist() == [variable]


@pytest.mark.parametrize(
    ("at", "push_sd"),
    [(1.0, -5.0), (-1.0, 5.0), (1.0, 2.0), (-1.0, -2.0), (0.99, 5.0), (0.0, 5.0), (1.0, 0.0)],
    ids="back back-from-below by-chance by-chance-below near inside at-rest".split(),
)
def test_and_nowhere_else(at: float, push_sd: float) -> None:
    assert not pressed(at, push_sd).any()


@pytest.mark.parametrize(("worse", "strained"), [(0, True), (1, True), (2, False), (3, False)])
def test_a_push_by_chance_counts_where_the_points_beside_the_joint_scatter_more(worse: int, strained: bool) -> None:
    scatter_m = ALIKE_M.copy()
    scatter_m[worse] *= 1.5
    at_limit = pressed(1.0, 1.0, scatter_m=scatter_m)  # a joint between the first segment and the second
    assert at_limit.any() == strained
    assert not pressed(0.99, 1.0, scatter_m=scatter_m).any()


def test_segments_that_nobody_saw_strain_no_limit() -> None:
    scatter_m = np.array([0.001, 0.001, np.nan, np.nan])
    assert not pressed(1.0, 1.0, scatter_m=np.concatenate([scatter_m[:1], np.full(3, np.nan)])).any()
    assert not pressed(1.0, 1.0, scatter_m=scatter_m).any()
    assert not pressed(1.0, 1.0, scatter_m=np.full(4, np.nan)).any()


def test_a_held_base_presses_nothing() -> None:
    problem = Problem.of(Element("e", Rectangle(0.1, 0.3), 2.0, 4), Scan(np.zeros((1, 3))))
    n = problem.chain.nv
    push = np.full(n, 1.0)
    found = pressed_limits(problem, np.zeros(n), Objective(np.eye(n), -push), 1e-6 * np.eye(n), ALIKE_M)
    assert not found.any()
