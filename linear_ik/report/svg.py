"""SVG: the pictures of a report, as text."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape

from linear_ik.deviation_figures import Curve
from linear_ik.result import SegmentResult

Array = npt.NDArray[np.float64]

WIDTH, HEIGHT = 640, 230
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 12, 34
SERIES = (("x", "local X"), ("y", "local Y"))
MOST_PLACES = 121  # of a curve: one every five pixels
SECTION_PX = 260


def curve_plot(
    curve: Curve,
    length_m: float,
    what: str,
    segments: Sequence[SegmentResult],
    limit_m: float | None = None,
    beside: Curve | None = None,
) -> Markup:
    """Return a curve in mm over the length, both axes with their 95 % bands.

    Args:
        curve: metres.
        length_m: of the member.
        what: the vertical axis, in words.
        segments: those that are not measured are shaded.
        limit_m: dashed lines there and at its negative.
        beside: another curve, drawn dashed without bands.
    """
    keep = np.unique(np.linspace(0, len(curve.s_m) - 1, min(MOST_PLACES, len(curve.s_m))).astype(int))
    s, xy, band = curve.s_m[keep], 1e3 * curve.xy[keep], 1e3 * curve.band[keep]
    known = np.isfinite(band)
    top = float(np.max(np.abs(xy) + np.where(known, band, 0.0), initial=1e-3))
    dashed = None if beside is None else 1e3 * beside.xy
    if dashed is not None:
        top = max(top, float(np.abs(dashed).max()))
    # A limit far beyond the curve would flatten it; its value is in the table of verdicts.
    if limit_m is not None and 1e3 * limit_m <= 3.0 * top:
        top = max(top, 1.15e3 * limit_m)  # clear of the key
    step, top = _ticks(1.08 * top)

    def px(s_m: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * s_m / length_m

    def py(mm: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (0.5 - 0.5 * mm / top)

    largest = float(np.linalg.norm(xy, axis=1).max())
    out = [
        f'<svg class="plot" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(what)} along the length; largest {largest:.1f} mm">'
    ]
    out += _unmeasured(segments)
    steps = math.floor(top / step)
    for tick in step * np.arange(-steps, steps + 1):
        out.append(f'<path class="grid" d="M{LEFT} {py(tick):.1f}H{WIDTH - RIGHT}"/>')
        out.append(f'<text x="{LEFT - 6}" y="{py(tick) + 4:.1f}" text-anchor="end">{_number(tick, step)}</text>')
    along, _ = _ticks(length_m, 6)
    for tick in np.arange(0.0, length_m + along / 100, along):
        out.append(
            f'<text x="{px(tick):.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">{_number(tick, along)}</text>'
        )
    out.append(f'<path class="axis" d="M{LEFT} {py(0):.1f}H{WIDTH - RIGHT}"/>')
    if limit_m is not None and 1e3 * limit_m <= top:
        for sign in (-1e3, 1e3):
            out.append(f'<path class="limit" d="M{LEFT} {py(sign * limit_m):.1f}H{WIDTH - RIGHT}"/>')
    for i, (name, _) in enumerate(SERIES):
        for rows in _runs(known[:, i]):
            upper = [(px(a), py(b)) for a, b in zip(s[rows], (xy + band)[rows, i], strict=True)]
            lower = [(px(a), py(b)) for a, b in zip(s[rows], (xy - band)[rows, i], strict=True)]
            out.append(f'<path class="band {name}" d="{_path([*upper, *lower[::-1]])}Z"/>')
    for i, (name, label) in enumerate(SERIES):
        line = [(px(a), py(b)) for a, b in zip(s, xy[:, i], strict=True)]
        out.append(f'<path class="line {name}" d="{_path(line)}"/>')
        if beside is not None and dashed is not None:
            elastic = [(px(a), py(b)) for a, b in zip(beside.s_m, dashed[:, i], strict=True)]
            out.append(f'<path class="line elastic {name}" d="{_path(elastic)}"/>')
        out.append(f'<text class="key {name}" x="{LEFT + 8 + 70 * i}" y="{TOP + 12}">{label}</text>')
    if not known.all():
        out.append(
            f'<text class="key" x="{WIDTH - RIGHT - 8}" y="{TOP + 12}" text-anchor="end">'
            f"band not known at {(~known.all(axis=1)).sum()} of {len(known)} places</text>"
        )
    middle = (TOP + HEIGHT - BOTTOM) / 2
    out.append(
        f'<text transform="translate(12 {middle}) rotate(-90)" text-anchor="middle">{escape(what)}, mm</text>'
        f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 4}" text-anchor="middle">'
        "distance from the start, m</text></svg>"
    )
    return Markup("".join(out))


def section_plot(fitted: Array, designed: Array, points: Array, distances_m: Array, largest_m: float) -> Markup:
    """Return a section: the fitted outline, the designed one where it was meant to be, and the points.

    Args:
        fitted: [V][2] outline, metres, local X to the right and Y up.
        designed: [W][2] the same of the design, in the fitted section's axes.
        points: [P][2].
        distances_m: [P] to the fitted surface.
        largest_m: of the colours.
    """
    all_of_it = np.concatenate([fitted, designed, points])
    middle = (all_of_it.max(axis=0) + all_of_it.min(axis=0)) / 2
    half = float(np.ptp(all_of_it, axis=0).max()) / 2 * 1.06 + 1e-6
    scale = SECTION_PX / 2 / half

    def at(xy: Array) -> Array:
        return np.asarray(SECTION_PX / 2 + (xy - middle) * scale * [1.0, -1.0])

    share = np.clip((5.0 * distances_m / largest_m).astype(int), 0, 4)
    out = [
        f'<svg class="section" viewBox="0 0 {SECTION_PX} {SECTION_PX}" role="img" aria-label="section: {len(points)} '
        'points, the fitted outline and the designed one">'
    ]
    for level in range(5):
        dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at(points[share == level]))
        if dots:
            out.append(f'<path class="dots d{level}" d="{dots}"/>')
    out.append(f'<path class="designed" d="{_path(at(designed))}Z"/><path class="fitted" d="{_path(at(fitted))}Z"/>')
    bar_m, _ = _ticks(half, 2)
    out.append(
        f'<path class="axis" d="M8 {SECTION_PX - 8}h{bar_m * scale:.1f}"/>'
        f'<text x="8" y="{SECTION_PX - 13}">{1e3 * bar_m:g} mm</text></svg>'
    )
    return Markup("".join(out))


def strip(segments: Sequence[SegmentResult]) -> Markup:
    """Return a bar of the segments from start to end, coloured by what the scan says of them."""
    step = WIDTH / len(segments)
    parts = [
        f'<rect class="{s.status}" x="{k * step:.2f}" y="0" width="{step:.2f}" height="18">'
        f"<title>segment {k + 1}: {s.status.replace('_', ' ')}, {s.points} points, "
        f"{100 * s.coverage:.0f} % of its surface</title></rect>"
        for k, s in enumerate(segments)
    ]
    counts = {status: sum(s.status == status for s in segments) for status in ("measured", "inferred", "not_scanned")}
    label = ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in counts.items() if n)
    return Markup(
        f'<svg class="strip" viewBox="0 0 {WIDTH} 18" preserveAspectRatio="none" role="img" '
        f'aria-label="segments: {label}">{"".join(parts)}</svg>'
    )


def _unmeasured(segments: Sequence[SegmentResult]) -> list[str]:
    step = (WIDTH - LEFT - RIGHT) / len(segments)
    return [
        f'<rect class="{s.status}" x="{LEFT + k * step:.1f}" y="{TOP}" width="{step:.1f}" '
        f'height="{HEIGHT - TOP - BOTTOM}"/>'
        for k, s in enumerate(segments)
        if s.status != "measured"
    ]


def _runs(known: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.intp]]:
    """Return the numbers of the nodes known, those that follow each other together."""
    rows = np.flatnonzero(known)
    return [run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run)]


def _ticks(top: float, count: int = 3) -> tuple[float, float]:
    """Return a round step of about ``count`` to ``top``, and ``top`` itself."""
    raw = top / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(f * power for f in (1.0, 2.0, 5.0, 10.0) if f * power >= raw * 0.999)
    return step, top


def _number(value: float, step: float) -> str:
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{value + 0.0:.{digits}f}".replace("-0.0", "0.0") if abs(value) < step / 2 else f"{value:.{digits}f}"


def _path(points: Sequence[tuple[float, float]] | Array) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
