"""FitResult: the as-built member, and what is known about how right it is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.reason import CARRIED, NOTES, PLACE, Reason, only
from linear_ik.settings import FitSettings

Array = npt.NDArray[np.float64]
Status = Literal["converged", "uncertain", "max_iterations", "not_scanned"]
SegmentStatus = Literal["measured", "inferred", "not_scanned"]


def status_of(codes: Iterable[str]) -> Status:
    """Return the status that the codes of a fit's reasons come to: any doubt makes it uncertain."""
    codes = set(codes)
    if "absent" in codes:
        return "not_scanned"
    if "not_at_rest" in codes:
        return "max_iterations"
    return "uncertain" if codes - NOTES else "converged"


@dataclass(frozen=True)
class SegmentResult:
    """What the scan says of one segment.

    Attributes:
        status: measured (points fix it), inferred (something known on both sides of it,
            a measured segment or a support, fixes it), or not_scanned.
        points: scan points matched to it.
        coverage: share of its outer surface with a matched point within 2 % of the
            element's length, 0 to 1.
        surface_rmse_m: matched scan points to its surface; NaN without points.
    """

    status: SegmentStatus
    points: int
    coverage: float
    surface_rmse_m: float


@dataclass(frozen=True)
class SegmentCount:
    """One number of segments that was tried where the scan chooses it.

    Attributes:
        segments: how many.
        against: evidence against it, by which its Bayesian information criterion exceeds the least;
            0 of the one that was chosen, above 10 is strong.
        surface_rmse_m: of its fit.
    """

    segments: int
    against: float
    surface_rmse_m: float


@dataclass(frozen=True, eq=False)
class IterationRecord:
    """The state after one iteration; also what `on_iteration` is called with.

    Attributes:
        iteration: counted from 1 over the whole fit.
        phase: what the iteration belonged to: coarse, search, sample (settling on some of the
            points), full (the step on all of them), or icpik.
        points: scan points matched.
        surface_rmse_m: weighted rms distance of the matched points to the model, before
            the step.
        scale_m: distance at which a match loses most of its weight; inf when unweighted.
        damping: damping of the step, relative to the mean information of a variable.
        step_rad: largest joint change of the step.
        q: Pinocchio's configuration [3N] after the step, (z, y, x) a segment.
        base_pose: T_world_base [4][4] after the step.
    """

    iteration: int
    phase: str
    points: int
    surface_rmse_m: float
    scale_m: float
    damping: float
    step_rad: float
    q: Array
    base_pose: Array


@dataclass(frozen=True, eq=False)
class FitResult:
    """An element as it was found in a scan. All coordinates are the scan's.

    Attributes:
        element: the design that was fitted.
        status: converged | uncertain | max_iterations | not_scanned. A fit that may be
            wrong never says converged.
        reasons: plain sentences saying why the status is not converged, or what else
            the reader should know.
        reason_codes: the code of each reason, for programs (see `linear_ik.reason`); empty where a
            file of an earlier version has none: what is doubted is then not known.
        nodes_m: [N+1][3] the chain's nodes, from start to end.
        nodes_covariance_m2: [N+1][3][3], 1 sigma.
        q: [3N] Pinocchio's configuration: (z, y, x) a segment.
        joint_angles_rad: [N][3] in x, y, z order.
        joint_limits_rad: [N][3][2] lower and upper, same order.
        base_pose: [4][4] T_world_base.
        rmse_m: the paper's figure: rms distance from the scan's points to the nearest
            of a cloud sampled on the fitted model. Mostly the sampling distance.
        surface_rmse_m: rms distance of the matched scan points to the model's surface.
        range_noise_m: standard deviation of the matched points about the surface,
            as estimated by the fit and used for the covariance.
        segments: one SegmentResult a segment.
        history: one IterationRecord an iteration.
        settings: the settings used.
        timings_s: wall time of each stage, and their sum as "total".
        configuration_covariance: [6 + 3N][6 + 3N], 1 sigma, of what poses the chain together: the
            base's translation x, y, z along the element's axes (m), its rotation z, y, x and then
            ``q`` (rad). ``nodes_covariance_m2`` are its marginals; it also says how nodes vary
            together, which differences between them need. None where a file does not have it.
        unobservable: what the scan does not show, in words: torsion of a round section, the
            place along the axis, bending across an axis with the nodes (from 0) it concerns.
        section_scale: [2] how many times the section's designed x and y its points measure, where that
            is the same section out of its nominal size; the fit is to that one. None: as designed.
        length_m: along the axis, where the element's has a tolerance and the ends of the scan
            tell it; None: as designed. All else in the result describes a chain of this length.
        length_sd_m: its standard deviation; None where ``length_m`` is.
        segment_counts: what was tried where the scan chose the number of segments, coarse ones first;
            ``element`` has the chosen number.
    """

    element: Element
    status: Status
    reasons: tuple[str, ...]
    nodes_m: Array
    nodes_covariance_m2: Array
    q: Array
    joint_angles_rad: Array
    joint_limits_rad: Array
    base_pose: Array
    rmse_m: float
    surface_rmse_m: float
    range_noise_m: float
    segments: tuple[SegmentResult, ...]
    history: tuple[IterationRecord, ...]
    settings: FitSettings
    timings_s: dict[str, float] = field(default_factory=dict)
    configuration_covariance: Array | None = None
    unobservable: tuple[str, ...] = ()
    reason_codes: tuple[str, ...] = ()
    section_scale: tuple[float, float] | None = None
    length_m: float | None = None
    length_sd_m: float | None = None
    segment_counts: tuple[SegmentCount, ...] = ()

    @cached_property
    def fitted_element(self) -> Element:
        """The element with the length that was found: what ``q`` and ``base_pose`` are of."""
        return self.element if self.length_m is None else self.element.with_length(self.length_m)

    @property
    def moved_m(self) -> Array:
        """From each node's designed place to where it is [N+1][3], in the scan's coordinates."""
        T = self.element.placement.T_world_element
        return np.asarray(self.nodes_m - (self.element.design.nodes_m @ T[:3, :3].T + T[:3, 3]))

    @property
    def designed_directions(self) -> Array:
        """Unit vectors along the segments as designed [N][3], in the scan's coordinates."""
        return np.asarray(self.element.design.rotations[:, :, 2] @ self.element.placement.T_world_element[:3, :3].T)

    @property
    def length_spread_m(self) -> float:
        """Standard deviation of the length of the chain: as measured, as its tolerance leaves it, or 0 where known."""
        if self.length_sd_m is not None:
            return self.length_sd_m
        # Anywhere within the tolerance: uniform has this deviation.
        return self.element.length_tolerance_m / math.sqrt(3.0)

    @property
    def iterations(self) -> int:
        """Number of iterations run, over all phases."""
        return len(self.history)

    @property
    def doubts_are_carried(self) -> bool:
        """Whether it is uncertain only in what ``nodes_covariance_m2`` and the segments' status say as well."""
        return self.status == "uncertain" and only(self.reason_codes, CARRIED)

    @property
    def only_its_place_is_in_doubt(self) -> bool:
        """Whether all that is doubted is where it lies along its axis, which ``nodes_covariance_m2`` says as well."""
        return self.status == "uncertain" and only(self.reason_codes, PLACE)

    def with_reasons(self, *reasons: Reason) -> FitResult:
        """Return the result of a fit with further reasons, and the status that all of them come to."""
        codes = (*self.reason_codes, *(r.code for r in reasons))
        sentences = (*self.reasons, *(r.sentence for r in reasons))
        return replace(self, status=status_of(codes), reasons=sentences, reason_codes=codes)
