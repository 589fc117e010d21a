"""`linear-ik align`: where a scan lies in a design."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from linear_ik.cli.arguments import design_first, file_argument, file_option, unit_option
from linear_ik.cli.outputs import check_output, is_stdout
from linear_ik.cli.process import NOT_SCANNED, Outcome, Verb, about_options
from linear_ik.cli.progress import Progress

if TYPE_CHECKING:
    from linear_ik.align import Alignment

AMBIGUOUS = 4
EXAMPLE = """Example: find the transform, then fit with it; then settle a symmetric design with a guess

\b
  linear-ik align design.ifc site.e57 -o T.txt && linear-ik fit design.ifc site.e57 --transform T.txt -o asbuilt/
  linear-ik align design.ifc site.e57 --near guess.txt -o T.txt

Exit codes: 0 aligned, 3 no alignment found (nothing written), 4 ambiguous: the best one is written.
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Find the rigid motion that lays a scan on a design."
    app.command("align", cls=Verb, help=about, epilog=EXAMPLE)(align)


def align(
    design: Annotated[Path, file_argument("DESIGN.ifc", "The design model.")],
    scan: Annotated[list[Path], file_argument("SCAN", "One or more files of one registration.")],
    output: Annotated[
        Path,
        file_option("-o", "--output", metavar="T.txt", about="4 x 4 numbers, scan to model; - prints them on stdout."),
    ],
    near: Annotated[
        Path | None,
        file_option("--near", metavar="T.txt", about="A guess within about 0.3 m, in place of the search."),
    ] = None,
    levelled: Annotated[
        bool, typer.Option("--levelled/--any-tilt", help="The scanner was levelled; else any rotation is searched.")
    ] = True,
    scan_unit: Annotated[str | None, unit_option()] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No summary and no progress.")] = False,
) -> Outcome:
    """Read, align, write, and say what was found."""
    to_stdout = is_stdout(output)
    design_first(design)
    inputs = [design, *scan, *([near] if near else [])]
    target = output if to_stdout else check_output(output, inputs)
    guess = None
    if near is not None:
        from linear_ik.cli.fit_model import read_transform

        guess = read_transform(near)
    progress = Progress(quiet)
    with progress.stage(f"reading {design}", judges_input=True):
        from linear_ik.bim import read_design

        model = read_design(design)
    with progress.stage("aligning", judges_input=True):
        from linear_ik.align import align as align_scan
        from linear_ik.errors import SettingsError

        try:
            found = align_scan(
                model,
                *scan,
                near=guess,
                levelled=levelled,
                on_step=progress.steps(),
                unit=scan_unit,
            )
        except SettingsError as error:
            raise about_options(error) from None
    if not quiet:
        for line in _lines(found):
            print(line, file=sys.stderr)
    if found.status == "not_found":
        return Outcome(NOT_SCANNED)
    from linear_ik.exports.transform_file import transform_text, write_transform

    if not to_stdout:
        write_transform(found.T_model_scan, target)
        if not quiet:
            print(f"{'written':<11}{output}", file=sys.stderr)
    code = AMBIGUOUS if found.status == "ambiguous" else 0
    return Outcome(code, transform_text(found.T_model_scan) if to_stdout else "")


def _lines(found: Alignment) -> list[str]:
    rows = [("status", found.status.replace("_", " "))]
    rows += [("", reason) for reason in found.reasons]
    rows.append(("residuals", f"{1000 * found.rms_m:.2f} mm rms of the scan points within 20 mm of the design"))
    rows.append(
        ("shares", f"{100 * found.scan_share:.0f} % of the scan, {100 * found.model_share:.0f} % of the design's faces")
    )
    best = f", the next best {found.alternatives[0].score:.3f}" if found.alternatives else ""
    rows.append(
        (
            "score",
            f"{found.score:.3f}{best}; one point in {1000 * found.voxel_m:.0f} mm, tilt {found.tilt_deg:.3f} degrees",
        )
    )
    return [f"{label:<11}{text}" for label, text in rows]
