"""HandedOut: the scan's points as they wait for the elements' fits, handed out once, by this run or an earlier one."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import write_atomically
from linear_ik.errors import ScanError
from linear_ik.model_fit.folder import RunFolder
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.scan import Scan
from linear_ik.site.handout import hand_out
from linear_ik.site.neighbourhood import Neighbourhoods
from linear_ik.site.spill import Spill

Array = npt.NDArray[np.float64]
Listener = Callable[[str, int, int, float], object]
"""Called with the stage, how much of it is done, of how much (0: unknown), and the seconds it may still take (NaN)."""
Pieces = Callable[[Array], Iterable[Scan]]
"""Gives the scan in the model's coordinates; what is in none of some boxes [B][2][3] may be left out."""

FIGURES = ("points", "in_a_neighbourhood", "low_m", "high_m", "left_out", "elements_with_mixed_stations")


@dataclass(frozen=True, eq=False)
class HandedOut:
    """Points by element.

    Attributes:
        spill: holds them.
        stations: [S][3] of the scan, or None.
        extent: what was read of the scan.
    """

    spill: Spill
    stations: Array | None
    extent: dict[str, Any]

    @property
    def received(self) -> npt.NDArray[np.int64]:
        """How many points each element was given, those included that are not kept."""
        return self.spill.received

    def of(self, i: int) -> tuple[Array, Array | None, npt.NDArray[np.int32] | None]:
        """Return the points [P][3] of an element, the stations [S][3] and which saw each point [P], or None.

        One point of an unknown station is enough for None: what is seen from where is asked of every point.
        """
        records = self.spill.load(i)
        points, station = np.ascontiguousarray(records["xyz"]), records["station"].astype(np.int32)
        stations = self.stations if len(points) and self.stations is not None and station.min() >= 0 else None
        return points, stations, None if stations is None else station


def hand_out_once(
    pieces: Pieces,
    neighbourhoods: Neighbourhoods,
    elements: int,
    folder: RunFolder,
    inputs: str,
    options: ModelFitOptions,
    listener: Listener,
) -> HandedOut:
    """Hand out the scan, unless an earlier run came to the end of that.

    Args:
        pieces: gives the scan, in the model's coordinates.
        neighbourhoods: of the elements.
        elements: how many there are.
        folder: of the run.
        inputs: fingerprint of what the points of each element hang on.
        options: of the run.
        listener: told how many points are done.
    """
    note = folder.handed_out_note
    memory_bytes = int(options.memory_mb * 2**20 / 2)
    spill = Spill(folder.scratch, elements, options.max_points, memory_bytes)
    done = _earlier(note, inputs, spill)
    if done is None:
        folder.new_scratch()
        near = pieces(neighbourhoods.bounds_m)
        extent = hand_out(
            near, neighbourhoods, spill, lambda points: listener("handing out points", points, 0, math.nan)
        )
        done = {
            "inputs": inputs,
            "received": spill.received.tolist(),
            "bytes": spill.settle(),
            "stations": extent.stations,
            "extent": {
                "points": extent.points,
                "in_a_neighbourhood": extent.handed_out,
                "low_m": extent.low_m.tolist(),
                "high_m": extent.high_m.tolist(),
                "left_out": extent.left_out,
                "elements_with_mixed_stations": extent.mixed,
            },
        }
        write_atomically(note, json.dumps(done) + "\n")
    else:
        spill.received[:] = done["received"]
    return HandedOut(spill, np.array(done["stations"]) if done["stations"] else None, done["extent"])


def scan_inputs(paths: Sequence[Path], unit: str | None) -> list[list[object]]:
    """Return what tells whether scan files are still the same: place, size, time of change and unit.

    Raises:
        ScanError: one is gone.
    """
    out: list[list[object]] = []
    for path in paths:
        try:
            stat = path.stat()
        except OSError as error:
            raise ScanError(path, f"cannot be read: {error.strerror}", "a readable file") from None
        out.append([str(path.resolve()), stat.st_size, stat.st_mtime_ns, unit or "m"])
    return out


def check_unchanged(paths: Sequence[Path], scans: list[list[object]]) -> None:
    """Refuse scan files that are no longer those that ``scans``, from `scan_inputs`, were made of.

    Raises:
        ScanError: one is not.
    """
    for path, before in zip(paths, scans, strict=True):
        if scan_inputs([path], str(before[-1])) != [before]:
            raise ScanError(path, "it changed while it was read", "a file that nobody writes to; start again")


def _earlier(note: Path, inputs: str, spill: Spill) -> dict[str, Any] | None:
    """Return what an earlier run noted of the same inputs, or None.

    What has another shape was noted by none, and points of which some are gone are not those.
    """
    try:
        done = json.loads(note.read_text(encoding="utf-8"))
        if done["inputs"] != inputs or np.array(done["received"], dtype=np.int64).shape != spill.received.shape:
            return None
        if done["bytes"] != spill.file_bytes():
            return None
        if done["stations"] and np.array(done["stations"], dtype=np.float64).shape[1:] != (3,):
            return None
        figures = {key: done["extent"][key] for key in FIGURES}
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None
    return {**done, "extent": figures}
