"""`linear-ik demo`: the main job on an embedded example."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from linear_ik.cli.arguments import file_option
from linear_ik.cli.outputs import check_folder, check_output
from linear_ik.cli.process import Verb
from linear_ik.cli.progress import Progress

if TYPE_CHECKING:
    from linear_ik.result import FitResult
    from linear_ik.simulate import SimulatedScan

EXAMPLE = """Example:

\b
  linear-ik demo -o here
"""
FILES = (
    "element.yaml",
    "scan.ply",
    "truth.json",
    "result.json",
    "result.urdf",
    "result_joints.json",
    "result.glb",
    "view.html",
    "report.html",
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    about = "Scan a bent column, fit it, compare with the truth."
    app.command("demo", cls=Verb, help=about, epilog=EXAMPLE)(demo)


def demo(
    output: Annotated[Path, file_option("-o", "--output", metavar="FOLDER", about="Where the files go.")] = Path(
        "linear_ik_demo"
    ),
) -> None:
    """Simulate, fit, write, compare."""
    folder = check_folder(output)
    for name in FILES:
        check_output(folder / name)
    progress = Progress()

    with progress.stage("scanning a bent column"):
        from linear_ik.example import example_element, example_element_text, example_scan

        element = example_element()
        truth = example_scan()
        scan = truth.without_truth()
    with progress.stage("fitting"):
        from linear_ik.fit import fit

        result = fit(element, scan)
    with progress.stage(f"writing {output}"):
        from linear_ik.atomic import write_atomically
        from linear_ik.exports.fitted_urdf import write_fitted_urdf
        from linear_ik.exports.glb import write_glb
        from linear_ik.exports.result_json import versions, write_result
        from linear_ik.exports.scan_file import write_scan
        from linear_ik.exports.truth_json import write_truth
        from linear_ik.report import Run, judged_member, write_report
        from linear_ik.viewer import Viewer

        write_atomically(folder / "element.yaml", example_element_text())
        write_scan(scan, folder / "scan.ply")
        write_truth(truth, folder / "truth.json")
        write_result(result, folder / "result.json")
        write_fitted_urdf(element, result.q, result.base_pose, folder / "result.urdf")
        write_glb(element, result.q, result.base_pose, folder / "result.glb")
        viewer = Viewer(element.name)
        viewer.show_result(result, scan)
        viewer.static_html(folder / "view.html")
        write_report(Run(element.name, (judged_member(result, versions=versions()),)), folder / "report.html", scan)
    for line in _comparison(result, truth, output):
        print(line, file=sys.stderr)


def _comparison(result: FitResult, truth: SimulatedScan, output: Path) -> list[str]:
    import numpy as np

    from linear_ik.cli.summary import describe
    from linear_ik.deviation_bands import BAND_95

    errors = 1000 * np.linalg.norm(result.nodes_m - truth.nodes_m, axis=1)
    bands = 1000 * BAND_95 * np.sqrt(np.linalg.eigvalsh(result.nodes_covariance_m2)[:, -1])
    T = result.element.placement.T_world_element
    designed = T[:3, 3] + np.outer(np.linspace(0, result.element.length_m, len(errors)), T[:3, 2])
    true_offset, found_offset = (1000 * np.linalg.norm(n - designed, axis=1) for n in (truth.nodes_m, result.nodes_m))
    lines = [*describe(result), "", "offset from the design in mm", "node   truth   found   error   95 % band"]
    for k in range(len(errors)):
        lines.append(f"{k:4}{true_offset[k]:8.2f}{found_offset[k]:8.2f}{errors[k]:8.2f}{bands[k]:12.2f}")
    lines += ["", f"largest error {errors.max():.2f} mm, at node {errors.argmax()}", "", "look at"]
    for name, what in (
        ("view.html", "the design, the scan and the fit; opens in any browser"),
        ("report.html", "bow, plumb, sections, each figure with its band: to file and to sign"),
        ("result.json", "every figure"),
        ("result.glb", "the bent column, for 3D programs"),
        ("result.urdf", "the same as a kinematic chain, its joint values beside it"),
        ("element.yaml", "what was designed: change it, and try"),
    ):
        lines.append(f"  {output / name!s:<30}{what}")
    lines.append(f"  linear-ik fit {output / 'element.yaml'} {output / 'scan.ply'} -o mine.json")
    return lines
