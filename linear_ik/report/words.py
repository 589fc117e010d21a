"""Words: the figures of a report as an engineer reads them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from linear_ik.assessment import grouped
from linear_ik.deviation import Deviations
from linear_ik.deviation_figures import Figure
from linear_ik.report.members import ReportedMember
from linear_ik.result import FitResult
from linear_ik.tally import COVERAGE_RADIUS
from linear_ik.tolerances import Verdict
from linear_ik.tolerances.clause import ANGLES

# What a clause on a figure judges, as short as a list wants it.
JUDGED = {
    "bow": "straightness",
    "out_of_plumb": "plumb",
    "end_displacement": "displacement of the end",
    "departure": "offset from the design",
    "length_change": "length",
}
NOT_KNOWN = "not known"
NO_LEVEL = {True: "coarser", False: "none"}
# field, label, unit, factor
FIGURES = (
    ("bow_m", "bow: largest offset from the chord", "mm", 1e3),
    ("sag_m", "sag: its vertical part, downwards", "mm", 1e3),
    ("sweep_m", "sweep: its horizontal part", "mm", 1e3),
    ("camber_m", "rise at half the length", "mm", 1e3),
    ("out_of_plumb_m", "out of plumb", "mm", 1e3),
    ("twist_rad", "twist of the end against the start", "deg", math.degrees(1.0)),
    ("end_displacement_m", "displacement of the end", "mm", 1e3),
    ("departure_max_m", "largest offset from the design", "mm", 1e3),
    ("slope_max_rad", "largest slope against the chord", "mm/m", 1e3),
    ("curvature_max_1_m", "largest curvature", "1/km", 1e3),
    ("length_change_m", "change of the chord's length", "mm", 1e3),
)


def with_band(value: float | None, band: float | None, unit: str, factor: float) -> str:
    """Return ``12.3 ± 0.4 mm``, as exact as the band lets it be."""
    if value is None or not math.isfinite(value):
        return NOT_KNOWN
    if band is None or not math.isfinite(band):
        return f"{factor * value:.1f} {unit}, band not known"
    digits = 1 if factor * band >= 0.95 else 2 if factor * band >= 0.0095 else 3
    return f"{factor * value + 0.0:.{digits}f} ± {factor * band:.{digits}f} {unit}"


def figure_rows(found: Deviations) -> list[dict[str, str]]:
    """Return label, text, place and note of each figure."""
    rows = []
    for name, label, unit, factor in FIGURES:
        figure: Figure = getattr(found, name)
        note = figure.note
        if name == "bow_m" and found.straight_bow_m is not None:
            note += f"; a straight member scanned alike would show up to {1e3 * found.straight_bow_m:.2f} mm (95 %)"
        rows.append(
            {
                "label": label,
                "text": "none" if figure.value is None else with_band(figure.value, figure.band, unit, factor),
                "place": _place(name, figure, found),
                "note": note,
            }
        )
    return rows


def elastic_rows(member: ReportedMember) -> list[dict[str, str]]:
    """Return the elastic sag of own weight, and what is left without it; none where it was not computed."""
    elastic, free = member.elastic, member.imperfection
    if elastic is None or free is None:
        return []
    band = elastic.share95 * elastic.largest_m
    note = f"{elastic.said}, {elastic.material.source or 'as stated'}; its band {100 * elastic.share95:g} % of it"
    label = "elastic sag of own weight, computed: largest offset from the chord"
    rows = [{"label": label, "text": with_band(elastic.largest_m, band, "mm", 1e3), "place": "", "note": note}]
    for name, label in (
        ("bow_m", "bow"),
        ("sag_m", "sag"),
        ("sweep_m", "sweep"),
        ("camber_m", "rise at half the length"),
    ):
        figure: Figure = getattr(free, name)
        if figure.value is not None:
            text = with_band(figure.value, figure.band, "mm", 1e3)
            place = _place(name, figure, free)
            rows.append({"label": f"imperfection: {label} without it", "text": text, "place": place, "note": ""})
    return rows


def _place(name: str, figure: Figure, found: Deviations) -> str:
    if figure.node is None or figure.value is None:
        return ""
    if name == "slope_max_rad":
        return f"segment {figure.node}"
    return f"at {found.offset_m.s_m[figure.node] if figure.s_m is None else figure.s_m:.2f} m"


def verdict_row(verdict: Verdict) -> dict[str, str]:
    """Return the texts of a verdict."""
    unit, factor = ("deg", math.degrees(1.0)) if verdict.figure in ANGLES else ("mm", 1e3)
    precamber = "not stated" if verdict.precamber_m is None else f"{1e3 * verdict.precamber_m:g} mm"
    return {
        "outcome": verdict.outcome,
        "standard": f"{verdict.standard}, edition: {verdict.edition}",
        "clause": verdict.clause,
        "title": verdict.title,
        "value": with_band(verdict.value, verdict.band, unit, factor),
        "scanned": ""
        if verdict.elastic_sag_m is None
        else with_band(verdict.as_scanned, verdict.as_scanned_band, unit, factor),
        "elastic": ""
        if verdict.elastic_sag_m is None
        else f"{1e3 * verdict.elastic_sag_m:.2f} mm; {verdict.elastic_of}",
        "limit": _allowed(verdict, unit, factor),
        "reason": verdict.reason,
        "loading": verdict.loading_state.replace("_", " "),
        "precamber": precamber,
        "verified_by": verdict.verified_by or "nobody",
        "note": verdict.note,
    }


def what_judged(verdicts: Iterable[Verdict], outcome: str | None = None) -> str:
    """Return what the verdicts of one outcome are about, such as "plumb, straightness"; None: all that apply.

    A pass is that of what was judged, and of nothing else.
    """
    about = (v for v in verdicts if v.outcome != "not_applicable" and outcome in (None, v.outcome))
    return ", ".join(dict.fromkeys(JUDGED.get(v.figure, v.figure) for v in about))


def _allowed(verdict: Verdict, unit: str, factor: float) -> str:
    if verdict.upper is None or verdict.lower is None:
        return "none"
    if verdict.lower == -verdict.upper:
        return f"{factor * verdict.upper:.2f} {unit}"
    return f"{factor * verdict.lower:.2f} to {factor * verdict.upper:.2f} {unit}"


def seen(result: FitResult) -> list[str]:
    """Return sentences on what was scanned and what was not."""
    step_m, out = result.fitted_element.segment_length_m, []
    for status, words in (("not_scanned", "not scanned"), ("inferred", "inferred from what lies on both sides")):
        runs = grouped(k for k, segment in enumerate(result.segments) if segment.status == status)
        out += [f"{run[0] * step_m:.2f} to {(run[-1] + 1) * step_m:.2f} m: {words}" for run in runs]
    coverage = sum(s.coverage for s in result.segments) / len(result.segments)
    points = sum(s.points for s in result.segments)
    near_mm = 1e3 * COVERAGE_RADIUS * result.element.length_m
    out.append(f"{points:,} points; {100 * coverage:.0f} % of the surface lies within {near_mm:.0f} mm of one of them")
    return out


def list_row(member: ReportedMember) -> dict[str, Any]:
    """Return the texts of a member in the list, and numbers to sort by."""
    found, result = member.deviations, member.result
    row: dict[str, Any] = {
        "key": member.key,
        "tag": member.tag,
        "name": member.name,
        "ifc_class": member.ifc_class,
        "profile": member.profile,
        "length": f"{result.element.length_m:.2f}",
        "status": result.status,
        "outcome": member.outcome,
        "judged": what_judged(member.verdicts, member.outcome),
        "level": "" if member.accuracy is None else member.accuracy.level or NO_LEVEL[result.status == "converged"],
        "scanned": round(100 * sum(s.status == "measured" for s in result.segments) / len(result.segments)),
    }
    for name in ("bow_m", "out_of_plumb_m", "departure_max_m"):
        figure = None if found is None else getattr(found, name)
        known = figure is not None and figure.value is not None
        row[name] = with_band(figure.value, figure.band, "", 1e3).strip() if figure and known else ""
        row[name + "_sort"] = f"{figure.value:.6f}" if figure and known else ""
    return row


def settings_rows(member: ReportedMember) -> list[tuple[str, str]]:
    """Return the settings of a fit, the versions it was made with, and what it took."""
    rows = []
    for name, value in asdict(member.result.settings).items():
        if isinstance(value, dict):
            rows += [(f"{name}.{key}", _said(inner)) for key, inner in value.items() if inner is not None]
        elif value is not None:
            rows.append((name, _said(value)))
    rows += [("version of " + name, text) for name, text in member.versions.items()]
    total = member.result.timings_s.get("total", math.nan)
    rows.append(("iterations", f"{member.result.iterations}" + (f" in {total:.2f} s" if math.isfinite(total) else "")))
    return rows


def _said(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
