"""The command `linear-ik`: one module a verb."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; nothing is raised.

    Args:
        arguments: those after the program's name; of the process when None.
    """
    try:
        # Not at the top: an impatient Ctrl-C comes while typer is being imported.
        from linear_ik.cli.app import run

        return run(sys.argv[1:] if arguments is None else list(arguments))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    finally:
        if arguments is None:
            # What is left is Python's own end, which would meet Ctrl-C with a traceback.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
