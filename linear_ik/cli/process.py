"""What every verb owes the process: a clean stdout, one line an error, the right exit code."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import typer
import typer.core

from linear_ik.errors import LinearIkError
from linear_ik.quick_open3d import defer_plots
from linear_ik.quiet import stdout_aside

BAD_INPUT = 2
NOT_SCANNED = 3
INTERNAL = 1
INTERRUPTED = 130
BROKEN_PIPE = 141


@dataclass(frozen=True)
class Outcome:
    """What a verb ends with.

    Attributes:
        exit_code: of the process.
        text: what was asked for on stdout.
    """

    exit_code: int = 0
    text: str = ""


class Verb(typer.core.TyperCommand):
    """A verb that returns an Outcome, and whose libraries cannot reach stdout."""

    def invoke(self, ctx: Any) -> int:
        """Run the verb, then print what was asked for."""
        defer_plots()
        try:
            with stdout_aside():
                outcome = super().invoke(ctx)
        except KeyboardInterrupt:
            # typers differ in what they make of it.
            raise typer.Exit(INTERRUPTED) from None
        if not isinstance(outcome, Outcome):
            return 0
        if outcome.text:
            sys.stdout.write(outcome.text)
            sys.stdout.flush()
        if outcome.exit_code:
            raise typer.Exit(outcome.exit_code)
        return 0


def explain(error: Exception) -> tuple[str, int]:
    """Return the line that says what went wrong, and the exit code."""
    if isinstance(error, LinearIkError):
        return f"error: {error}", BAD_INPUT
    # typer brings a click of its own since 0.16, with the same classes under other names.
    usage = getattr(error, "format_message", None)
    if usage is not None:
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else "linear-ik"
        return f"error: {path}: {_line(usage()).rstrip('.')} (see {path} --help)", BAD_INPUT
    text = _line(str(error))
    if isinstance(error, ImportError) and "cannot open shared object file" in text:
        library = text.split(":")[0]
        packages = "libusb-1.0-0 libgl1 libegl1 libgomp1"
        return f"error: {library}: is missing (sudo apt-get install {packages})", INTERNAL
    kind = type(error).__name__
    return f"error: internal: {kind}: {text} (run with LINEAR_IK_DEBUG=1 for the traceback)", INTERNAL


def was_interrupted(error: BaseException) -> bool:
    """Say whether Ctrl-C is behind an error: compiled modules turn it into an ImportError of theirs."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause is not None


def about_options(error: LinearIkError, **options: str) -> LinearIkError:
    """Return an error of an argument as one of the option that carries it.

    Args:
        error: about an argument of a function.
        options: argument -> option, where the option is not the argument's own name.
    """
    return error.about(options.get(error.subject, "--" + error.subject.replace("_", "-")))


def _line(text: str) -> str:
    return " ".join(text.split())
