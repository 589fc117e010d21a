"""The command `linear-ik`: one module a verb."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; nothing is raised.

    Args:
        arguments: those after the program's name. When None, those of the process, which
            then ends here.
    """
    ended_by: list[int] = []
    if arguments is None:
        _open_streams()

        def on_term(number: int, _frame: object) -> None:
            # A batch system's end is as orderly as Ctrl-C: temporary files go, worker processes end.
            ended_by.append(128 + number)
            raise KeyboardInterrupt

        signal.signal(signal.SIGTERM, on_term)
    try:
        # Not at the top: an impatient Ctrl-C comes while typer is being imported.
        from linear_ik.cli.app import run

        code = run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = ended_by[0] if ended_by else 130
    if arguments is None:
        _end(code)
    return code


def _open_streams() -> None:
    """Give the process the standard streams that its parent closed."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            # The lowest free number is the missing one.
            os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(os.dup(number), "w" if number else "r"))


def _end(code: int) -> None:
    """End the process without the libraries' destructors, which print and take 0.2 s."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    atexit._run_exitfuncs()
    sys.stderr.flush()
    os._exit(code)
