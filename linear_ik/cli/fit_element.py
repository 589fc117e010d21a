"""`linear-ik fit` of one element: a result, and what else was asked for of it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from linear_ik.cli.judging import describe_verdicts, judge, verdicts_of
from linear_ik.cli.outputs import check_output, is_stdout
from linear_ik.cli.process import NOT_SCANNED, Outcome, about_options
from linear_ik.cli.progress import Progress
from linear_ik.errors import ElementError, SettingsError

if TYPE_CHECKING:
    from linear_ik.element import Element
    from linear_ik.result import FitResult, IterationRecord
    from linear_ik.scan import Scan
    from linear_ik.settings import FitSettings
    from linear_ik.tolerances import Conditions, Profile, Verdict
    from linear_ik.viewer import Viewer


@dataclass(frozen=True)
class Wanted:
    """What is written and shown.

    Attributes:
        output: of the result; stdout where it says so.
        urdf: of the bent member, or None.
        glb: of the bent body, or None.
        smooth: the body is one along the curve behind the segments.
        record: of the page that plays the iterations back, or None.
        view: the fit is watched in a browser.
        pairs: the browser shows from the start which place of the member each point belongs to.
        wait: the browser's page stays until the person ends it.
        quiet: no summary and no progress.
    """

    output: Path
    urdf: Path | None
    glb: Path | None
    smooth: bool
    record: Path | None
    view: bool
    pairs: bool
    wait: bool
    quiet: bool


def fit_one(
    element: Path,
    scans: list[Path],
    wanted: Wanted,
    settings: FitSettings,
    segments: int | Literal["auto"] | None,
    scan_unit: str | None,
    judges: tuple[Profile | None, Conditions],
) -> Outcome:
    """Check everything, read, fit, write, and say what was found.

    Args:
        element: the element file.
        scans: files of one scan.
        wanted: what is written and shown.
        settings: of the fit.
        segments: in place of the file's.
        scan_unit: of the scan files' numbers; None: not said.
        judges: tolerances, and under which conditions.

    Raises:
        LinearIkError: bad input.
    """
    targets = _targets(wanted, [element, *scans])
    from linear_ik.element_file import load_element

    design = load_element(element)
    if segments is not None:
        design = _with_segments(design, segments)
    progress = Progress(wanted.quiet)
    with progress.stage("reading " + ", ".join(str(path) for path in scans), judges_input=True):
        from linear_ik.readers import read_scan

        points = read_scan(*scans, unit=scan_unit)
    viewer = _open_viewer(design, points, wanted.wait, wanted.pairs) if wanted.view else None

    with progress.stage(f"fitting {design.name}"):
        from linear_ik.fit import fit

        try:
            result = fit(design, points, settings, _listener(progress, viewer, wanted.quiet))
        except SettingsError as error:
            raise about_options(error) from None
    with progress.stage("writing"):
        _write_bodies(result, targets.urdf, targets.glb, wanted.smooth)
        from linear_ik.exports.result_json import result_to_json, write_result

        judged = judge(result, *judges)
        extra = verdicts_of(judged)
        text = ""
        if is_stdout(wanted.output):
            text = result_to_json(result, extra)
        else:
            write_result(result, targets.output, extra)
    if targets.record is not None:
        with progress.stage(f"recording {wanted.record}"):
            from linear_ik.viewer import Viewer

            recorded = Viewer(design.name)
            recorded.show_result(result, points)
            recorded.static_html(targets.record)
    if not wanted.quiet:
        bodies = [] if result.status == "not_scanned" else [wanted.urdf, wanted.glb]
        written = [path for path in (wanted.output, *bodies, wanted.record) if path is not None and not is_stdout(path)]
        _summarise(result, judged, points.left_out, written, wanted.smooth)
    if viewer is not None:
        from linear_ik.cli.view import stay

        viewer.show_result(result, points)
        stay(viewer, wanted.wait)
    return Outcome(NOT_SCANNED if result.status == "not_scanned" else 0, text)


def _targets(wanted: Wanted, inputs: list[Path]) -> Wanted:
    """Return the same with the files that will be written, links followed.

    Raises:
        LinearIkError: one that cannot be written, or two that are one.
    """
    output, urdf, glb = wanted.output, wanted.urdf, wanted.glb
    if wanted.smooth and glb is None:
        raise SettingsError("--smooth", "given without --glb", "--glb OUT.glb")
    if wanted.pairs and not wanted.view:
        raise SettingsError("--pairs", "given without --view", "--view")
    others = [path for path in (output, urdf, glb) if path is not None]
    targets = replace(
        wanted,
        output=output if is_stdout(output) else check_output(output, inputs),
        urdf=check_output(urdf, inputs, [output]) if urdf else None,
        glb=check_output(glb, inputs, [output, *([urdf] if urdf else [])]) if glb else None,
        record=check_output(wanted.record, inputs, others) if wanted.record else None,
    )
    if urdf is not None:
        from linear_ik.exports.fitted_urdf import joints_path

        check_output(joints_path(urdf), inputs, [*others, *([wanted.record] if wanted.record else [])])
    return targets


def _with_segments(design: Element, segments: int | Literal["auto"]) -> Element:
    from linear_ik.element import SEGMENTS

    try:
        if segments == "auto":
            return replace(design, segments=SEGMENTS, auto_segments=True)
        return replace(design, segments=segments, auto_segments=False)
    except ElementError as error:
        raise error.about("--segments") if error.subject == "segments" else error from None


def _open_viewer(design: Element, points: Scan, wait: bool, pairs: bool) -> Viewer:
    from linear_ik.cli.view import open_browser
    from linear_ik.viewer import Viewer

    viewer = Viewer(design.name)
    viewer.show_design(design)
    viewer.show_scan(points)
    viewer.follow_pairs(pairs)
    watched = open_browser(viewer, None, wait)
    # Beside the fit in any case; nobody is kept waiting where no browser came by itself.
    viewer.slow_down() if watched else viewer.slow_down(0.0, 0.0)
    return viewer


def _listener(progress: Progress, viewer: Viewer | None, quiet: bool) -> Callable[[IterationRecord], None] | None:
    """Return what is called after each iteration, or None where nobody looks."""
    if viewer is None and (quiet or not sys.stderr.isatty()):
        return None

    def on_iteration(record: IterationRecord) -> None:
        rms = 1000 * record.surface_rmse_m
        progress.update(f"fitting: iteration {record.iteration}, {record.phase}, {rms:.2f} mm rms")
        if viewer is not None:
            viewer.on_iteration(record)

    return on_iteration


def _write_bodies(result: FitResult, urdf: Path | None, glb: Path | None, smooth: bool) -> None:
    # An element that was not found has no shape to export.
    if result.status == "not_scanned":
        return
    if urdf is not None:
        from linear_ik.exports.fitted_urdf import write_fitted_urdf

        write_fitted_urdf(result.fitted_element, result.q, result.base_pose, urdf)
    if glb is not None and smooth:
        from linear_ik.exports.glb import write_smooth_glb

        write_smooth_glb(result, glb)
    elif glb is not None:
        from linear_ik.exports.glb import write_glb

        write_glb(result.fitted_element, result.q, result.base_pose, glb)


def _summarise(result: FitResult, judged: tuple[Verdict, ...], left_out: int, files: list[Path], smooth: bool) -> None:
    from linear_ik.cli.summary import corners, describe
    from linear_ik.scan import no_points

    lost = [f"{'left out':<11}{no_points(left_out)}"] if left_out else []
    kept = corners(result) if smooth else []
    last = [f"{'written':<11}{', '.join(str(path) for path in files)}"] if files else []
    for line in [*describe(result), *lost, *describe_verdicts(judged), *kept, *last]:
        print(line, file=sys.stderr)
