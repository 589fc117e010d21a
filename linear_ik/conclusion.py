"""Conclusion: the result of a settled fit, in the scan's coordinates, and the verdict on it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.assessment import assess_segments, cloud_rmse, judge, listed, spread, unobservable
from linear_ik.chain import BASE, Pose
from linear_ik.coordinates import length_hint
from linear_ik.curved_segments import sagittas
from linear_ik.descent import Log, known_terms
from linear_ik.design_axis import bulges_m
from linear_ik.doubts import (
    beside_all_along,
    doubts,
    plates_too_thin,
    segments_turned_away,
    sides_off,
    stepped_aside,
)
from linear_ik.evidence import alike_unknown
from linear_ik.problem import Problem
from linear_ik.reason import Reason
from linear_ik.result import FitResult, SegmentResult, status_of
from linear_ik.scan import Scan
from linear_ik.seen_through import seen_through
from linear_ik.settings import FitSettings
from linear_ik.settlement import Settled
from linear_ik.tapered_surface import surface_of
from linear_ik.terms.objective import Objective
from linear_ik.uncertainty import birge_ratio, covariance, pressed_limits

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SLID_M = 0.006
CHORD_SHARE = 2.0 / 3.0  # of a parabola's height: its mean over the chord


def conclude(settled: Settled, scan: Scan, settings: FitSettings, log: Log, clock: Clock) -> FitResult:
    """Return the result of a settled fit, and the verdict on it; all of the scan's points say what is empty."""
    problem, pose, noise_m = settled.problem, settled.pose, settled.noise_m
    points, whole = settled.tally.objective, settled.objective
    whole = Objective(whole.H - alike_unknown(problem, noise_m), whole.c)
    S, node_covariance = covariance(problem, pose, whole, noise_m)
    segments = assess_segments(problem, settled.tally, settled.foreign, noise_m)
    pressed = pressed_limits(problem, settled.x, whole, S, np.array([s.surface_rmse_m for s in segments]))
    ratio = birge_ratio(problem, settled.tally.patch_score, points, whole)
    if ratio > 1.0:
        # The points are worth less by the ratio; what is known besides them is worth what it was.
        worth = Objective(points.H + ratio * (whole.H - points.H), points.c + ratio * (whole.c - points.c))
        S, node_covariance = covariance(problem, pose, worth, noise_m * float(np.sqrt(ratio)))
    still_m = pose.node_jacobians() @ settled.still
    node_covariance += still_m[:, :, None] * still_m[:, None, :]
    reasons = judge(problem, pressed, segments, spread(pose, node_covariance), noise_m, settled.converged)
    if status_of(r.code for r in reasons) == "not_scanned":
        if (too_long := length_hint(scan.points, problem.element.length_m)) is not None:
            reasons += (Reason("length_unit", too_long),)
        return absent(problem, reasons, settings, log, clock)
    # The design's own chords are no doubt of the fit.
    node_covariance += chord_covariance(problem, pose)
    reasons += tuple(doubted(settled, scan, settings))
    rmse_m = cloud_rmse(problem, pose, settled.tally, settled.some[settled.pairs.order[settled.matched]], settings.seed)
    clock.lap("assess")
    return in_scan_coordinates(
        problem,
        settled.x,
        S + np.outer(settled.still, settled.still),
        node_covariance,
        settings,
        log,
        clock,
        reasons=reasons,
        rmse_m=rmse_m,
        surface_rmse_m=settled.tally.surface_rmse_m,
        range_noise_m=noise_m,
        segments=segments,
        unobservable=unobservable(problem, pose, node_covariance),
        section_scale=tuple(settled.misfit.scale.tolist()) if settled.misfit and settled.misfit.plausible else None,
    )


def chord_covariance(problem: Problem, pose: Pose) -> Array:
    """Return what the chords of a curved design add to the covariance of the nodes [N+1][3][3], element's frame.

    The points make each segment the chord that lies amid the curve, with its ends outside it by two thirds of the
    bulge. As built the curve may be another one: that is no correction, but as unsure the nodes are.
    """
    points = problem.element.axis_points
    if points is None:
        return np.zeros((pose.n_segments + 1, 3, 3))
    bulge_m = np.einsum("kij,kj->ki", pose.rotations, bulges_m(points, problem.element.design))
    each = np.concatenate([bulge_m[:1], bulge_m, bulge_m[-1:]])
    off_m = CHORD_SHARE * 0.5 * (each[:-1] + each[1:])
    return np.asarray(off_m[:, :, None] * off_m[:, None, :])


