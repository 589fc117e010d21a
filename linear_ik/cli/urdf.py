"""`linear-ik urdf`: an element as robotics tools read it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from linear_ik.cli.arguments import file_argument, file_option
from linear_ik.cli.outputs import check_output
from linear_ik.cli.process import Verb

EXAMPLE = """Example:

\b
  linear-ik urdf beam.yaml -o beam.urdf
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("urdf", cls=Verb, help="Write an element as a URDF of spherical joints.", epilog=EXAMPLE)(urdf)


def urdf(
    element: Annotated[Path, file_argument("ELEMENT.yaml", "The designed element.")],
    output: Annotated[
        Path,
        file_option("-o", "--output", metavar="OUT.urdf", about="Meshes go to a folder beside it."),
    ],
) -> None:
    """Read the element, write the URDF."""
    target = check_output(output, [element])

    from linear_ik.element_file import load_element
    from linear_ik.urdf import write_urdf

    write_urdf(load_element(element), target)
