"""Fits: the elements' results, from earlier runs or made now, stage by stage."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.design_model import Member
from linear_ik.element_file import element_to_mapping
from linear_ik.exports.result_json import versions
from linear_ik.model_fit.folder import RunFolder, fingerprint
from linear_ik.model_fit.handed_out import HandedOut, Listener, Pieces, hand_out_once
from linear_ik.model_fit.kept_results import Facts, light
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.model_fit.pool import Pool
from linear_ik.model_fit.tasks import Outcome, Task
from linear_ik.readers.result_json import read_result
from linear_ik.reason import Reason
from linear_ik.result import FitResult
from linear_ik.settings import FitSettings
from linear_ik.site.contest import Claimant
from linear_ik.site.neighbourhood import Neighbourhoods, boxes_of
from linear_ik.site.obstacles import Mesh, ObstacleField

Array = npt.NDArray[np.float64]

RIVAL_REACH_M = 0.05


@dataclass(frozen=True, eq=False)
class Row:
    """What is known of one element.

    Attributes:
        member: of the design.
        result: without history and joint covariance, which its file has; None where the fit failed.
        failure: why; else empty.
        facts: counts of its points.
        file: of the result, in the folder; where the fit failed there is none.
    """

    member: Member
    result: FitResult | None
    failure: str
    facts: Facts
    file: str = ""

    @property
    def status(self) -> str:
        """The result's status, or failed."""
        return "failed" if self.result is None else self.result.status


