"""Page: the report as one HTML file."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from linear_ik.atomic import write_atomically
from linear_ik.deviation import Deviations
from linear_ik.deviation_figures import Curve
from linear_ik.errors import SettingsError
from linear_ik.report.body import body_data
from linear_ik.report.cloud import NearPoints, T_world_segments, gather
from linear_ik.report.members import ReportedMember, Run
from linear_ik.report.svg import curve_plot, section_plot, strip
from linear_ik.report.words import (
    elastic_rows,
    figure_rows,
    list_row,
    seen,
    settings_rows,
    verdict_row,
    what_judged,
    with_band,
)
from linear_ik.scan import Scan
from linear_ik.viewer_cloud import largest_shown_m

Array = npt.NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent.parent / "data" / "report"
# Bytes of all scan points of a page, by what one takes there, and how many a member gets at most and least.
POINT_BYTES, POINTS_BUDGET_BYTES, MOST_POINTS, LEAST_POINTS = 12, 3_000_000, 6000, 200
SECTION_POINTS = 350  # dots of 2.4 pixels on 260: more would be a line
SECTION_SHARES = (0.25, 0.5, 0.75)  # of the length, less those near where the bow is
APART = 0.1  # of the length: two sections that are nearer show the same
THICKNESS_M = 0.05  # of the slice whose points a section shows, each way
NO_LEVEL = {True: "coarser than any level", False: "no level: the fit is in doubt"}


@dataclass(frozen=True, eq=False)
class Nearby:
    """What a report shows of a scan.

    Attributes:
        of_members: points near each member of the run, in its order; None of one that was not found.
    """

    of_members: tuple[NearPoints | None, ...]


def write_report(
    run: Run,
    path: str | os.PathLike[str],
    scan: Scan | Nearby | None = None,
    sections_m: Sequence[float] = (),
    on_member: Callable[[int, int], object] | None = None,
) -> Path:
    """Write a report as one HTML file, whole or not at all.

    Args:
        run: what it is about.
        path: of the file.
        scan: its points are shown with the members they lie near; `nearby` keeps those of a large one only.
        sections_m: where sections are shown, from the start; the quarters and the bow where left out.
        on_member: called with how many pages are made, of how many.

    Raises:
        SettingsError: a section that lies on none of the members.
        OutputError: the file cannot be written.
    """
    return write_atomically(path, render(run, scan, sections_m, on_member))


def render(
    run: Run,
    scan: Scan | Nearby | None = None,
    sections_m: Sequence[float] = (),
    on_member: Callable[[int, int], object] | None = None,
    made: datetime | None = None,
) -> str:
    """Return a report as HTML.

    Args:
        run: what it is about.
        scan: its points are shown with the members they lie near; `nearby` keeps those of a large one only.
        sections_m: where sections are shown, from the start; the quarters and the bow where left out.
        on_member: called with how many pages are made, of how many.
        made: when; now where left out.

    Raises:
        SettingsError: a section that lies on none of the members.
    """
    check_sections(run, sections_m)
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    near = nearby(run, [scan]) if isinstance(scan, Scan) else scan
    most = max(LEAST_POINTS, min(MOST_POINTS, POINTS_BUDGET_BYTES // POINT_BYTES // max(len(run.members), 1)))
    pages = []
    for i, member in enumerate(run.members):
        pages.append(_page(member, i, None if near is None else near.of_members[i], most, sections_m))
        if on_member is not None:
            on_member(i + 1, len(run.members))
    return environment.get_template("report.html.j2").render(
        run=run,
        pages=pages,
        counts=_counts(run),
        judged=any(m.verdicts for m in run.members),
        standards=_standards(run),
        # Columns of figures are empty for what was not fitted.
        unfitted_columns=list(dict.fromkeys(k for row in run.unfitted for k, v in row.items() if v)),
        version=version("linear_ik"),
        made=(made or datetime.now().astimezone()).strftime("%Y-%m-%d %H:%M %Z"),
        style=Markup((FOLDER / "report.css").read_text(encoding="utf-8")),
        script=Markup((FOLDER / "report.js").read_text(encoding="utf-8")),
    )


def nearby(run: Run, scans: Iterable[Scan]) -> Nearby:
    """Return the points of a scan near the members of a run, read piece by piece.

    Args:
        run: what the report is about.
        scans: pieces of a scan, such as `readers.iter_scan` yields.
    """
    members = [None if (frames := _frames(m)) is None else (m.result, frames) for m in run.members]
    return Nearby(tuple(gather((_moved(scan.points, run.T_results_scan) for scan in scans), members)))


def _frames(member: ReportedMember) -> Array | None:
    return None if member.result.status == "not_scanned" else T_world_segments(member.result)


def check_sections(run: Run, sections_m: Sequence[float]) -> None:
    """Raise SettingsError where a section lies on none of the members; not on some of them is well."""
    longest_m = max((m.result.element.length_m for m in run.members), default=0.0)
    for s_m in sections_m:
        if not 0.0 <= s_m <= longest_m:
            raise SettingsError("sections_m", f"{s_m:g}", f"0 to {longest_m:.3f} m, the length of the longest element")


def _moved(points: Array, T: Array | None) -> Array:
    return points if T is None else np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _counts(run: Run) -> list[tuple[str, int]]:
    """Return how many members there are of each outcome, or of each status where nothing was judged."""
    counts = Counter(m.outcome or m.result.status for m in run.members)
    order = (
        "fail",
        "inconclusive",
        "pass",
        "not_applicable",
        "not_scanned",
        "uncertain",
        "max_iterations",
        "converged",
    )
    return [(kind, counts[kind]) for kind in order if counts[kind]]


def _standards(run: Run) -> list[tuple[str, str]]:
    """Return each standard that was used, with what it judges of some member; empty: of none."""
    every = [v for member in run.members for v in member.verdicts]
    titles = dict.fromkeys(v.standard for v in every)
    return [(title, what_judged(v for v in every if v.standard == title)) for title in titles]


def _page(
    member: ReportedMember, number: int, near: NearPoints | None, most_points: int, sections_m: Sequence[float]
) -> dict[str, Any]:
    """Return what the template says of a member."""
    result, found = member.result, member.deviations
    frames = _frames(member)
    largest_m = largest_shown_m(result.range_noise_m)
    accuracy = member.accuracy
    return {
        **list_row(member),
        "number": number,
        "member": member,
        "verdicts": [verdict_row(v) for v in member.verdicts],
        "figures": [] if found is None else [*figure_rows(found), *elastic_rows(member)],
        "joint": found is not None and found.joint,
        "seen": seen(result),
        "strip": strip(result.segments),
        "plots": [] if found is None else _plots(member, found),
        "sections": []
        if found is None or frames is None
        else _sections(member, found, frames, near, largest_m, sections_m),
        "near": None if near is None else len(near.points),
        "largest_mm": f"{1e3 * largest_m:g}",
        "body": body_data(result, frames, near, most_points, largest_m),
        "accuracy": None
        if accuracy is None
        else {
            "level": accuracy.level or NO_LEVEL[result.status == "converged"],
            "measured": f"{1e3 * accuracy.measured_m:.1f} mm",
            "represented": f"{1e3 * accuracy.represented_m:.1f} mm",
            "standard": accuracy.standard,
        },
        "settings": settings_rows(member),
    }


def _plots(member: ReportedMember, found: Deviations) -> list[dict[str, Any]]:
    segments = member.result.segments
    # A limit that does not hold for this member, or that nobody verified, is none to draw.
    limits = [v.upper for v in member.verdicts if v.figure == "bow" and v.verified_by and v.outcome != "not_applicable"]
    limit = min((upper for upper in limits if upper is not None), default=None)
    free, elastic = member.imperfection, None
    if member.elastic is not None:
        elastic = Curve(found.offset_m.s_m, member.elastic.offset_m[:, :2], np.zeros_like(found.offset_m.xy))
    # The limit stands where it holds: with what is compared with it.
    drawn = [
        (
            "w(s): offset from the chord",
            found.offset_between_m,
            "offset from the chord",
            None if free else limit,
            elastic,
        )
    ]
    if free is not None:
        drawn.append(("imperfection: w(s) without the elastic sag", free.offset_between_m, "imperfection", limit, None))
    drawn.append(("offset from the design", found.departure_between_m, "offset from the design", None, None))
    return [
        {
            "title": title,
            "dashed": "" if beside is None else "; dashed: the elastic sag of own weight, computed",
            "bands_known": bool(np.isfinite(curve.band).all()),
            "svg": curve_plot(curve, found.length_m, what, segments, limit_m, beside),
        }
        for title, curve, what, limit_m, beside in drawn
    ]


def _sections(
    member: ReportedMember,
    found: Deviations,
    frames: Array,
    near: NearPoints | None,
    largest_m: float,
    sections_m: Sequence[float],
) -> list[dict[str, Any]]:
    """Return sections at the places asked for, or at the quarters and where the bow is."""
    result, element = member.result, member.result.fitted_element
    step_m, out = element.segment_length_m, []
    T, R_design = element.placement.T_world_element, element.design.rotations
    designed_nodes = found.specified_m @ T[:3, :3].T + T[:3, 3]
    bow = 0.5 if found.bow_m.s_m is None else found.bow_m.s_m / found.offset_m.s_m[-1]
    shares = [s_m / element.length_m for s_m in sections_m if 0.0 <= s_m <= element.length_m]
    if not sections_m:
        shares = [bow, *(s for s in SECTION_SHARES if abs(s - bow) > APART)]
    for share in sorted(shares):
        k = min(int(share * element.segments), element.segments - 1)
        z_m = min(max(share * element.length_m - k * step_m, 0.0), step_m)
        frame, profile = frames[k], element.profile_at(share)
        centre = frame[:3, 3] + frame[:3, 2] * z_m
        meant = designed_nodes[k] + (designed_nodes[k + 1] - designed_nodes[k]) * z_m / step_m
        axes = T[:3, :3] @ R_design[k]
        outline = profile.outline()
        designed = (outline @ axes[:, :2].T + meant - centre) @ frame[:3, :2]
        xy, distance = np.empty((0, 2)), np.empty(0)
        if near is not None:
            rows = np.flatnonzero(np.abs(near.s_m - share * element.length_m) <= min(THICKNESS_M, step_m / 2))
            if len(rows) > SECTION_POINTS:
                rows = np.random.default_rng(0).choice(rows, SECTION_POINTS, replace=False)
            xy, distance = near.xy[rows], near.distance_m[rows]
        moved = np.array(
            [np.interp(share * element.length_m, found.departure_m.s_m, c) for c in found.departure_m.xy.T]
        )
        band = np.array(
            [np.interp(share * element.length_m, found.departure_m.s_m, c) for c in found.departure_m.band.T]
        )
        out.append(
            {
                "title": f"section at {share * element.length_m:.2f} m",
                "status": result.segments[k].status,
                "points": None if near is None else len(xy),
                "moved": [with_band(moved[i], band[i], "mm", 1e3) for i in (0, 1)],
                "svg": section_plot(outline, designed, xy, distance, largest_m),
            }
        )
    return out
