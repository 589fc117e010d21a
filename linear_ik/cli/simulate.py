"""`linear-ik simulate`: a scan whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from linear_ik.cli.arguments import file_argument, file_option
from linear_ik.cli.outputs import check_output
from linear_ik.cli.process import Verb, about_options
from linear_ik.cli.progress import Progress

EXAMPLE = """Example: segment 8 turned by 22.5 degrees about y, two faces out of the scanner's sight

\b
  linear-ik simulate beam.yaml --bend 8:y:22.5 --missing +x --missing -y -o scan.ply
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Make a scan of a bent element whose truth is known."
    app.command("simulate", cls=Verb, help=about, epilog=EXAMPLE)(simulate)


def simulate(
    element: Annotated[Path, file_argument("ELEMENT.yaml", "The designed element.")],
    output: Annotated[Path, file_option("-o", "--output", metavar="SCAN", about="The scan: .ply (double) or .xyz.")],
    bend: Annotated[
        list[str] | None,
        typer.Option("--bend", metavar="SEGMENT:AXIS:DEGREES", help="Turn a joint, such as 8:y:22.5; repeatable."),
    ] = None,
    points: Annotated[int, typer.Option("--points", help="Points on the whole element.")] = 10_000,
    noise: Annotated[
        float, typer.Option("--noise", metavar="METRES", help="Standard deviation of x, y and z.")
    ] = 0.001,
    seed: Annotated[int, typer.Option("--seed", help="The same seed gives the same scan.")] = 1,
    missing: Annotated[
        list[str] | None,
        typer.Option("--missing", metavar="+x|-x|+y|-y", help="Leave out what faces that way; repeatable."),
    ] = None,
    truth: Annotated[
        Path | None,
        file_option("--truth", metavar="TRUTH.json", about="Write the true nodes and angles too."),
    ] = None,
) -> None:
    """Read the element, bend it, write the points."""
    from linear_ik.exports.scan_file import check_scan_format, write_scan

    target = check_output(output, [element])
    check_scan_format(output)
    truth_target = check_output(truth, [element], [output]) if truth else None

    from linear_ik.element_file import load_element
    from linear_ik.errors import SettingsError

    design = load_element(element)
    progress = Progress()
    with progress.stage(f"simulating {points:,} points", judges_input=True):
        from linear_ik.simulate import simulate as simulate_scan

        try:
            scan = simulate_scan(
                design, bends=bend or (), points=points, noise_m=noise, seed=seed, missing=missing or ()
            )
        except SettingsError as error:
            raise about_options(error, noise_m="--noise", bends="--bend") from None
    with progress.stage(f"writing {output}"):
        if truth_target is not None:
            from linear_ik.exports.truth_json import write_truth

            write_truth(scan, truth_target)
        write_scan(scan, target)
