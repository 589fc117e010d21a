"""`linear-ik check`: what a design holds and what scans show of it, before the fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from linear_ik.cli.arguments import (
    design_first,
    file_argument,
    inverse_option,
    map_option,
    transform_option,
    unit_option,
)
from linear_ik.cli.process import NOT_SCANNED, Outcome, Verb, about_options
from linear_ik.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import numpy.typing as npt

    from linear_ik.design_model import DesignModel
    from linear_ik.scan import Scan
    from linear_ik.site_check import ScanCheck, SiteCheck

EXAMPLE = """Example: the design alone; with its scans; with one that was aligned; as JSON

\b
  linear-ik check design.ifc
  linear-ik check design.ifc east.e57 west.e57
  linear-ik check design.ifc site.e57 --transform T.txt
  linear-ik check design.ifc site.e57 --json | jq '.elements[] | select(.covered | not) | .tag'

Exit code 3: no element is covered by the scans.
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Say what a design model holds, and what scans show of it."
    app.command("check", cls=Verb, help=about, epilog=EXAMPLE)(check)


def check(
    design: Annotated[Path, file_argument("DESIGN.ifc", "The design: .ifc or .ifczip.")],
    scan: Annotated[list[Path] | None, file_argument("SCAN", "Scans of it, each checked by itself.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON: every element, every figure.")] = False,
    classes: Annotated[
        list[str] | None, typer.Option("--class", metavar="IFC_CLASS", help="Only these, such as IfcBeam; repeatable.")
    ] = None,
    slenderness: Annotated[
        float, typer.Option("--slenderness", help="Least length of an element, in sides of its section.")
    ] = 3.0,
    obstacles: Annotated[
        bool, typer.Option("--obstacles/--no-obstacles", help="Read the other bodies too; takes longer.")
    ] = False,
    scan_unit: Annotated[str | None, unit_option()] = None,
    transform: Annotated[Path | None, transform_option()] = None,
    inverse: Annotated[bool, inverse_option()] = False,
    in_map: Annotated[bool, map_option()] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> Outcome:
    """Read the design, compare the scans, print."""
    from linear_ik.cli.check_text import coverage_lines, design_lines, scan_lines, to_json
    from linear_ik.cli.fit_model import OPTIONS, transform_given
    from linear_ik.errors import SettingsError
    from linear_ik.model_fit.options import ModelFitOptions
    from linear_ik.model_fit.placing import scan_to_model

    design_first(design)
    try:
        placing = ModelFitOptions(T_model_scan=transform_given(transform, inverse), map_coordinates=in_map)
    except SettingsError as error:
        raise about_options(error, **OPTIONS) from None
    progress = Progress(quiet)
    with progress.stage(f"reading {design}", judges_input=True):
        from linear_ik.bim import read_design
        from linear_ik.bim.products import LINEAR_CLASSES

        def bodies_done(done: int, of: int) -> None:
            progress.update(f"reading {design}: {done:,} of {of:,} bodies")

        try:
            model = read_design(
                design,
                on_progress=bodies_done,
                classes=tuple(classes) if classes else LINEAR_CLASSES,
                slenderness=slenderness,
                obstacles=obstacles,
            )
            T = scan_to_model(model, placing)
        except SettingsError as error:
            raise about_options(error, **OPTIONS) from None
    paths = scan or []
    lines = design_lines(model)
    if not paths:
        return Outcome(text=to_json(model, [], None) if as_json else _text(lines))
    site, checks = _check_scans(model, paths, progress, scan_unit, T)
    coverage = site.coverage(checks)
    for one in checks:
        lines += scan_lines(one)
    lines += coverage_lines(model, coverage)
    covered = any(c.covered for c in coverage)
    return Outcome(0 if covered else NOT_SCANNED, to_json(model, checks, coverage) if as_json else _text(lines))


def _check_scans(
    model: DesignModel,
    paths: list[Path],
    progress: Progress,
    unit: str | None,
    T_model_scan: npt.NDArray[np.float64] | None,  # noqa: N803
) -> tuple[SiteCheck, list[ScanCheck]]:
    from linear_ik.readers import iter_scan
    from linear_ik.site.handout import moved
    from linear_ik.site_check import SiteCheck

    with progress.stage("sampling the elements", judges_input=True):
        site = SiteCheck(model)
    checks = []
    for path in paths:
        with progress.stage(f"reading {path}", judges_input=True):

            def points_done(done: int, path: Path = path) -> None:
                progress.update(f"comparing {path}: {done:,} points")

            def read(path: Path = path) -> Iterator[Scan]:
                return moved(iter_scan(path, unit=unit), T_model_scan)

            checks.append(site.scan(path.name, read, points_done))
    return site, checks


def _text(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"
