"""`linear-ik fit`: the main job, of one element (`cli.fit_element`) or of a model (`cli.fit_model`)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from linear_ik.cli.arguments import (
    design_first,
    file_argument,
    file_option,
    inverse_option,
    map_option,
    transform_option,
    unit_option,
)
from linear_ik.cli.judging import (
    judged_by,
    loading_state_option,
    material_option,
    precamber_option,
    supports_option,
    tolerances_option,
)
from linear_ik.cli.process import Outcome, Verb, about_options
from linear_ik.errors import LinearIkError, SettingsError

if TYPE_CHECKING:
    from linear_ik.settings import FitSettings

EXAMPLE = """Example: two files of one scan, the result, and the bent member for other programs; then a whole building

\b
  linear-ik fit beam.yaml east.e57 west.e57 -o result.json --glb beam.glb
  linear-ik fit beam.yaml scan.ply -o - | jq .status
  linear-ik fit design.ifc site.e57 -o asbuilt/ --class IfcBeam
"""
FOR_MODELS = "Only with a model: "


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Fit an element, or all of a design model, to its scan."
    app.command("fit", cls=Verb, help=about, epilog=EXAMPLE)(fit)


def fit(
    element: Annotated[Path, file_argument("ELEMENT.yaml|DESIGN.ifc", "The designed element, or a model.")],
    scan: Annotated[list[Path], file_argument("SCAN", "One or more files of one scan.")],
    output: Annotated[
        Path,
        file_option(
            "-o", "--output", metavar="RESULT.json", about="The result; - prints it on stdout. Of a model: a folder."
        ),
    ],
    urdf: Annotated[
        Path | None,
        file_option("--urdf", metavar="OUT.urdf", about="Also a URDF, with the joint values beside it."),
    ] = None,
    glb: Annotated[
        Path | None,
        file_option("--glb", metavar="OUT.glb", about="Also the bent body, for 3D viewers."),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="With --glb: one body along the curve behind the segments.")
    ] = False,
    record: Annotated[
        Path | None,
        file_option("--record", metavar="PAGE.html", about="Also one page that plays the iterations back."),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Watch the fit in a browser.")] = False,
    wait: Annotated[
        bool, typer.Option("--wait/--no-wait", help="With --view: stay until Enter or Ctrl-C, or end at once.")
    ] = True,
    pairs: Annotated[
        bool,
        typer.Option("--pairs", help="With --view: show from the start which place of it each point belongs to."),
    ] = False,
    method: Annotated[
        str, typer.Option("--method", metavar="default|icpik", help="icpik is the paper's algorithm, for comparison.")
    ] = "default",
    search: Annotated[
        str, typer.Option("--search", metavar="auto|always|never", help="Search each joint's direction from the base.")
    ] = "auto",
    solver: Annotated[str, typer.Option("--solver", help="A QP solver that qpsolvers knows.")] = "osqp",
    range_noise: Annotated[
        float | None, typer.Option("--range-noise", metavar="METRES", help="Of the scanner; estimated when left out.")
    ] = None,
    outlier_removal: Annotated[
        bool, typer.Option("--outlier-removal", help="Remove points without company first (Open3D's).")
    ] = False,
    systematic_error: Annotated[
        float,
        typer.Option("--systematic-error", metavar="METRES", help="1 sigma, shared by all points: registration."),
    ] = 0.0,
    max_iterations: Annotated[int, typer.Option("--max-iterations", help="Of all phases together.")] = 20_000,
    tolerances: Annotated[str | None, tolerances_option()] = None,
    loading_state: Annotated[str | None, loading_state_option()] = None,
    precamber: Annotated[float | None, precamber_option()] = None,
    supports: Annotated[str | None, supports_option()] = None,
    material: Annotated[str | None, material_option()] = None,
    scan_unit: Annotated[str | None, unit_option()] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No summary and no progress.")] = False,
    only: Annotated[
        str | None, typer.Option("--only", metavar="GUID|TAG,...", help=FOR_MODELS + "fit these elements.")
    ] = None,
    classes: Annotated[
        list[str] | None, typer.Option("--class", metavar="IfcBeam", help="Fit this class; repeatable.")
    ] = None,
    segments: Annotated[
        str | None,
        typer.Option("--segments", metavar="N|auto", help="In place of the design's; auto: as the scan asks for."),
    ] = None,
    length_tolerance: Annotated[
        float | None,
        typer.Option("--length-tolerance", metavar="METRES", help=FOR_MODELS + "how far a length may be off; 0."),
    ] = None,
    transform: Annotated[Path | None, transform_option()] = None,
    inverse: Annotated[bool, inverse_option()] = False,
    in_map: Annotated[bool, map_option()] = False,
    reach: Annotated[
        float | None, typer.Option("--reach", metavar="METRES", help="How far an element may be from its design; 0.15.")
    ] = None,
    max_points: Annotated[int | None, typer.Option("--max-points", help="Of one element; 100000.")] = None,
    memory: Annotated[
        float | None, typer.Option("--memory", metavar="MB", help="Most for points on their way to elements; 512.")
    ] = None,
    legend: Annotated[
        float | None, typer.Option("--legend", metavar="METRES", help="Deviation at the ends of the colours; 0.02.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files in the folder that no run of this design wrote.")
    ] = False,
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", help="Processes, 1 and up; one a core when left out.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="tcp://HOST:8786", help="A Dask cluster in place of them.")
    ] = None,
) -> Outcome:
    """Tell an element from a model, and hand over what was asked for."""
    if workers is not None and workers < 1:
        # 0 is for Python, whose caller may not have processes made.
        raise SettingsError("--workers", str(workers), "a whole number from 1 to 1000")
    design_first(element)
    from linear_ik.cli.fit_element import Wanted, fit_one
    from linear_ik.cli.fit_model import fit_building, is_model, refuse

    for_models: dict[str, object] = {
        "only": None if only is None else tuple(guid.strip() for guid in only.split(",") if guid.strip()),
        "classes": None if classes is None else tuple(classes),
        "length_tolerance_m": length_tolerance,
        "reach_m": reach,
        "max_points": max_points,
        "memory_mb": memory,
        "legend_m": legend,
        "workers": workers,
        "scheduler": scheduler,
        "map_coordinates": in_map or None,
        "overwrite": overwrite or None,
    }
    if is_model(element):
        refuse(
            "is for one element",
            "not with a design model",
            urdf=urdf,
            glb=glb,
            smooth=smooth or None,
            record=record,
            view=view or None,
            pairs=pairs or None,
            tolerances=tolerances,
            loading_state=loading_state,
            precamber=precamber,
            supports=supports,
            material=material,
        )
        settings = _settings(method, search, solver, range_noise, max_iterations, outlier_removal, systematic_error)
        for_models["scan_unit"] = scan_unit
        for_models["segments"] = None if segments is None else _segments(segments)
        return fit_building(element, scan, output, settings, quiet, transform, inverse, for_models)
    refuse("is for design models", "not with one element", transform=transform, inverse=inverse or None, **for_models)
    settings = _settings(method, search, solver, range_noise, max_iterations, outlier_removal, systematic_error)
    count = None if segments is None else _segments(segments)
    wanted = Wanted(output, urdf, glb, smooth, record, view, pairs, wait, quiet)
    judges = judged_by(tolerances, loading_state, precamber, supports, material)
    return fit_one(element, scan, wanted, settings, count, scan_unit, judges)


def _settings(
    method: str,
    search: str,
    solver: str,
    range_noise: float | None,
    max_iterations: int,
    outlier_removal: bool,
    systematic_error: float,
) -> FitSettings:
    """Return the settings that the options ask for."""
    from linear_ik.settings import FitSettings

    try:
        return FitSettings(
            method=method,  # type: ignore[arg-type]
            search=search,  # type: ignore[arg-type]
            solver=solver,
            range_noise_m=range_noise,
            max_iterations=max_iterations,
            outlier_removal=outlier_removal,
            systematic_error_m=systematic_error,
        )
    except SettingsError as error:
        raise about_options(error, range_noise_m="--range-noise", systematic_error_m="--systematic-error") from None


def _segments(text: str) -> int | Literal["auto"]:
    """Return a number of segments, or auto.

    Raises:
        LinearIkError: something else.
    """
    if text == "auto":
        return "auto"
    try:
        return int(text)
    except ValueError:
        raise LinearIkError("--segments", repr(text), "a whole number, or auto") from None
