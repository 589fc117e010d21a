"""Where a verb may write: asked before the work, so that nothing is computed in vain."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from linear_ik.atomic import same_file
from linear_ik.errors import OutputError
from linear_ik.run_files import ELEMENTS, OUTPUTS, PLY

STDOUT = ("-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")


def is_stdout(path: Path) -> bool:
    """Say whether a path asks for stdout, which the verbs keep aside."""
    return str(path) in STDOUT


def check_output(path: Path, inputs: Iterable[Path] = (), others: Iterable[Path] = ()) -> Path:
    """Return the file that will be written, links followed; nothing is made yet.

    Args:
        path: as the person typed it.
        inputs: files that are read, and so are not to be replaced; of a folder, what a run leaves in it.
        others: the verb's other outputs.

    Raises:
        OutputError: a folder, stdout, one of ``inputs`` or ``others``, or a place that
            cannot be written to.
    """
    if is_stdout(path):
        raise OutputError(path, "is stdout", "a file name")
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise OutputError(path, "is a folder", "a file name")
        for other in inputs:
            if same_file(target, other):
                raise OutputError(path, "is one of the files that are read", "another file name")
            if _belongs_to_run(target, other):
                raise OutputError(path, f"belongs to the results in {other}", "another file name, or another folder")
        for other in others:
            if same_file(target, other):
                raise OutputError(path, "is given for two outputs", "a file name of its own for each")
        if target.exists() and not os.access(target, os.W_OK):
            raise OutputError(path, "is write-protected", "a file that may be replaced")
        # A device or a pipe, such as /dev/null, is written to, and its folder left alone.
        if target.exists() and not target.is_file():
            return path
        _check_folder(path, target.parent)
    except (OSError, ValueError) as error:
        raise OutputError(path, f"cannot be written: {_reason(error)}", "a writable place") from None
    return target


def check_folder(path: Path) -> Path:
    """Return the folder that will be written to, links followed; nothing is made yet.

    Raises:
        OutputError: a file in its place, or a place that cannot be written to.
    """
    try:
        target = Path(os.path.realpath(path))
        _check_folder(path, target)
    except (OSError, ValueError) as error:
        raise OutputError(path, f"cannot be written: {_reason(error)}", "a writable place") from None
    return target


def _belongs_to_run(target: Path, folder: Path) -> bool:
    """Say whether a file is, or would be, a part of the run in a folder that is read."""
    try:
        root = Path(os.path.realpath(folder))
        if not root.is_dir() or not target.is_relative_to(root):
            return False
    except (OSError, ValueError):
        return False
    # Some file systems take no difference between capitals and small letters.
    parts = [part.lower() for part in target.relative_to(root).parts]
    if len(parts) > 1:
        return parts[0] == ELEMENTS
    named = parts[0] in (*OUTPUTS, ELEMENTS) or Path(parts[0]).stem == Path(PLY).stem
    # A folder of results has them beside each other.
    return named or (target.suffix.lower() == ".json" and target.exists())


def _check_folder(path: Path, folder: Path) -> None:
    """Raise unless files can be made in ``folder``, or it in the nearest one that exists."""
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise OutputError(path, f"{folder} is no folder", "a folder, or a missing one that can be made")
    # Only trying says the truth about mounts and rights; the file has no name and is gone at once.
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(path, f"nothing can be written in {folder}: {_reason(error)}", "a writable place") from None


def _reason(error: Exception) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
