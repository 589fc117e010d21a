"""`linear-ik report`: one HTML file to read, to file and to sign."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from linear_ik.cli.arguments import file_argument, file_option, unit_option
from linear_ik.cli.judging import (
    conditions_of_each,
    judged_by,
    loading_state_option,
    material_option,
    most_frequent,
    precamber_option,
    supports_option,
    tolerances_option,
)
from linear_ik.cli.outputs import check_output
from linear_ik.cli.process import Verb, about_options
from linear_ik.cli.progress import Progress

EXAMPLE = """Example: one element with its scan; a run of many, its straightness judged by NSSS

\b
  linear-ik report result.json --scan scan.ply -o report.html
  linear-ik report built/ --tolerances nsss --loading-state self_weight --supports simple --material steel -o a.html
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Write results as one HTML page, to read offline and to sign."
    app.command("report", cls=Verb, help=about, epilog=EXAMPLE)(report)


def report(
    results: Annotated[Path, file_argument("RESULT.json|FOLDER", "A result, or the folder of a run.")],
    output: Annotated[Path, file_option("-o", "--output", metavar="REPORT.html", about="The page.")],
    scan: Annotated[
        list[Path] | None,
        file_option("--scan", metavar="SCAN", about="Show its points near the elements; repeatable."),
    ] = None,
    scan_unit: Annotated[str | None, unit_option("Of the scan files' numbers; of a run's folder, what it was.")] = None,
    tolerances: Annotated[str | None, tolerances_option()] = None,
    loading_state: Annotated[str | None, loading_state_option()] = None,
    precamber: Annotated[float | None, precamber_option()] = None,
    supports: Annotated[str | None, supports_option()] = None,
    material: Annotated[str | None, material_option()] = None,
    conditions: Annotated[
        Path | None,
        file_option(
            "--conditions", metavar="FILE.yaml", about="These and more of each element, by GlobalId, tag or name."
        ),
    ] = None,
    sections: Annotated[
        list[float] | None,
        typer.Option("--section", metavar="METRES", help="Where sections are shown, from the start; repeatable."),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No summary and no progress.")] = False,
) -> None:
    """Read the results, measure and judge them, write the page."""
    scans = scan or []
    target = check_output(output, [results, *scans, *([conditions] if conditions else [])])
    profile, general = judged_by(tolerances, loading_state, precamber, supports, material)
    known = conditions_of_each(conditions, profile, general)
    progress = Progress(quiet)
    with progress.stage(f"reading {results}", judges_input=True):
        from linear_ik.errors import SettingsError
        from linear_ik.report import check_sections, read_run, write_report

        run = read_run(results, profile, known, lambda i, n: progress.update(f"reading result {i} of {n}"))
        try:
            check_sections(run, sections or ())
        except SettingsError as error:
            raise about_options(error, sections_m="--section") from None
    points = None
    if scans:
        with progress.stage("reading " + ", ".join(str(path) for path in scans), judges_input=True):
            from linear_ik.readers import iter_scan
            from linear_ik.report import nearby

            unit = scan_unit or (run.about.get("options.scan_unit") or None)
            points = nearby(run, (piece for path in scans for piece in iter_scan(path, unit=unit)))
    with progress.stage("writing the report"):
        write_report(run, target, points, sections or (), lambda i, n: progress.update(f"writing element {i} of {n}"))
    if not quiet:
        from linear_ik.report.words import what_judged

        outcomes = [(m.outcome or m.result.status, what_judged(m.verdicts, m.outcome)) for m in run.members]
        counts = ", ".join(
            f"{outcomes.count((kind, what))} {kind.replace('_', ' ')}" + (f" ({what})" if what else "")
            for kind, what in dict.fromkeys(outcomes)
        )
        print(f"{'elements':<11}{len(run.members)}: {counts}", file=sys.stderr)
        for kind in ("fail", "inconclusive"):
            judged = [v for member in run.members for v in member.verdicts if v.outcome == kind]
            if judged:
                print(f"{kind:<13}most often: {most_frequent(judged, called='verdicts')}", file=sys.stderr)
        print(f"{'written':<11}{output}", file=sys.stderr)
