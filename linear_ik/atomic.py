"""Files that appear whole or not at all, a power cut included: data are on the disk before the name is."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from linear_ik.errors import OutputError


def write_atomically(path: str | os.PathLike[str], content: bytes | str, settle: bool = True) -> Path:
    """Write a file in one step: readers see the old content or the new, never a part.

    The content goes to a temporary file in the same folder, which then takes the name
    (os.replace). Nothing is left behind on failure, Ctrl-C included. A link keeps
    pointing where it did; devices and pipes, such as /dev/stdout, are written to.

    Args:
        path: the file; missing folders are made.
        content: bytes, or text that is written as UTF-8.
        settle: wait until the data are on the disk, so that a power cut cannot leave the name without them. Some 5 ms:
            not for thousands of files of which whoever reads them can tell whether they are whole.

    Returns:
        The path.

    Raises:
        OutputError: a folder in place of the file, or one that cannot be written to.
    """
    target = check_writable(path)
    try:
        data = content.encode("utf-8") if isinstance(content, str) else content
        if _is_device(target):
            # To replace these would be to destroy them: as root, even /dev/null.
            target.write_bytes(data)
        else:
            _replace(Path(os.path.realpath(target)), data, settle)
    except (OSError, ValueError) as error:
        raise _output_error(target, error) from None
    return target


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the block a temporary file to write bit by bit, which takes the name when the block has ended well.

    Links and devices are treated as `write_atomically` does.

    Raises:
        OutputError: a place that cannot be written to.
    """
    target = check_writable(path)
    device = _is_device(target)
    real = Path(os.path.realpath(target))
    folder = Path(tempfile.gettempdir()) if device else real.parent
    temporary = folder / f".linear_ik-{secrets.token_hex(8)}{target.suffix}"
    try:
        yield temporary
        if device:
            with temporary.open("rb") as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)
        else:
            flush_to_disk(temporary)
            os.replace(temporary, real)
    except OSError as error:
        raise _output_error(target, error) from None
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def output_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say what the operating system refuses in the block as an error of ``path``.

    Raises:
        OutputError: it refused something.
    """
    try:
        yield
    except OSError as error:
        raise _output_error(Path(path), error) from None


def check_writable(path: str | os.PathLike[str]) -> Path:
    """Make the folder of ``path`` and return ``path``; call before long work.

    Raises:
        OutputError: a folder in place of the file, or a folder that cannot be made or
            written to.
    """
    target = Path(path)
    try:
        if "\0" in str(target):
            raise ValueError("a null character in its name")
        if target.is_dir() or not target.name:
            raise OutputError(target, "is a folder", "a file name")
        if not _is_device(target):
            folder = Path(os.path.realpath(target)).parent
            folder.mkdir(parents=True, exist_ok=True)
            if not os.access(folder, os.W_OK | os.X_OK):
                raise PermissionError(None, "the folder is write-protected")
    except (OSError, ValueError) as error:
        raise _output_error(target, error) from None
    return target


def flush_to_disk(path: Path) -> None:
    """Wait until what was written to a file is where a power cut leaves it.

    Raises:
        OSError: the disk refuses it.
    """
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def same_file(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Say whether two paths lead to one file, which need not exist."""
    try:
        return os.path.realpath(one) == os.path.realpath(other) or os.path.samefile(one, other)
    except (OSError, ValueError):
        # Neither exists, or the other is no possible name: whoever opens it says so.
        return False


def _is_device(path: Path) -> bool:
    # /dev/stdout may lead to a file, which another process holds open: to replace it would hide what follows.
    return path.exists() and (not path.is_file() or str(path.absolute()).startswith(("/dev/", "/proc/")))


def _replace(target: Path, data: bytes, settle: bool) -> None:
    temporary = target.with_name(f".linear_ik-{secrets.token_hex(8)}.tmp")
    try:
        # tempfile would make it readable by its owner alone, whatever the umask says.
        with temporary.open("xb") as file:
            file.write(data)
        if settle:
            flush_to_disk(temporary)
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _output_error(path: Path, error: Exception) -> OutputError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return OutputError(path, f"cannot be written: {reason}", "a folder that exists or can be made, and is writable")
