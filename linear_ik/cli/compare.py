"""`linear-ik compare`: what moved between two scans."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from linear_ik.cli.arguments import file_argument, file_option
from linear_ik.cli.outputs import check_output
from linear_ik.cli.process import NOT_SCANNED, Outcome, Verb, about_options
from linear_ik.cli.progress import Progress

EXAMPLE = """Example: two epochs of a building, a table for a spreadsheet; then two fits of one beam

\b
  linear-ik compare 2024/ 2026/ -o compare.csv
  linear-ik compare 2024/beam.json 2026/beam.json
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Say what moved between two scans, and how sure that is."
    app.command("compare", cls=Verb, help=about, epilog=EXAMPLE)(compare)


def compare(
    before: Annotated[Path, file_argument("BEFORE", "Results of the first scan: fit's folder, or one RESULT.json.")],
    after: Annotated[Path, file_argument("AFTER", "Results of the second.")],
    output: Annotated[
        Path | None,
        file_option("-o", "--output", metavar="OUT.csv|OUT.json", about="Also a table for programs, in metres."),
    ] = None,
    level: Annotated[float, typer.Option("--level", help="Of significance: how often a false alarm may come.")] = 0.05,
    correction: Annotated[
        str,
        typer.Option(
            "--correction",
            metavar="holm|fdr|none",
            help="For many elements: no false alarm at all, a share of false ones, or each element by itself.",
        ),
    ] = "holm",
    relevant: Annotated[
        float,
        typer.Option(
            "--relevant", metavar="METRES", help="A wider 95 % band makes an element without movement inconclusive."
        ),
    ] = 0.01,
    remove_shift: Annotated[
        bool, typer.Option("--remove-shift", help="Take out the shift that all elements share: registration.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table and no progress.")] = False,
) -> Outcome:
    """Read both epochs, compare, print."""
    target = None
    if output is not None:
        target = check_output(output, [before, after])

    from linear_ik.compare import compare as compare_epochs
    from linear_ik.comparison_table import check_table_format, comparison_lines, write_comparison
    from linear_ik.errors import SettingsError

    if output is not None:
        check_table_format(output)
    progress = Progress(quiet)
    with progress.stage("reading results", judges_input=True):
        try:
            comparison = compare_epochs(
                before,
                after,
                level=level,
                correction=correction,  # type: ignore[arg-type]
                relevant_m=relevant,
                remove_shift=remove_shift,
                on_file=lambda path: progress.update(f"reading {path}"),
            )
        except SettingsError as error:
            raise about_options(error, relevant_m="--relevant") from None
    if target is not None:
        write_comparison(comparison, target)
    text = "" if quiet else "\n".join(comparison_lines(comparison)) + "\n"
    return Outcome(0 if any(m.tested for m in comparison.elements) else NOT_SCANNED, text)
