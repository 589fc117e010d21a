"""What a person reads after a fit; every figure with its 95 % band."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from linear_ik.deviation_bands import BAND_95, band_along
from linear_ik.errors import LinearIkError
from linear_ik.result import FitResult, SegmentCount


def describe(result: FitResult) -> list[str]:
    """Return the lines."""
    lines = [_line("status", result.status)]
    lines += [_line("", reason) for reason in result.reasons]
    if result.status != "not_scanned":
        lines.append(_line("tip", tip_displacement(result)))
        lines += [_line("bow", text) for text in bow(result)]
        if result.length_m is not None and result.length_sd_m is not None:
            lines.append(_line("length", fitted_length(result.length_m, result.length_sd_m, result.element.length_m)))
        noise = f", noise {1000 * result.range_noise_m:.2f} mm" if math.isfinite(result.range_noise_m) else ""
        points = sum(segment.points for segment in result.segments)
        rms = f"{1000 * result.surface_rmse_m:.2f} mm rms over {points:,} matched points{noise}"
        lines.append(_line("surface", rms))
    counts = Counter(segment.status.replace("_", " ") for segment in result.segments)
    lines.append(_line("segments", ", ".join(f"{n} {status}" for status, n in counts.items())))
    if result.segment_counts:
        lines.append(_line("", chosen_count(result.segment_counts)))
    seconds = result.timings_s.get("total", math.nan)
    took = f" in {seconds:.2f} s" if math.isfinite(seconds) else ""
    lines.append(_line("iterations", f"{result.iterations}{took}"))
    return lines


def tip_displacement(result: FitResult) -> str:
    """Return how far the last node is from where it was designed, with its 95 % band."""
    element = result.element
    T = element.placement.T_world_element
    moved = result.nodes_m[-1] - (T[:3, 3] + T[:3, :3] @ element.design.nodes_m[-1])
    distance, covariance = float(np.linalg.norm(moved)), result.nodes_covariance_m2[-1]
    if not np.isfinite(covariance).all():
        return f"{1000 * distance:.2f} mm from the design (band unknown)"
    band = 1000 * float(band_along(moved[None], covariance[None])[0])
    return f"{1000 * distance:.2f} mm from the design, +- {band:.2f} mm (95 %)"


def bow(result: FitResult) -> list[str]:
    """Return the largest offset from the chord with its 95 % band; nothing of an element without a chord."""
    from linear_ik.deviation import deviations

    try:
        found = deviations(result).bow_m
    except LinearIkError:
        return []
    if found.value is None:
        return []
    band = "band unknown" if found.band is None else f"+- {1000 * found.band:.2f} mm (95 %)"
    return [f"{1000 * found.value:.2f} mm from the chord between its ends, {band}"]


def corners(result: FitResult) -> list[str]:
    """Return a line on what of a member's axis is no smooth curve; none where all of it is, or nothing was found."""
    from linear_ik.smooth_axis import kinks

    inner = result.element.segments - 1
    kept = 0 if result.status == "not_scanned" else int(kinks(result).sum())
    if not kept:
        return []
    if kept < inner:
        return [_line("smooth", f"but for {kept} joint{'s' if kept > 1 else ''} that stay corners, where bends jump")]
    return [_line("smooth", "no curve: the bends jump from joint to joint, so the body keeps the segments' corners")]


def fitted_length(length_m: float, sd_m: float, designed_m: float) -> str:
    """Return a length that was measured, with its 95 % band, and how far it is from the designed one."""
    change_mm = 1000 * (length_m - designed_m)
    return f"{length_m:.4f} m, +- {1000 * BAND_95 * sd_m:.2f} mm (95 %), {change_mm:+.2f} mm from the design"


def chosen_count(tried: Sequence[SegmentCount]) -> str:
    """Return which number of segments the scan asks for, and how strongly it speaks against the others."""
    # A file that a person edited may hold no 0.
    chosen = min(tried, key=lambda count: count.against).segments
    others = ", ".join(f"{count.segments}: {count.against:,.0f}" for count in tried if count.segments != chosen)
    return f"{chosen} by the evidence" + (f" (against {others})" if others else "; no other number made sense")


def _line(label: str, text: str) -> str:
    return f"{label:<11}{text}"
