"""Fit: an element and a scan in, the as-built element out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from linear_ik.assessment import assess_segments, cloud_rmse, judge, listed, spread
from linear_ik.chain import BASE, Pose
from linear_ik.coordinates import coarse_step_m, unit_hint
from linear_ik.descent import Descended, Log, Stage, descend, known_terms
from linear_ik.doubts import (
    doubts,
    plates_too_thin,
    quadrants,
    segments_turned_away,
    stepped_aside,
    turned_away,
)
from linear_ik.element import Element
from linear_ik.errors import ElementError, ScanError
from linear_ik.icpik import icpik
from linear_ik.ik_step import Solver, make_solver
from linear_ik.outliers import without_outliers
from linear_ik.problem import Problem, thinned
from linear_ik.repair import plate_shifts
from linear_ik.result import FitResult, IterationRecord, SegmentResult, Status
from linear_ik.sampling import stratified
from linear_ik.scan import Scan
from linear_ik.settings import FitSettings
from linear_ik.settlement import ROBUST_SCALE, Settled, measured, settle
from linear_ik.startup import Startup
from linear_ik.tally import nearby
from linear_ik.tapered_surface import surface_of
from linear_ik.uncertainty import covariance, noise_of, point_noise, pressed_limits

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SLID_M = 0.006
PLAIN_ITERATIONS = 12
PLAIN_NOISE_M = 0.0025  # beyond, another section may scatter the points
THICK = 30.0  # deviations; a segment between two sides so far apart has two points in three on neither
ABSENT = "the element is not in the scan"
LEAST_POINTS = 12
COARSE_POINTS_A_SEGMENT = 100
SETTLE_POINTS_A_SEGMENT = 300
MISPLACED = 0.3  # share of all points, from where on the stations are
NEAR_M = 0.1  # after a search, only points this near to the chain are looked at again
SEARCH_POINTS_A_SEGMENT = 300


def fit(
    element: Element,
    scan: Scan,
    settings: FitSettings | None = None,
    on_iteration: Callable[[IterationRecord], object] | None = None,
) -> FitResult:
    """Bend a designed element until it fits a scan.

    Coarse to fine: a plain descent on a few points from the design; where that leaves
    points unexplained, a search from the base outwards; then the descent on all points.

    Args:
        element: what was designed, and how it is held.
        scan: points in the same coordinates as the element's placement.
        settings: the defaults are what the project knows to be best.
        on_iteration: called with an IterationRecord after each iteration.

    Returns:
        The as-built element. Read its status before its figures.

    Raises:
        ElementError, ScanError: the arguments are something else.
        SettingsError: an unknown solver.
        StepError: the solver failed on a step.
    """
    if not isinstance(scan, Scan):
        raise ScanError("scan", f"a {type(scan).__name__}", "a Scan, such as Scan(points) or read_scan(path)")
    if not isinstance(element, Element):
        raise ElementError("element", f"a {type(element).__name__}", "an Element, such as load_element(path)")
    # Small matrices get ten times slower when BLAS spreads them over busy cores.
    with thread_pools().limit(limits=1):
        log = Log(on_iteration, element.placement.T_world_element)
        return coarseness_said(_fit(element, scan, settings or FitSettings(), log, Clock()), scan)


def _fit(element: Element, scan: Scan, settings: FitSettings, log: Log, clock: Clock) -> FitResult:
    solver = make_solver(settings.solver)
    problem = Problem.of(element, scan)
    if settings.outlier_removal:
        problem = problem.seeing(without_outliers(problem.points))
    rng, n = np.random.default_rng(settings.seed), element.segments
    clock.lap("prepare")
    if len(problem.points) < LEAST_POINTS:
        hint = unit_hint(scan.points, element.placement.T_world_element, element.length_m)
        reasons = (f"{ABSENT}: {len(problem.points)} points in its reach", *([hint] if hint else []))
        return absent(problem, reasons, settings, log, clock)

    if settings.method == "icpik":
        found = icpik(problem, settings, solver, log)
        clock.lap("icpik")
        return conclude(measured(problem, found, settings), settings, log, clock)

    few = sample(problem, problem.chain.pose(problem.designed), COARSE_POINTS_A_SEGMENT * n, rng)
    found, sure = plain(problem, few, settings, solver, log)
    clock.lap("coarse")
    if settings.search == "always" or (settings.search == "auto" and not sure):
        found = searched(problem, found, settings, solver, log, rng)
        problem = problem.seeing(nearby(problem, found.pose, NEAR_M))
        clock.lap("search")
        if len(problem.points) < LEAST_POINTS:
            return absent(problem, (f"{ABSENT}: no points make up its surface",), settings, log, clock)

    some = sample(problem, found.pose, sample_size(problem), rng)
    settled = settle(problem, found, some, settings, solver, log)
    clock.lap("settle")
    away = turned_away(settled.problem.surface, settled.pairs, settled.matched, settled.noise_m)
    if away.sum() > MISPLACED * (away | settled.matched).sum():
        # Files name stations that are none: the file's own origin, say.
        result = _fit(element, Scan(scan.points, scan.normals), settings, log, clock)
        reason = "many points lie on faces that their stations cannot see: the stations were not used"
        status: Status = "uncertain" if result.status == "converged" else result.status
        return replace(result, status=status, reasons=(*result.reasons, reason))
    return conclude(settled, settings, log, clock)


def coarseness_said(result: FitResult, scan: Scan) -> FitResult:
    """Return the result, in doubt where the scan's coordinates were stored in steps of a millimetre or more."""
    step_m = coarse_step_m(scan.points)
    if step_m is None:
        return result
    reason = f"the scan's coordinates were stored in single precision, in steps of {step_m * 1e3:.3g} mm at their size"
    status = "uncertain" if result.status == "converged" else result.status
    return replace(result, status=status, reasons=(*result.reasons, reason))


