"""Stdout kept clear of what libraries print."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout


@contextmanager
def stdout_aside() -> Iterator[None]:
    """Let whatever is printed, from Python or from C, go to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        # C buffers what it prints to a pipe, and would let it out after stdout is back.
        ctypes.CDLL(None).fflush(None)
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def silence() -> Iterator[None]:
    """Drop whatever C code prints on stdout; Python's own output is not touched.

    For libraries that dump what they are working on: nobody could make use of it.
    """
    sys.stdout.flush()
    # What C code has buffered before is somebody's.
    ctypes.CDLL(None).fflush(None)
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    try:
        with _python_to(kept):
            yield
    finally:
        ctypes.CDLL(None).fflush(None)
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def _python_to(descriptor: int) -> Iterator[None]:
    """Let Python's own stdout, where it is the process's, write to another descriptor."""
    try:
        ours = sys.stdout.fileno() == 1
    except (OSError, ValueError):
        # A stream in memory, as in a notebook.
        ours = False
    if not ours:
        yield
        return
    encoding, errors = sys.stdout.encoding, sys.stdout.errors
    with open(descriptor, "w", encoding=encoding, errors=errors, closefd=False) as own, redirect_stdout(own):
        yield