def doubted(settled: Settled, scan: Scan, settings: FitSettings) -> Iterator[Reason]:
    """Yield what the points around a settled fit put in doubt."""
    problem, pose, noise_m = settled.problem, settled.pose, settled.noise_m
    sample = (problem.surface, settled.pairs, settled.matched, noise_m)
    if settled.start_shift_m is not None:
        yield Reason(
            "start_beside", "the scan shows the start beside the place where it is held (start: free lets it move)"
        )
    slide = settled.slide
    if slide is not None and not problem.may_slide and abs(slide.shift_m) > max(SLID_M, 3.0 * slide.sd_m):
        where = f"both ends of the scan lie {1e3 * slide.shift_m:+.0f} mm along the axis from where the start is held"
        yield Reason("shifted_along", f"{where} (start: free lets it move)")
    if settings.range_noise_m is not None and noise_m != settings.range_noise_m:
        given = f"where a range noise of {1e3 * settings.range_noise_m:g} mm was given"
        yield Reason("noise_misgiven", f"the points scatter {1e3 * noise_m:.1f} mm about the surface, {given}")
    yield from doubts(*sample)
    known = problem.matcher.sights is not None
    if known and (hidden := segments_turned_away(*sample)).any():
        yield Reason(
            "turned_away", f"{listed(hidden)}: many points there lie on faces that look away from their station"
        )
    off_m = sides_off(settled.tally.patch_score, settled.tally.patch_off_m, noise_m)
    if off_m.any():
        off = f"{listed(off_m > 0)}: a side lies {1e3 * off_m.max():.1f} mm off the surface"
        yield Reason("side_off", f"{off}: something touches it there, or its section is another")
    through = seen_through(problem, scan, pose, noise_m, settings.seed)
    if through.any():
        they = "it" if through.sum() == 1 else "they"
        yield Reason("seen_through", f"{listed(through)}: the scanner saw through where {they} would be")
    beside = beside_all_along(settled.tally.matched, settled.tally.beside)
    if beside:
        there = f"all along the element {beside:.0%} of the points near its surface lie beside it"
        yield Reason("beside_all_along", f"{there}: another section, or something runs along it")
    bulge_m = sagittas(settled.pairs, problem.element.segment_length_m, noise_m)
    if bulge_m.any():
        bends = f"{listed(bulge_m > 0)}: the member bends there between two joints, {1e3 * bulge_m.max():.1f} mm"
        yield Reason("bends_between_joints", f"{bends} off the segment (more segments would follow it)")
    step = stepped_aside(pose)
    if step is not None:
        first, last, aside_m = step
        where = f"segment {first + 1}" if first == last else f"segments {first + 1} to {last + 1}"
        aside = f"it steps {1e3 * aside_m:.0f} mm aside at {where}"
        yield Reason("stepped_aside", f"{aside}: a neighbour may have been taken for it")
    if not known and plates_too_thin(*sample, ~settled.unseen):
        thin = "the two sides of the section's thin plates cannot be told apart"
        yield Reason(
            "thin_plates", f"points scatter {1e3 * noise_m:.1f} mm: {thin} (a scan that names its stations can)"
        )
    if settled.foreign.any():
        elsewhere = ", or the start is not where it is held" if settled.foreign[0] and not problem.may_slide else ""
        there = f"{listed(settled.foreign)}: the points there lie on something else than the designed surface"
        yield Reason("foreign_points", f"{there}{elsewhere}")
    if settled.touched.any():
        there = f"{listed(settled.touched)}: something touches a side there"
        yield Reason("touched", f"{there}, whose points hardly count")
    if settled.misfit is not None:
        sentence = settled.misfit.sentence(surface_of(problem.element))
        yield Reason("section_size" if settled.misfit.plausible else "other_section", sentence)


def absent(problem: Problem, reasons: tuple[Reason, ...], settings: FitSettings, log: Log, clock: Clock) -> FitResult:
    """Return the result for an element that is not in the scan: the design, as uncertain as the prior."""
    x = problem.designed
    pose = problem.chain.pose(x)
    S, node_covariance = covariance(problem, pose, known_terms(problem, x, pose, 1e-3), 1e-3)
    unseen = SegmentResult("not_scanned", 0, 0.0, float("nan"))
    return in_scan_coordinates(
        problem,
        x,
        S,
        node_covariance,
        settings,
        log,
        clock,
        reasons=reasons,
        rmse_m=float("nan"),
        surface_rmse_m=float("nan"),
        range_noise_m=float("nan"),
        segments=(unseen,) * pose.n_segments,
    )


def in_scan_coordinates(
    problem: Problem,
    x: Array,
    S: Array,
    node_covariance: Array,
    settings: FitSettings,
    log: Log,
    clock: Clock,
    reasons: tuple[Reason, ...],
    **known: Any,
) -> FitResult:
    """Return the result of a chain at ``x``, from the element's frame into the scan's.

    Args:
        problem: what was fitted.
        x: [6 + 3N] where it ended.
        S: [6 + 3N][6 + 3N] covariance of the variables.
        node_covariance: [N+1][3][3] what it makes of the nodes, element's frame.
        settings: of the fit.
        log: of the iterations.
        clock: of the stages.
        reasons: of which its status is made.
        known: the other fields of the result.
    """
    chain = problem.chain
    T = problem.element.placement.T_world_element
    R = T[:3, :3]
    reasons = (*reasons, *(Reason("without_effect", text) for text in problem.element.without_effect))
    # Shared by all points, so by all nodes: a translation of the whole. No verdict depends on it.
    shared_m2 = settings.systematic_error_m**2 * np.eye(3)
    configuration = S.copy()
    configuration[:3, :3] += shared_m2
    limits = np.stack([chain.lower, chain.upper], axis=-1)[BASE:].reshape(-1, 3, 2)
    return FitResult(
        element=problem.element,
        status=status_of(r.code for r in reasons),
        reasons=tuple(r.sentence for r in reasons),
        reason_codes=tuple(r.code for r in reasons),
        nodes_m=chain.pose(x).nodes_m @ R.T + T[:3, 3],
        nodes_covariance_m2=R @ node_covariance @ R.T + shared_m2,
        q=x[BASE:].copy(),
        joint_angles_rad=x[BASE:].reshape(-1, 3)[:, ::-1].copy(),
        joint_limits_rad=limits[:, ::-1].copy(),
        base_pose=T @ chain.base_pose(x),
        history=tuple(log.records),
        settings=settings,
        timings_s=clock.timings(),
        configuration_covariance=configuration,
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
        self._laps[name] = self._laps.get(name, 0.0) + now - self._lap
        self._lap = now

    def timings(self) -> dict[str, float]:
        """Return seconds by stage, and their total."""
        return {**self._laps, "total": time.perf_counter() - self._started}
