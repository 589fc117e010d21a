"""KeptResults: the results of a run's elements on disk, and which of them a run that starts again need not make again.

A result is taken over when the fingerprint of everything its fit hangs on is the same: design, settings, what stands
around it, the scan files and the versions.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from linear_ik.atomic import output_errors, write_atomically
from linear_ik.errors import LinearIkError
from linear_ik.exports.result_json import result_to_json, with_short_history
from linear_ik.readers.result_json import read_result
from linear_ik.reason import Reason
from linear_ik.result import FitResult
from linear_ik.run_files import ELEMENTS, STATE

SAFE = re.compile(r"[0-9A-Za-z_$-]{1,64}\Z")
STAGES = ("first", "final")
Facts = dict[str, Any]


def file_stems(guids: Sequence[str]) -> dict[str, str]:
    """Return a file name without ending for each GlobalId of a design: itself, wherever a file system takes it.

    Some file systems take no difference between capitals and small letters: names that differ
    in nothing else all get a suffix, each its own, whatever the order they come in.
    """
    alike = Counter(guid.lower() for guid in guids)
    stems: dict[str, str] = {}
    for guid in guids:
        stem = guid
        if not SAFE.match(guid) or alike[guid.lower()] > 1:
            stem = re.sub(r"[^0-9A-Za-z_$-]", "_", guid)[:40] + "-" + hashlib.sha256(guid.encode()).hexdigest()[:8]
        stems[guid] = stem
    return stems


class KeptResults:
    """A result of each element, and what was noted of it.

    The first one waits in ``run_state/first`` while another stands in its place; those of other inputs in
    ``run_state/other``.
    """

    def __init__(self, path: Path, guids: Sequence[str]) -> None:
        """Name the files in the folder of a run; nothing is made yet.

        Args:
            path: the folder.
            guids: of all members of the design, so that names are the same whichever are fitted.
        """
        self.path, self._stems = path, file_stems(guids)

    def set_aside(self, guids: Sequence[str]) -> None:
        """Keep all but some results out of ``elements``: whoever reads it takes all there is.

        Args:
            guids: of the elements whose results stay.

        Raises:
            OutputError: they cannot be moved.
        """
        names = {self.element_path(guid).name for guid in guids}
        for path in sorted((self.path / ELEMENTS).glob("*.json")):
            if path.name not in names:
                _move(path, self.path / STATE / "other" / path.name)

    def bring_back(self, guid: str) -> None:
        """Put the result of an element that was set aside where it was.

        Raises:
            OutputError: it cannot be moved.
        """
        if self._other_path(guid).exists():
            _move(self._other_path(guid), self.element_path(guid))

    def element_path(self, guid: str) -> Path:
        """Return where an element's result is."""
        return self.path / ELEMENTS / f"{self._stems[guid]}.json"

    def known(self, guid: str, stage: str, inputs: str) -> tuple[FitResult, Facts] | None:
        """Return the result of an earlier run and its facts, or None where something has changed.

        Args:
            guid: of the element.
            stage: first or final.
            inputs: fingerprint of what the fit hangs on now.
        """
        found = self._found(guid, stage, inputs)
        if found is None:
            return None
        try:
            return read_result(found[0]), found[1]
        except LinearIkError:
            return None

    def has(self, guid: str, stage: str, inputs: str) -> bool:
        """Say whether `known` would find something."""
        return self._found(guid, stage, inputs) is not None

    def _found(self, guid: str, stage: str, inputs: str) -> tuple[Path, Facts] | None:
        record = self._records(guid).get(stage, {})
        if record.get("inputs") != inputs:
            return None
        paths = [self.element_path(guid), self._other_path(guid)]
        if stage == "first":
            paths.insert(0, self._first_path(guid))
        for path in paths:
            try:
                if _sha256(path) == record["sha256"]:
                    return path, dict(record["facts"])
            except (OSError, KeyError, TypeError, ValueError):
                continue
        return None

    def keep(self, guid: str, stage: str, inputs: str, result: FitResult, facts: Facts) -> None:
        """Write a result; it is taken over later only when this came to its end.

        Raises:
            OutputError: it cannot be written.
        """
        path, records = self.element_path(guid), self._records(guid)
        with output_errors(path):
            if stage == "final":
                self._put_first_aside(guid)
            elif stage == "first":
                self._first_path(guid).unlink(missing_ok=True)
                records = {}
            # What a power cut leaves of it is told by its hash.
            self._put(guid, result)
            self._other_path(guid).unlink(missing_ok=True)
            records[stage] = {"inputs": inputs, "sha256": _sha256(path), "facts": facts}
        self._note(guid, records)

    def unchanged(self, guid: str, inputs: str, facts: Facts) -> None:
        """Note that the contest left the first result as it is: it is final."""
        records = self._records(guid)
        records["final"] = {**records["first"], "inputs": inputs, "facts": facts}
        self._note(guid, records)

    def keep_unsettled(self, guid: str, doubt: Reason) -> FitResult:
        """Write and return the first result with a doubt, where the contest failed; it is not final.

        Raises:
            ResultError: the first result cannot be read.
            OutputError: it cannot be written.
        """
        self._put_first_aside(guid)
        result = read_result(self._first_path(guid)).with_reasons(doubt)
        self._put(guid, result)
        return result

    def _put_first_aside(self, guid: str) -> None:
        """Make room for another result; the contest starts from the first one when the run is repeated."""
        if self.element_path(guid).exists():
            _move(self.element_path(guid), self._first_path(guid))

    def back_to_first(self, guid: str) -> None:
        """Undo a contest of an earlier run: the first result is the element's again.

        Raises:
            OutputError: it cannot be moved.
        """
        path, records = self._first_path(guid), self._records(guid)
        with output_errors(path):
            if path.exists():
                if _sha256(path) == records.get("first", {}).get("sha256"):
                    _move(path, self.element_path(guid))
                else:
                    path.unlink()
        if records.pop("final", None) is not None:
            self._note(guid, records)

    def forget(self, guid: str) -> None:
        """Remove what an earlier run left of an element that has failed now.

        Raises:
            OutputError: it cannot be removed.
        """
        paths = (self._state_path(guid), self._first_path(guid), self._other_path(guid), self.element_path(guid))
        for path in paths:
            with output_errors(path):
                path.unlink(missing_ok=True)

    def _first_path(self, guid: str) -> Path:
        return self.path / STATE / "first" / f"{self._stems[guid]}.json"

    def _other_path(self, guid: str) -> Path:
        return self.path / STATE / "other" / f"{self._stems[guid]}.json"

    def _state_path(self, guid: str) -> Path:
        return self.path / STATE / f"{self._stems[guid]}.json"

    def _put(self, guid: str, result: FitResult) -> None:
        text = result_to_json(with_short_history(result), {"guid": guid})
        write_atomically(self.element_path(guid), text, settle=False)

    def _note(self, guid: str, records: dict[str, Any]) -> None:
        write_atomically(self._state_path(guid), json.dumps(records) + "\n", settle=False)

    def _records(self, guid: str) -> dict[str, Any]:
        try:
            records = json.loads(self._state_path(guid).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return records if isinstance(records, dict) else {}


def light(result: FitResult) -> FitResult:
    """Return a result as small as can be, for thousands are kept in memory, and the same whether read or made now.

    Of the history the last record stays; how the joints vary together is in the file alone, 0.3 MB of 60 segments.
    """
    return with_short_history(replace(result, history=result.history[-1:], configuration_covariance=None))


def _move(path: Path, to: Path) -> None:
    with output_errors(to):
        os.replace(path, to)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
