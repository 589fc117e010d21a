"""Fitted length: how long an element was built, told by where its cloud ends.

Faces do not show the length of a prism. What shows it are the ends of the cloud: the far one where
the start is held, both where it is not; a held end, where its own cannot be seen. The fit is then
made again with every segment scaled alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Chain, Pose
from linear_ik.cloud_end import PATCHES, WINDOW_M, CloudEnd, cloud_end
from linear_ik.correspondence import Correspondences, Matcher
from linear_ik.element import Element
from linear_ik.problem import POINTS_A_PIECE
from linear_ik.reason import Reason, ReasonCode
from linear_ik.result import FitResult
from linear_ik.scan import Scan
from linear_ik.tapered_surface import surface_of

Array = npt.NDArray[np.float64]

NOT_MEASURED = "the length is not measured"
MOST_FITS = 3
STILL = 0.1  # of the length's deviation
ON_SURFACE = 4.0  # deviations
MARGIN_M = 0.1  # beyond the tolerance: what goes on there is looked at too
START_SPREAD_M = 0.02  # a start that is known along the axis worse than this tells nothing of the length
UNUSED_M = 1e-9  # a tolerance that is none


@dataclass(frozen=True)
class Measured:
    """A length.

    Attributes:
        length_m: along the axis; None where it is not known.
        sd_m: its standard deviation.
        reasons: what the reader should know.
    """

    length_m: float | None
    sd_m: float
    reasons: tuple[Reason, ...] = ()


def fit_length(element: Element, scan: Scan, fit_once: Callable[[Element, Array], FitResult]) -> FitResult:
    """Return the fit of an element whose length has a tolerance.

    Args:
        element: the design.
        scan: points in the placement's coordinates.
        fit_once: fits an element of a known length, its end held where the second argument [3] says.
    """
    end_m, length_m = element.design.nodes_m[-1], element.length_m
    result = fit_once(element, end_m)
    for fits_left in range(MOST_FITS - 1, -1, -1):
        if result.status == "not_scanned":
            return replace(result, element=element)
        found = measure(element, length_m, result, scan)
        told_m = found.length_m
        if told_m is None:
            # What was fitted to a length that did not hold is not kept.
            result = result if length_m == element.length_m else fit_once(element, end_m)
            found = replace(found, reasons=(*found.reasons, _unknown(element)))
            break
        moved_m = abs(told_m - length_m)
        if moved_m <= STILL * found.sd_m or not fits_left:
            # The chain keeps the length that it was fitted with.
            found = replace(found, length_m=length_m, sd_m=float(np.hypot(found.sd_m, moved_m)))
            break
        length_m = told_m
        result = fit_once(element.with_length(length_m), end_m)
    return _of_length(element, result, found)


def measure(element: Element, length_m: float, result: FitResult, scan: Scan) -> Measured:
    """Return the length that the ends of the cloud tell.

    Args:
        element: the design.
        length_m: of the chain that was fitted.
        result: its fit.
        scan: points in the scan's coordinates.
    """
    along = _Along.of(element.with_length(length_m), result)
    tolerance_m = element.length_tolerance_m
    far = along.end(scan, element.length_m - tolerance_m, element.length_m + tolerance_m)
    start_m, start_sd_m = 0.0, along.start_sd_m
    reasons: tuple[Reason, ...] = ()
    if start_sd_m > 0.0:
        reach_m = element.placement_tolerance.translation_m + abs(length_m - element.length_m)
        near = along.start(scan, reach_m + tolerance_m)
        if isinstance(near, CloudEnd) and near.sd_m < start_sd_m:
            start_m, start_sd_m = near.at_m, near.sd_m
        elif start_sd_m > START_SPREAD_M:
            why = near if isinstance(near, str) else "it is not known along the axis"
            return Measured(None, np.inf, (Reason("length_not_measured", f"{NOT_MEASURED}: at the start, {why}"),))
    held = along.held_end_m(element)
    if isinstance(far, str):
        if held is None or start_sd_m > START_SPREAD_M:
            return Measured(None, np.inf, (Reason("length_not_measured", f"{NOT_MEASURED}: at the end, {far}"),))
        told = f"the length is told by where the end is held: at the end, {far}"
        reasons += (Reason("length_by_held_end", told),)
        stop_m, stop_sd_m = length_m + held, element.end_tolerance_m
    else:
        stop_m, stop_sd_m = far.at_m, far.sd_m
        if held is not None:
            apart_m, apart_sd_m = length_m + held - stop_m, float(np.hypot(stop_sd_m, element.end_tolerance_m))
            if abs(apart_m) > 3.0 * apart_sd_m:
                text = f"the scan ends {-1e3 * apart_m:+.0f} mm along the axis from where the end is held"
                reasons += (Reason("end_beside", text),)
    return _boxed(element, stop_m - start_m, float(np.hypot(stop_sd_m, start_sd_m)), reasons)


def _boxed(element: Element, length_m: float, sd_m: float, reasons: tuple[Reason, ...]) -> Measured:
    """Return a length within the tolerance, or that it is outside."""
    off_m, tolerance_m = length_m - element.length_m, element.length_tolerance_m
    if abs(off_m) > tolerance_m + 3.0 * sd_m:
        text = (
            f"{NOT_MEASURED}: the scan ends at {length_m:.3f} m, "
            f"{1e3 * (abs(off_m) - tolerance_m):.0f} mm outside the tolerance"
        )
        # Where it stops short, the rest is hidden; where it goes on, the tolerance or the element is another.
        code: ReasonCode = "longer_than_allowed" if off_m > 0 else "length_not_measured"
        return Measured(None, np.inf, (*reasons, Reason(code, text)))
    off_m = min(max(off_m, -tolerance_m), tolerance_m)
    return Measured(element.length_m + off_m, sd_m, reasons)


def _unknown(element: Element) -> Reason:
    return Reason("length_as_designed", f"the length is as designed, +- {1e3 * element.length_tolerance_m:.3g} mm")


def _of_length(element: Element, result: FitResult, found: Measured) -> FitResult:
    """Return the result with the length in it, and its nodes as uncertain as that leaves them."""
    known = found.length_m is not None
    result = replace(
        result,
        element=element,
        length_m=found.length_m,
        length_sd_m=found.sd_m if known else None,
    ).with_reasons(*found.reasons)
    chain, R = Chain.of(result.fitted_element), result.base_pose[:3, :3]
    slid = result.length_spread_m * chain.pose(chain.with_q(result.q)).length_jacobian() @ R.T
    return replace(result, nodes_covariance_m2=result.nodes_covariance_m2 + slid[:, :, None] * slid[:, None, :])


@dataclass(frozen=True, eq=False)
class _Along:
    """A fitted chain, and where the points on it lie along it. The base's frame, metres.

    Attributes:
        element: of the length that was fitted.
        pose: the chain on an unmoved base.
        T_world_base: [4][4].
        noise_m: standard deviation of a point.
        start_sd_m: of the first node along the axis; 0 where it is held.
        section_scale: of the section that was fitted, see `FitResult`.
    """

    element: Element
    pose: Pose
    T_world_base: Array
    noise_m: float
    start_sd_m: float
    section_scale: tuple[float, float] | None

    @classmethod
    def of(cls, element: Element, result: FitResult) -> _Along:
        chain = Chain.of(element)
        pose = chain.pose(chain.with_q(result.q))
        axis = result.base_pose[:3, :3] @ pose.rotations[0, :, 2]
        free = element.start in ("free", "roller")
        sd_m = float(np.sqrt(max(axis @ result.nodes_covariance_m2[0] @ axis, 0.0))) if free else 0.0
        start_sd_m = max(sd_m, UNUSED_M) if free else 0.0
        return cls(element, pose, result.base_pose, result.range_noise_m, start_sd_m, result.section_scale)

    def end(self, scan: Scan, low_m: float, high_m: float) -> CloudEnd | str:
        """Return where the points stop, along the chain from its start, between two lengths."""
        node, reach_m = self.pose.nodes_m[-1], max(high_m - self.element.length_m, self.element.length_m - low_m)
        places, patch = self._on_surface(scan, node, reach_m)
        return cloud_end(places, patch, self.noise_m, low_m, high_m)

    def start(self, scan: Scan, reach_m: float) -> CloudEnd | str:
        """Return where the points begin, along the chain from its start, up to ``reach_m`` either way."""
        places, patch = self._on_surface(scan, self.pose.nodes_m[0], reach_m)
        found = cloud_end(-places, patch, self.noise_m, -reach_m, reach_m)
        return found if isinstance(found, str) else replace(found, at_m=-found.at_m)

    def held_end_m(self, element: Element) -> float | None:
        """Return how far along the last segment the place of a held end lies beyond the chain's, or None."""
        if element.end not in ("pinned", "fixed"):
            return None
        T, base = element.placement.T_world_element, self.T_world_base
        held = (T[:3, :3] @ element.design.nodes_m[-1] + T[:3, 3] - base[:3, 3]) @ base[:3, :3]
        return float((held - self.pose.nodes_m[-1]) @ self.pose.rotations[-1, :, 2])

    def _on_surface(self, scan: Scan, node: Array, reach_m: float) -> tuple[Array, npt.NDArray[np.intp]]:
        """Return the places along the chain of the points on its surface near a node, and their part of the outline."""
        surface = surface_of(self.element, self.section_scale)
        radius_m = float(np.hypot(reach_m + 2.0 * WINDOW_M + MARGIN_M, 1.5 * surface.reach_m))
        T = self.T_world_base
        near = []
        for start in range(0, len(scan), POINTS_A_PIECE):
            piece = (scan.points[start : start + POINTS_A_PIECE] - T[:3, 3]) @ T[:3, :3]
            off = piece - node
            near.append(piece[np.einsum("pi,pi->p", off, off) <= radius_m**2])
        local = np.concatenate(near)
        lengths_m = np.full(self.element.segments, self.element.segment_length_m)
        pairs = Matcher(surface, lengths_m).match(self.pose, local)
        on = np.abs(pairs.residual_m) <= ON_SURFACE * self.noise_m
        # Along a curved design axis, whose length counts, the segments are chords.
        stretch = self.element.length_m / (self.element.segments * self.element.segment_length_m)
        places_m = self.element.segment_length_m * pairs.segment[on] + pairs.local[on, 2]
        return stretch * places_m, _patch(pairs, on)


def _patch(pairs: Correspondences, on: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Return which eighth of the directions from the middle of the section each point lies in."""
    x, y = pairs.section[on].T
    return np.asarray(np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * PATCHES).astype(np.intp) % PATCHES)
