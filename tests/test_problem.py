"""The problem a fit works on: the scan in the element's frame, what may move, and which points are looked at."""

from __future__ import annotations

import numpy as np
import pytest
from samples import SAMPLES

from linear_ik.bending import bend_element
from linear_ik.correspondence import Correspondences
from linear_ik.element import Element, Placement
from linear_ik.problem import AXIAL, Problem, in_reach, thinned
from linear_ik.profile import Circle, Profile, Rectangle
from linear_ik.scan import Scan
from linear_ik.simulate import simulate

SINGLE = 2e-6  # what single precision may mistake over 3 m


def in_rows(pairs: Correspondences, values: np.ndarray) -> np.ndarray:
    """Values of the matches, in the order of the points."""
    out = np.empty_like(values)
    out[pairs.order] = values
    return out


@pytest.mark.parametrize(
    "placement",
    [
        Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2), ref_direction=(0, 0, 1)),
        Placement((0, 0, 0), axis=(0, 0, -1), ref_direction=(0, 1, 0)),
    ],
    ids=["utm", "upside down"],
)
def test_where_the_element_stands_changes_no_match(placement: Placement) -> None:
    bends, profile = ["2:y:25"], SAMPLES["l_shape"]
    here = Element("e", profile, 2.0, 4)
    there = Element("e", profile, 2.0, 4, placement=placement)
    problems = [Problem.of(e, Scan(simulate(e, bends=bends, points=2000).points)) for e in (here, there)]
    # A UTM coordinate is rounded to a nanometre.
    np.testing.assert_allclose(problems[1].points, problems[0].points, rtol=0, atol=5e-9)
    x = problems[0].chain.with_q(bend_element(here, bends).q)
    one, other = (p.matcher.match(p.chain.pose(x), p.points) for p in problems)
    np.testing.assert_allclose(in_rows(one, one.distance_m), in_rows(other, other.distance_m), rtol=0, atol=SINGLE)
    assert (in_rows(one, one.segment) == in_rows(other, other.segment)).mean() > 0.999


def test_points_out_of_the_elements_reach_are_left_out() -> None:
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 4, placement=Placement((100, 200, 300)))
    near = simulate(element, bends=["1:x:45", "2:x:45"], points=300).points
    far = near + [0, 0, 500]
    problem = Problem.of(element, Scan(np.concatenate([near, far])))
    np.testing.assert_allclose(problem.points, near - [100, 200, 300], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("profile", "start", "held"),
    [
        (Rectangle(0.1, 0.3), "fixed", [0, 1, 2, 3, 4, 5]),
        (Circle(0.1), "fixed", [0, 1, 2, 3, 4, 5, 6, 9, 12]),
        (Rectangle(0.1, 0.3), "pinned", [0, 1, 2]),
        (Rectangle(0.1, 0.3), "roller", [0, 1, 2]),
        (Rectangle(0.1, 0.3), "free", [2]),
    ],
)
def test_what_may_move(profile: Profile, start: str, held: list[int]) -> None:
    element = Element("e", profile, 2.0, 3, start=start)
    problem = Problem.of(element, Scan(np.zeros((1, 3))))
    assert np.setdiff1d(np.arange(15), problem.variables).tolist() == held
    assert problem.may_slide == (start in ("roller", "free"))
    assert np.setdiff1d(np.arange(15), problem.released().variables).tolist() == [i for i in held if i != AXIAL]
    assert not problem.designed.any()


@pytest.mark.parametrize("end", ["free", "roller", "pinned", "fixed"])
def test_a_slide_is_held_unless_the_far_end_holds_it(end: str) -> None:
    for start in ("free", "roller"):
        problem = Problem.of(Element("e", Rectangle(0.1, 0.3), 2.0, 3, start=start, end=end), Scan(np.zeros((1, 3))))
        assert (AXIAL in problem.variables) == (end in ("pinned", "fixed"))


def test_another_prior_other_points_another_section() -> None:
    element = Element("e", Rectangle(0.1, 0.3), 2.0, 3)
    problem = Problem.of(element, Scan(simulate(element, points=50).points))
    sd, mean = np.full(15, 0.1), np.full(15, 0.01)
    stiffer = problem.expecting(sd, mean)
    assert stiffer.prior_sd is sd and stiffer.prior_mean is mean and problem.prior_mean is not mean
    assert stiffer.expecting(2 * sd).prior_mean is mean
    assert len(problem.seeing(problem.points[:7]).points) == 7 and len(problem.points) == 50
    wider = problem.measuring(problem.surface.scaled(np.array([1.1, 1.0])))
    pairs = wider.matcher.match(wider.chain.pose(wider.designed), np.array([[0.06, 0.0, 1.0]]))
    assert pairs.residual_m[0] == pytest.approx(0.005)


# points of the problem -------------------------------------------------------------------


def test_many_points_are_kept_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    T = Placement((512_345.678, 5_412_345.678, 321.5), axis=(0.3, -0.7, 0.2)).T_world_element
    points = T[:3, 3] + rng.uniform(-4, 4, (1000, 3))
    few, kept = in_reach(points, T, 3.0)
    monkeypatch.setattr("linear_ik.problem.MANY_POINTS", 300)
    many, kept_of_many = in_reach(points, T, 3.0)
    near = np.linalg.norm(points - T[:3, 3], axis=1) <= 3.0
    assert few.dtype == np.float64 and many.dtype == np.float32 and len(few) == len(many) == near.sum()
    np.testing.assert_array_equal(kept, near)
    np.testing.assert_array_equal(kept_of_many, near)
    np.testing.assert_allclose(few, (points - T[:3, 3])[near] @ T[:3, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(many, few, rtol=0, atol=2e-7)


def test_thinned_is_one_point_a_cell_as_measured() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-5, 5, (5000, 3))
    thin = thinned(points, 1.0, seed=2)
    assert (thin[:, None] == points[None]).all(axis=2).any(axis=1).all()
    cells = np.floor(thin - points.min(axis=0)).astype(int)
    every = np.floor(points - points.min(axis=0)).astype(int)
    assert len(np.unique(cells, axis=0)) == len(thin) == len(np.unique(every, axis=0))
    np.testing.assert_array_equal(thin, thinned(points, 1.0, seed=2))
    assert (thin != thinned(points, 1.0, seed=3)).any()
