"""`linear-ik tolerances`: the files of limits that come with the package, to copy and to change."""

from __future__ import annotations

from typing import Annotated

import typer

from linear_ik.cli.process import Outcome, Verb

EXAMPLE = """Example: what there is; a copy of one's own, changed and used

\b
  linear-ik tolerances
  linear-ik tolerances aisc303 > ours.yaml
  linear-ik report result.json --tolerances ours.yaml -o report.html
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("tolerances", cls=Verb, help="List the shipped limits, or print one file.", epilog=EXAMPLE)(tolerances)


def tolerances(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="The file to print on stdout.")] = None,
) -> Outcome:
    """List, or print."""
    from linear_ik.tolerances import load_tolerances, shipped
    from linear_ik.tolerances.profile_file import shipped_path

    if name is not None:
        return Outcome(0, shipped_path(name).read_text(encoding="utf-8"))
    lines = []
    for one in shipped():
        profile = load_tolerances(one)
        verified = sum(clause.verified_by is not None for clause in profile.clauses)
        lines.append(f"{one:<32}{profile.title} ({verified} of {len(profile.clauses)} limits verified)")
    return Outcome(0, "\n".join(lines) + "\n")
