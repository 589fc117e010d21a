"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from linear_ik.errors import OutputError


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> Path:
    """Write a file in one step: readers see the old content or the new, never a part.

    The content goes to a temporary file in the same folder, which then takes the name
    (os.replace). Nothing is left behind on failure, Ctrl-C included.

    Args:
        path: the file; missing folders are made.
        content: bytes, or text that is written as UTF-8.

    Returns:
        The path.

    Raises:
        OutputError: a folder in place of the file, or one that cannot be written to.
    """
    target = Path(path)
    data = content.encode("utf-8") if isinstance(content, str) else content
    check_writable(target)
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
    try:
        # Through os.open the file gets the permissions of the person's umask, which tempfile would not give.
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        os.replace(temporary, target)
    except OSError as error:
        raise _output_error(target, error) from None
    finally:
        temporary.unlink(missing_ok=True)
    return target


def check_writable(path: str | os.PathLike[str]) -> Path:
    """Make the folder of ``path`` and return ``path``; call before long work.

    Raises:
        OutputError: a folder in place of the file, or a folder that cannot be made.
    """
    target = Path(path)
    try:
        if target.is_dir() or not target.name:
            raise OutputError(target, "is a folder", "a file name")
        target.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise _output_error(target, error) from None
    return target


def _output_error(path: Path, error: Exception) -> OutputError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return OutputError(path, f"cannot be written: {reason}", "a folder that exists or can be made, and is writable")
