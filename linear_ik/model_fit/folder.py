"""RunFolder: the output folder of a run, which one run at a time is at work in, and the points that wait there."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from linear_ik.atomic import output_errors, write_atomically
from linear_ik.errors import OutputError
from linear_ik.model_fit.kept_results import KeptResults
from linear_ik.model_fit.lock import FolderLock
from linear_ik.run_files import ELEMENTS, STATE, UNFINISHED


def fingerprint(*parts: object) -> str:
    """Return a hash of values that JSON knows, the same on every machine."""
    text = json.dumps(parts, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


class RunFolder:
    """The output folder of a run.

    Attributes:
        path: the folder.
        results: of the elements.
        scratch: where points wait, gone when the run is complete.
        handed_out_note: of the points there, written when all have been handed out.
        notes: plain sentences on how other runs are kept out, where that is not as usual.
    """

    def __init__(self, path: Path, guids: Sequence[str]) -> None:
        """Name the files; nothing is made yet.

        Args:
            path: the folder.
            guids: of all members of the design, so that names are the same whichever are fitted.
        """
        self.path, self.results = path, KeptResults(path, guids)
        self.scratch = path / STATE / "points"
        self.handed_out_note = self.scratch / "complete.json"
        self.notes: tuple[str, ...] = ()
        self._made: list[Path] = []
        self._lock = FolderLock(path / STATE)

    def make(self) -> None:
        """Make the folders, and keep other runs out of them until this process ends or calls `release`.

        Raises:
            OutputError: they cannot be made, or another run is at work there.
        """
        state = self.path / STATE
        folders = (
            *reversed(self.path.parents),
            self.path,
            self.path / ELEMENTS,
            state,
            state / "first",
            state / "other",
        )
        self._made = [folder for folder in folders if not folder.exists()]
        try:
            with output_errors(self.path):
                for folder in self._made:
                    folder.mkdir(exist_ok=True)
        except OutputError:
            self.take_back()
            raise
        with output_errors(self.path):
            self.notes = self._lock.take()
        self._sweep()

    def _sweep(self) -> None:
        """Remove what a run that was killed was writing; nobody else is, under the lock."""
        state = self.path / STATE
        for folder in (self.path, self.path / ELEMENTS, state, state / "first", state / "other"):
            for path in folder.glob(".linear_ik-*"):
                path.unlink(missing_ok=True)

    def begin(self) -> None:
        """Note that results are about to change, for whoever reads the folder before `end`.

        Raises:
            OutputError: it cannot be written.
        """
        write_atomically(self.path / STATE / UNFINISHED, "linear-ik fit goes on when it is started again\n")

    def end(self) -> None:
        """Take the note of `begin` away, and the points: the run is whole."""
        self.clear_scratch()
        (self.path / STATE / UNFINISHED).unlink(missing_ok=True)

    def release(self) -> None:
        """Let other runs in."""
        self._lock.release()

    def scan_extent(self, inputs: str) -> dict[str, Any]:
        """Return what an earlier run read of the same scan for the same elements; empty when it is not known."""
        try:
            kept = json.loads((self.path / STATE / "scan.extent").read_text(encoding="utf-8"))
            return dict(kept["extent"]) if kept["inputs"] == inputs else {}
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def keep_scan_extent(self, inputs: str, extent: dict[str, Any]) -> None:
        """Keep what was read of the scan."""
        write_atomically(self.path / STATE / "scan.extent", json.dumps({"inputs": inputs, "extent": extent}) + "\n")

    def new_scratch(self) -> Path:
        """Return an empty folder for points.

        Raises:
            OutputError: it cannot be made.
        """
        shutil.rmtree(self.scratch, ignore_errors=True)
        with output_errors(self.scratch):
            self.scratch.mkdir(parents=True)
        return self.scratch

    def clear_scratch(self) -> None:
        """Remove the points."""
        shutil.rmtree(self.scratch, ignore_errors=True)

    def clear_part(self) -> None:
        """Remove the points unless all were handed out: then the next run need not read the scan again."""
        if not self.handed_out_note.exists():
            self.clear_scratch()

    def take_back(self) -> None:
        """Leave nothing of a run that could not start."""
        self.clear_scratch()
        for folder in reversed(self._made):
            if folder in self.path.parents:
                # Somebody else may have put something there by now.
                with suppress(OSError):
                    folder.rmdir()
            else:
                shutil.rmtree(folder, ignore_errors=True)
