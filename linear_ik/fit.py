"""Fit: an element and a scan in, the as-built element out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
from threadpoolctl import ThreadpoolController

from linear_ik.basin import plain, searched
from linear_ik.chain import Pose
from linear_ik.conclusion import Clock, absent, conclude
from linear_ik.coordinates import coarse_step_m, distance_hint, unit_hint
from linear_ik.descent import Log
from linear_ik.doubts import turned_away
from linear_ik.element import Element
from linear_ik.errors import ElementError, ScanError
from linear_ik.fitted_length import fit_length
from linear_ik.icpik import icpik
from linear_ik.ik_step import make_solver
from linear_ik.outliers import without_outliers
from linear_ik.problem import Problem
from linear_ik.reason import Reason
from linear_ik.result import FitResult, IterationRecord, SegmentCount
from linear_ik.sampling import stratified
from linear_ik.scan import Scan
from linear_ik.segment_count import choose_segments
from linear_ik.settings import FitSettings
from linear_ik.settlement import NARROW_SCALE, ROBUST_SCALE, Settled, measured, settle
from linear_ik.tally import nearby

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LEAST_POINTS = 12  # of a scan
COARSE_POINTS_A_SEGMENT = 100
SETTLE_POINTS_A_SEGMENT = 300
MISPLACED = 0.3  # share of all points, from where on the stations may be
MORE = 1.1  # times as many points without stations as with them
NEAR_M = 0.1  # after a search, only points this near to the chain are looked at again


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
        log, clock, given = Log(on_iteration, element.placement.T_world_element), Clock(), settings or FitSettings()

        def fit_once(known: Element, end_m: Array | None = None) -> FitResult:
            return _fit(known, scan, given, log, clock, end_m)

        tried: tuple[SegmentCount, ...] = ()
        if element.auto_segments:
            # Each count has a history of its own.
            def fit_known(counted: Element) -> FitResult:
                own = Log(on_iteration, element.placement.T_world_element)
                return _fit(replace(counted, length_tolerance_m=0.0), scan, given, own, clock)

            result, tried = choose_segments(element, scan, fit_known)
            element = replace(element, segments=result.element.segments, auto_segments=False)
            if result.status == "not_scanned":
                # Nothing to measure a length on.
                result = replace(result, element=element)
            elif element.length_tolerance_m:
                result = fit_length(element, scan, fit_once)
        else:
            result = fit_length(element, scan, fit_once) if element.length_tolerance_m else fit_once(element)
        result = replace(result, segment_counts=tried)
        return coarseness_said(replace(result, timings_s=clock.timings()), scan)


def not_scanned(element: Element, reason: str, settings: FitSettings | None = None) -> FitResult:
    """Return the result for an element that no point is near: the design, with status not_scanned; no fit is made.

    Args:
        element: what was designed.
        reason: what the scan has instead, for the result.
        settings: those of the fits of its neighbours.
    """
    settings, clock = settings or FitSettings(), Clock()
    # As in `fit`; numbers must not hang on how many threads there are either.
    with thread_pools().limit(limits=1):
        problem = Problem.of(element, None)
        clock.lap("prepare")
        return absent(problem, (_absent(reason),), settings, Log(None, element.placement.T_world_element), clock)


def _fit(
    element: Element, scan: Scan, settings: FitSettings, log: Log, clock: Clock, end_m: Array | None = None
) -> FitResult:
    solver = make_solver(settings.solver)
    problem = Problem.of(element, scan, end_m)
    removed: tuple[Reason, ...] = ()
    if settings.outlier_removal:
        before, problem = len(problem.points), problem.seeing(without_outliers(problem.points))
        count = f"{before - len(problem.points)} of {before}"
        removed = (Reason("outliers_removed", f"{count} points near the element were removed as outliers"),)
    rng, n = np.random.default_rng(settings.seed), element.segments
    clock.lap("prepare")
    if len(problem.points) < LEAST_POINTS:
        T = element.placement.T_world_element
        unit = unit_hint(scan.points, T, element.length_m)
        hint = Reason("scan_elsewhere", distance_hint(scan.points, T)) if unit is None else Reason("scan_units", unit)
        return absent(problem, (_absent(f"{len(problem.points)} points in its reach"), hint), settings, log, clock)

    if settings.method == "icpik":
        found = icpik(problem, settings, solver, log)
        clock.lap("icpik")
        return conclude(measured(problem, found, settings), scan, settings, log, clock)

    few = sample(problem, problem.chain.pose(problem.designed), COARSE_POINTS_A_SEGMENT * n, rng)
    found, sure = plain(problem, few, settings, solver, log)
    clock.lap("coarse")
    robust_scale = ROBUST_SCALE
    if settings.search == "always" or (settings.search == "auto" and not sure):
        robust_scale = NARROW_SCALE
        found = searched(problem, scan, found, settings, solver, log, rng)
        problem = problem.seeing(nearby(problem, found.pose, NEAR_M))
        clock.lap("search")
        if len(problem.points) < LEAST_POINTS:
            return absent(problem, (_absent("no points make up its surface"),), settings, log, clock)

    some = sample(problem, found.pose, sample_size(problem), rng)
    settled = settle(problem, found, some, settings, solver, log, robust_scale)
    clock.lap("settle")
    result = conclude(settled, scan, settings, log, clock).with_reasons(*removed)
    if problem.matcher.sights is not None and contradicted(settled):
        # Files name stations that are none: the file's own origin, say.
        bare = Log(log.on_iteration, log.T_world_element)
        other = _fit(element, Scan(scan.points, scan.normals), settings, bare, clock, end_m)
        if sum(s.points for s in other.segments) > MORE * sum(s.points for s in result.segments):
            why = "more points fit where their stations could not have seen them: the stations were not used"
            return other.with_reasons(Reason("stations_not_used", why))
    return result


def _absent(instead: str) -> Reason:
    return Reason("absent", f"the element is not in the scan: {instead}")


def contradicted(settled: Settled) -> bool:
    """Whether points lie on faces that their stations cannot see, or some segments on something else."""
    away = turned_away(settled.problem.surface, settled.pairs, settled.matched, settled.noise_m)
    return bool(away.sum() > MISPLACED * (away | settled.matched).sum() or settled.foreign.any())


def coarseness_said(result: FitResult, scan: Scan) -> FitResult:
    """Return the result, in doubt where the scan's coordinates were stored in steps of a millimetre or more."""
    step_m = coarse_step_m(scan.points)
    if step_m is None:
        return result
    why = f"the scan's coordinates were stored in single precision, in steps of {step_m * 1e3:.3g} mm at their size"
    return result.with_reasons(Reason("coarse_coordinates", why))


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