class Fits:
    """The fits of all elements of a run.

    Attributes:
        members: in the design's order.
        inputs: by GlobalId, the fingerprint of what the element's first fit hangs on.
        fitted_now: GlobalIds of the elements that this run fitted, once or, after a contest, twice.
        extent: what was read of the scan.
    """

    def __init__(
        self,
        members: list[Member],
        obstacles: list[tuple[Array, npt.NDArray[np.int64]]],
        settings: FitSettings,
        options: ModelFitOptions,
        folder: RunFolder,
        scans: list[list[object]],
        T_model_scan: Array | None = None,  # noqa: N803
    ) -> None:
        """Find out what each fit hangs on, and which are known from earlier runs."""
        self.members, self.settings, self.options, self.folder = members, settings, options, folder
        self._index = {member.guid: i for i, member in enumerate(members)}
        self._field = ObstacleField(obstacles)
        self._reach = [_reach_m(member, options) for member in members]
        T = None if T_model_scan is None else T_model_scan.tolist()
        common = [asdict(settings), scans, T, options.reach_m, options.max_points, versions()]
        self.inputs = {}
        for i, member in enumerate(members):
            near = self._obstacles(i)
            mesh = hashlib.sha256(near.vertices_m.tobytes()).hexdigest()
            self.inputs[member.guid] = fingerprint(element_to_mapping(member.element), mesh, self._reach[i], common)
        self._handout_inputs = fingerprint(list(self.inputs.values()))
        self._scan_inputs = fingerprint(scans, T, [element_to_mapping(m.element) for m in members], self._reach)
        self._results: dict[str, FitResult] = {}
        self._facts: dict[str, Facts] = {member.guid: {} for member in members}
        self._failures: dict[str, str] = {}
        self.fitted_now: set[str] = set()
        self.extent: dict[str, Any] = {}
        self._neighbourhoods: Neighbourhoods | None = None

    @property
    def neighbourhoods(self) -> Neighbourhoods:
        """Of all members."""
        if self._neighbourhoods is None:
            self._neighbourhoods = Neighbourhoods.of([m.element for m in self.members], self._reach)
        return self._neighbourhoods

    @property
    def results(self) -> dict[str, FitResult]:
        """By GlobalId, the results so far, without their histories and joint covariances (see `light`)."""
        return {m.guid: self._results[m.guid] for m in self.members if m.guid in self._results}

    @property
    def whole(self) -> Mapping[str, FitResult]:
        """By GlobalId, the results in the folder, each read when it is asked for."""
        return _Files({guid: self.folder.results.element_path(guid) for guid in self.results})

    @property
    def rows(self) -> list[Row]:
        """One for each member, with light results."""
        return [
            Row(
                m,
                self._results.get(m.guid),
                self._failures.get(m.guid, ""),
                self._facts[m.guid],
                self.folder.results.element_path(m.guid).relative_to(self.folder.path).as_posix(),
            )
            for m in self.members
        ]

    def prepare(self, pieces: Pieces, listener: Listener) -> HandedOut | None:
        """Take over what is known; hand out the scan and return its points, or None where nothing is left to fit."""
        for member in self.members:
            known = self.folder.results.known(member.guid, "first", self.inputs[member.guid])
            if known is not None:
                self._results[member.guid], self._facts[member.guid] = light(known[0]), known[1]
        if all(m.guid in self._results for m in self.members) and not self._open_contests():
            self.extent = self.folder.scan_extent(self._scan_inputs)
            return None
        points = hand_out_once(
            pieces, self.neighbourhoods, len(self.members), self.folder, self._handout_inputs, self.options, listener
        )
        self.extent = points.extent
        self.folder.keep_scan_extent(self._scan_inputs, self.extent)
        return points

    def take_over(self) -> None:
        """Let the folder hold results of these inputs alone; all others wait beside it for another run."""
        self.folder.results.set_aside(list(self._results))
        for guid in self._results:
            self.folder.results.bring_back(guid)

    def first(self, points: HandedOut | None, pool: Pool, listener: Listener) -> None:
        """Fit every member that is not known; with no ``points``, as `prepare` returns them, there is none."""
        if points is None:
            return
        missing = [i for i, m in enumerate(self.members) if m.guid not in self._results]
        tasks = (self._task(i, points) for i in missing)
        for outcome in self._run(pool, tasks, len(missing), "fitting", listener):
            facts = {**outcome.facts, "received": int(points.received[self._index[outcome.guid]])}
            if outcome.result is None:
                self._failures[outcome.guid] = outcome.failure
                self.folder.results.forget(outcome.guid)
                continue
            self.folder.results.keep(outcome.guid, "first", self.inputs[outcome.guid], outcome.result, facts)
            self._results[outcome.guid], self._facts[outcome.guid] = light(outcome.result), facts

    def contest(self, points: HandedOut | None, pool: Pool, listener: Listener) -> None:
        """Let neighbours compete for points, and fit again those who lose some. All start from the first fits.

        With no ``points``, as `prepare` returns them, every contest is known.
        """
        rivals, inputs = self._rivals(), self._contest_inputs()
        open_ones = []
        finals: dict[str, tuple[FitResult, Facts]] = {}
        for i, member in enumerate(self.members):
            if member.guid not in self._results:
                continue
            known = self.folder.results.known(member.guid, "final", inputs[i]) if i in inputs else None
            if known is not None:
                finals[member.guid] = light(known[0]), known[1]
                continue
            self.folder.results.back_to_first(member.guid)
            if i in inputs:
                open_ones.append(i)
        claimants = {j: Claimant.of(self._results[self.members[j].guid]) for i in open_ones for j in rivals[i]}

        def tasks(points: HandedOut) -> Iterator[Task]:
            for i in open_ones:
                first = self._results[self.members[i].guid]
                others = tuple(claimants[j] for j in rivals[i])
                yield replace(self._task(i, points), first=first, rivals=others)

        stage = "settling between neighbours"
        for outcome in () if points is None else self._run(pool, tasks(points), len(open_ones), stage, listener):
            guid = outcome.guid
            fp = inputs[self._index[guid]]
            facts = {**self._facts[guid], **outcome.facts}
            if outcome.failure:
                doubted = self.folder.results.keep_unsettled(guid, _not_settled(outcome.failure))
                finals[guid] = light(doubted), self._facts[guid]
            elif outcome.result is None:
                self.folder.results.unchanged(guid, fp, facts)
                finals[guid] = self._results[guid], facts
            else:
                self.folder.results.keep(guid, "final", fp, outcome.result, facts)
                finals[guid] = light(outcome.result), facts
        for guid, (result, facts) in finals.items():
            self._results[guid], self._facts[guid] = result, facts

    def _run(self, pool: Pool, tasks: Iterable[Task], count: int, stage: str, listener: Listener) -> Iterator[Outcome]:
        began, done = time.perf_counter(), 0
        if count:
            listener(stage, 0, count, math.nan)
        for outcome in pool.run(tasks):
            done += 1
            if outcome.result is not None:
                self.fitted_now.add(outcome.guid)
            yield outcome
            listener(stage, done, count, (time.perf_counter() - began) / done * (count - done))

    def _task(self, i: int, points: HandedOut) -> Task:
        member = self.members[i]
        return Task(
            member.guid,
            member.element,
            *points.of(i),
            self.settings,
            self._obstacles(i),
            self._reach[i],
        )

    def _obstacles(self, i: int) -> Mesh:
        return self._field.near(boxes_of(self.members[i].element, self._reach[i]))

    def _rivals(self) -> dict[int, list[int]]:
        """Return for each member that has points and a result those that were found and may touch it."""
        if not self.options.contest:
            return {}
        near = Neighbourhoods.of([m.element for m in self.members], [RIVAL_REACH_M + r / 2 for r in self._reach])
        found = {self._index[guid] for guid, result in self._results.items() if result.status != "not_scanned"}
        # One that was not found may be, when its neighbours have taken what is theirs.
        with_points = {self._index[g] for g in self._results if _own_points(self._facts[g])}
        return {i: [j for j in others if j in found] for i, others in near.neighbours().items() if i in with_points}

    def _contest_inputs(self) -> dict[int, str]:
        """Return for each member in a contest the fingerprint of what that hangs on."""
        out = {}
        for i, others in self._rivals().items():
            if others:
                guids = [self.members[j].guid for j in others]
                out[i] = fingerprint(self.inputs[self.members[i].guid], [self.inputs[guid] for guid in guids])
        return out

    def _open_contests(self) -> bool:
        inputs = self._contest_inputs()
        return not all(self.folder.results.has(self.members[i].guid, "final", fp) for i, fp in inputs.items())


class _Files(Mapping[str, FitResult]):
    """Results as they are in files, one in memory at a time."""

    def __init__(self, paths: dict[str, Path]) -> None:
        self._paths = paths

    def __getitem__(self, guid: str) -> FitResult:
        return read_result(self._paths[guid])

    def __contains__(self, guid: object) -> bool:
        return guid in self._paths

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


def _not_settled(failure: str) -> Reason:
    sentence = f"points may be a neighbour's: settling with it failed ({failure}), and this is the fit to all of them"
    return Reason("neighbours_not_settled", sentence)


def _own_points(facts: Facts) -> int:
    """Return how many points an element was fitted to first."""
    return int(facts["points"] - facts["on_obstacles"])


def _reach_m(member: Member, options: ModelFitOptions) -> float:
    element = member.element
    loose = element.placement_tolerance.translation_m if element.start in ("free", "roller") else 0.0
    return options.reach_m + loose + element.length_tolerance_m
