"""The verbs together, and what happens when they fail."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from typing import Annotated

import typer

from linear_ik.cli import align, check, compare, demo, fit, report, simulate, tolerances, urdf, view
from linear_ik.cli.process import BROKEN_PIPE, INTERRUPTED, explain, was_interrupted

NAME = "linear-ik"

app = typer.Typer(
    name=NAME,
    help="As-built shape of beams, columns and pipes: bends a designed element until it fits a laser scan.",
    epilog="Exit codes: 0 done, 2 bad input (nothing written), 3 the element is not in the scan, "
    "4 more than one alignment is as good, 130 or 143 interrupted.",
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
for verb in (check, align, fit, report, compare, tolerances, view, demo, urdf, simulate):
    verb.register(app)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"{NAME} {version('linear_ik')}")
        raise typer.Exit()


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run(arguments: Sequence[str]) -> int:
    """Run a verb and return the exit code; errors become one line on stderr.

    Raises:
        KeyboardInterrupt: Ctrl-C.
        Exception: any, when LINEAR_IK_DEBUG is set.
    """
    debug = bool(os.environ.get("LINEAR_IK_DEBUG"))
    if not debug:
        warnings.simplefilter("ignore")
    try:
        code = typer.main.get_command(app).main(args=list(arguments), prog_name=NAME, standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):
        # typer ends the process when nobody reads any more, and only then.
        return BROKEN_PIPE
    except typer.Abort:
        raise KeyboardInterrupt from None
    except Exception as error:
        if was_interrupted(error):
            raise KeyboardInterrupt from None
        if debug:
            raise
        line, code = explain(error)
        print(line, file=sys.stderr)
        return code
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code if isinstance(code, int) else 0
