"""Task: the fit of one element, with all it needs, so that any process on any machine can do it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.errors import LinearIkError
from linear_ik.fit import fit, not_scanned
from linear_ik.result import FitResult
from linear_ik.scan import Scan
from linear_ik.settings import FitSettings
from linear_ik.site.contest import Claimant, contest
from linear_ik.site.obstacles import Mesh, masked

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Task:
    """The first fit of an element, or the contest for its points and the fit that may follow.

    Attributes:
        guid: of the element.
        element: the design.
        points: [P][3] of its neighbourhood, in the model's coordinates.
        stations: [S][3], or None.
        station_index: [P] row of ``stations``, or None.
        settings: of the fit.
        obstacles: near it.
        reach_m: of its neighbourhood.
        first: result of the first fit, in a contest.
        rivals: those who compete for the points, in a contest.
    """

    guid: str
    element: Element
    points: Array
    stations: Array | None
    station_index: npt.NDArray[np.int32] | None
    settings: FitSettings
    obstacles: Mesh
    reach_m: float
    first: FitResult | None = None
    rivals: tuple[Claimant, ...] = ()


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a task.

    Attributes:
        guid: of the element.
        result: of the fit; None where it failed, or where a contest changed nothing.
        failure: why it failed; empty when it did not.
        facts: counts for the table: points, on_obstacles, taken.
        seconds: wall time.
    """

    guid: str
    result: FitResult | None = None
    failure: str = ""
    facts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0


def run_task(task: Task) -> Outcome:
    """Do a task; an error becomes the outcome's, so that one bad element never stops the rest."""
    began = time.perf_counter()
    try:
        outcome = _run(task)
    except Exception as error:
        kind = "" if isinstance(error, LinearIkError) else f"{type(error).__name__}: "
        outcome = Outcome(task.guid, failure=" ".join(f"{kind}{error}".split()))
    return replace(outcome, seconds=time.perf_counter() - began)


def _run(task: Task) -> Outcome:
    off = ~masked(task.points, task.element, task.obstacles)
    facts = {"points": len(off), "on_obstacles": int((~off).sum())}
    if task.first is not None:
        verdict = contest(task.points[off], Claimant.of(task.first), task.rivals)
        facts["taken"] = int(verdict.taken.sum())
        if not verdict.calls_for_fit(task.first):
            return Outcome(task.guid, None, facts=facts)
        off[np.flatnonzero(off)[verdict.taken]] = False
    return Outcome(task.guid, _fit(task, off), facts=facts)


def _fit(task: Task, rows: npt.NDArray[np.bool_]) -> FitResult:
    if not rows.any():
        where = f"within {1e3 * task.reach_m:.0f} mm of its designed surface"
        others = f"all {len(rows):,} points {where} are its neighbours' or other parts' of the design"
        return not_scanned(task.element, others if len(rows) else f"no points {where}", task.settings)
    index = None if task.station_index is None else task.station_index[rows]
    return fit(task.element, Scan(task.points[rows], None, task.stations, index), task.settings)