def sample(problem: Problem, pose: Pose, count: int, rng: np.random.Generator) -> Array:
    """Return at most ``count`` of the problem's points, equally along a chain at ``pose``, in double precision."""
    return problem.points[stratified(problem.points, pose.nodes_m, count, rng)].astype(np.float64)


def sample_size(problem: Problem) -> int:
    """Return how many points the fit settles on: enough for each segment, and a share of large scans."""
    least = SETTLE_POINTS_A_SEGMENT * problem.element.segments
    return max(least, min(len(problem.points) // 3, 2 * least))


@cache
def thread_pools() -> ThreadpoolController:
    """Return the process's thread pools, looked up once."""
    return ThreadpoolController()


def plain(problem: Problem, points: Array, settings: FitSettings, solver: Solver, log: Log) -> tuple[Descended, bool]:
    """Descend from the design, unweighted; where a segment is then in doubt, turn it to its points and descend again.

    Turns go on as long as each brings the doubts farther along. What they leave in doubt
    is descended once more, with weights from the noise found.

    Returns:
        Where it ended, and whether that can only be right.
    """
    stage = Stage("coarse", points, (np.inf,), settings.range_noise_m or 1e-3, PLAIN_ITERATIONS, 1e-3)
    found = descend(problem, problem.designed, stage, settings, solver, log)
    known = explained(problem, found)
    # With the first segment in doubt nothing says where to turn.
    while settings.search == "auto" and known[0] and not known.all():
        startup = Startup(problem, points, noise_of(found.pairs), settings, solver, log)
        other = descend(problem, startup.turned(found.x, int(known.argmin())), stage, settings, solver, log)
        then = explained(problem, other)
        if not then.all() and then.argmin() <= known.argmin():
            break
        found, known = other, then
    noise_m = settings.range_noise_m or noise_of(found.pairs)
    if not known.all():
        stage = Stage("coarse", points, (ROBUST_SCALE * noise_m,), noise_m, 3, 1e-4)
        found = descend(problem, found.x, stage, settings, solver, log)
        known = explained(problem, found)
    if not known.all() or seen_around(problem, found):
        return found, bool(known.all())
    # From a base that is held, no segment gets to the wrong side of something thick without one
    # between that is off both; a base that floats may have started there.
    startup = Startup(problem, points, noise_m, settings, solver, log)
    apart_m = np.linalg.norm(plate_shifts(problem.surface), axis=1).min(initial=np.inf)
    told_apart = not startup.floating and apart_m > THICK * noise_m
    return found, bool(told_apart) and startup.repaired(found.x) is found.x


def explained(problem: Problem, found: Descended) -> Mask:
    """Return the segments [N] on whose surface nearly every point around them lies, in a plain fit."""
    noise_m = noise_of(found.pairs)
    n = problem.element.segments
    if noise_m > PLAIN_NOISE_M:
        return np.zeros(n, dtype=bool)
    segment = found.pairs.segment
    count = np.bincount(segment, minlength=n)
    near = np.bincount(segment[found.pairs.distance_m < 4.5 * noise_m], minlength=n)
    return np.asarray((count >= LEAST_POINTS) & (near >= 0.95 * count))


def seen_around(problem: Problem, found: Descended) -> bool:
    """Whether the points show all four sides of every segment, as a complete cloud would but for chance.

    With a side missing, the opposite face may have taken its place.
    """
    n = problem.element.segments
    segment = found.pairs.segment
    count = np.bincount(segment, minlength=n)
    seen = np.bincount(4 * segment + quadrants(found.pairs.gradient), minlength=4 * n).reshape(n, 4)
    share = np.bincount(quadrants(problem.surface.normals), problem.surface.widths_m, minlength=4)
    expected = share / share.sum() * count[:, None]
    return bool((seen >= np.minimum(0.25 * expected, expected - 3.0 * np.sqrt(expected))).all())


def searched(
    problem: Problem, found: Descended, settings: FitSettings, solver: Solver, log: Log, rng: np.random.Generator
) -> Descended:
    """Search from the base outwards, and keep the better of its outcome and the plain one."""
    area = problem.surface.perimeter_m * problem.element.segment_length_m
    cloud = thinned(problem.points, float(np.sqrt(area / SEARCH_POINTS_A_SEGMENT)), settings.seed)
    noise_m = settings.range_noise_m or point_noise(cloud, problem.points, rng)
    startup = Startup(problem, cloud, noise_m, settings, solver, log)
    starts = [startup.run(), startup.finish(found.x)]
    best = max(starts, key=startup.score)
    cloud = startup.around(best)
    return descend(problem, best, Stage("search", cloud, (startup.tau_m,), noise_m, 6, 5e-5), settings, solver, log)


def conclude(settled: Settled, settings: FitSettings, log: Log, clock: Clock) -> FitResult:
    """Return the result of a settled fit, and the verdict on it."""
    problem, pose, noise_m = settled.problem, settled.pose, settled.noise_m
    S, node_covariance = covariance(problem, pose, settled.objective, noise_m)
    off_m = pose.node_jacobians() @ settled.still
    node_covariance += off_m[:, :, None] * off_m[:, None, :]
    pressed = pressed_limits(problem, settled.x, settled.objective, S)
    segments = assess_segments(problem, settled.tally, settled.foreign)
    status, reasons = judge(problem, pressed, segments, spread(pose, node_covariance), noise_m, settled.converged)
    if status == "not_scanned":
        return absent(problem, reasons, settings, log, clock)
    if settled.start_shift_m is not None:
        status = "uncertain" if status == "converged" else status
        reasons += ("the scan shows the start beside the place where it is held (start: free lets it move)",)
    slide = settled.slide
    if slide is not None and not problem.may_slide and abs(slide.shift_m) > max(SLID_M, 3.0 * slide.sd_m):
        status = "uncertain" if status == "converged" else status
        reasons += (
            f"both ends of the scan lie {1e3 * slide.shift_m:+.0f} mm along the axis from where the start is held "
            "(start: free lets it move)",
        )
    if settings.range_noise_m is not None and noise_m != settings.range_noise_m:
        status = "uncertain" if status == "converged" else status
        reasons += (
            f"the points scatter {1e3 * noise_m:.1f} mm about the surface, "
            f"where a range noise of {1e3 * settings.range_noise_m:g} mm was given",
        )
    doubted = doubts(problem.surface, settled.pairs, settled.matched, noise_m)
    if doubted:
        status = "uncertain" if status == "converged" else status
        reasons += doubted
    hidden = segments_turned_away(problem.surface, settled.pairs, settled.matched, noise_m)
    if hidden.any():
        status = "uncertain" if status == "converged" else status
        reasons += (f"{listed(hidden)}: many points there lie on faces that look away from their station",)
    step = stepped_aside(pose)
    if step is not None:
        first, last, aside_m = step
        status = "uncertain" if status == "converged" else status
        where = f"segment {first + 1}" if first == last else f"segments {first + 1} to {last + 1}"
        reasons += (f"it steps {1e3 * aside_m:.0f} mm aside at {where}: a neighbour may have been taken for it",)
    thin = plates_too_thin(problem.surface, settled.pairs, settled.matched, noise_m)
    if thin and problem.matcher.sights is None:
        status = "uncertain" if status == "converged" else status
        reasons += (
            f"points scatter {1e3 * noise_m:.1f} mm: the two sides of the section's thin plates cannot be told apart "
            "(a scan that names its stations can)",
        )
    if settled.foreign.any():
        elsewhere = ", or the start is not where it is held" if settled.foreign[0] and not problem.may_slide else ""
        reasons += (
            f"{listed(settled.foreign)}: the points there lie on something else than the designed surface{elsewhere}",
        )
    if settled.misfit is not None:
        if not settled.misfit.plausible:
            status = "uncertain" if status == "converged" else status
        reasons += (settled.misfit.sentence(surface_of(problem.element)),)
    rmse_m = cloud_rmse(problem, pose, settled.tally, settled.some[settled.pairs.order[settled.matched]], settings.seed)
    clock.lap("assess")
    return in_scan_coordinates(
        problem,
        settled.x,
        node_covariance,
        settings,
        log,
        clock,
        status=status,
        reasons=reasons,
        rmse_m=rmse_m,
        surface_rmse_m=settled.tally.surface_rmse_m,
        range_noise_m=noise_m,
        segments=segments,
    )


def absent(problem: Problem, reasons: tuple[str, ...], settings: FitSettings, log: Log, clock: Clock) -> FitResult:
    """Return the result for an element that is not in the scan: the design, as uncertain as the prior."""
    x = problem.designed
    pose = problem.chain.pose(x)
    _, node_covariance = covariance(problem, pose, known_terms(problem, x, pose, 1e-3), 1e-3)
    unseen = SegmentResult("not_scanned", 0, 0.0, float("nan"))
    return in_scan_coordinates(
        problem,
        x,
        node_covariance,
        settings,
        log,
        clock,
        status="not_scanned",
        reasons=reasons,
        rmse_m=float("nan"),
        surface_rmse_m=float("nan"),
        range_noise_m=float("nan"),
        segments=(unseen,) * pose.n_segments,
    )


def in_scan_coordinates(
    problem: Problem, x: Array, node_covariance: Array, settings: FitSettings, log: Log, clock: Clock, **known: Any
) -> FitResult:
    """Return the result of a chain at ``x``, from the element's frame into the scan's."""
    chain = problem.chain
    T = problem.element.placement.T_world_element
    R = T[:3, :3]
    # Shared by all points, so by all nodes: a translation of the whole. No verdict depends on it.
    shared_m2 = settings.systematic_error_m**2 * np.eye(3)
    limits = np.stack([chain.lower, chain.upper], axis=-1)[BASE:].reshape(-1, 3, 2)
    return FitResult(
        element=problem.element,
        nodes_m=chain.pose(x).nodes_m @ R.T + T[:3, 3],
        nodes_covariance_m2=R @ node_covariance @ R.T + shared_m2,
        q=x[BASE:].copy(),
        joint_angles_rad=x[BASE:].reshape(-1, 3)[:, ::-1].copy(),
        joint_limits_rad=limits[:, ::-1].copy(),
        base_pose=T @ chain.base_pose(x),
        history=tuple(log.records),
        settings=settings,
        timings_s=clock.timings(),
        **known,
    )


class Clock:
    """Wall time of the stages of one fit."""

    def __init__(self) -> None:
        """Start now."""
        self._started = self._lap = time.perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str) -> None:
        """Note the time since the last lap as that of stage ``name``."""
        now = time.perf_counter()
        self._laps[name] = now - self._lap
        self._lap = now

    def timings(self) -> dict[str, float]:
        """Return seconds by stage, and their total."""
        return {**self._laps, "total": time.perf_counter() - self._started}
