"""Lock: keeps a second run out of a folder that one is at work in."""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path
from typing import TextIO

from linear_ik.errors import OutputError

NO_LOCKS = "the file system of the output folder has no locks: a file there kept other runs out"


class FolderLock:
    """Held from `take` until `release`, or until this process ends.

    Where the file system has no locks, as some network drives, a file that names the holder stands for one. It
    stays behind when the holder is killed: the next run on the same machine removes it, on another a person.
    """

    def __init__(self, state: Path) -> None:
        """Name the files in the folder ``state``; nothing is made yet."""
        self._path, self._note = state / "lock", state / "lock.holder"
        self._file: TextIO | None = None
        self._noted = False

    def take(self) -> tuple[str, ...]:
        """Take the lock; return sentences on how, where that is not as usual.

        Raises:
            OutputError: another run has it.
            OSError: the files cannot be made.
        """
        self._file = self._path.open("a")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise self._taken("another folder, or wait") from None
        except OSError:
            self._take_by_note()
            return (NO_LOCKS,)
        return ()

    def release(self) -> None:
        """Let others have it."""
        if self._noted:
            self._note.unlink(missing_ok=True)
            self._noted = False
        if self._file is not None:
            self._file.close()

    def _take_by_note(self) -> None:
        host = socket.gethostname()
        while True:
            try:
                with self._note.open("x", encoding="utf-8") as file:
                    self._noted = True
                    file.write(f"{host} {os.getpid()}")
                return
            except FileExistsError:
                pass
            try:
                holder = self._note.read_text(encoding="utf-8")
            except FileNotFoundError:
                continue
            its_host, _, pid = holder.partition(" ")
            if its_host == host and pid.isdigit() and not _runs(int(pid)):
                self._note.unlink(missing_ok=True)
                continue
            raise self._taken(f"another folder, or wait; where that run was killed, remove {self._note}", holder)

    def _taken(self, expected: str, holder: str = "") -> OutputError:
        what = "another run is at work in it" + (f" (host and process: {holder})" if holder else "")
        return OutputError(self._path.parent.parent, what, expected)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # somebody else's
    return True
