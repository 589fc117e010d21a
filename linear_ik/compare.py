"""Compare: two epochs of results, element by element."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.common_shift import FEWEST, CommonShift, common_shift
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.movement import Movement, judge, movement, with_displacement
from linear_ik.readers.result_json import read_result_with_guid
from linear_ik.result import FitResult
from linear_ik.run_files import ELEMENTS, check_finished

Array = npt.NDArray[np.float64]
Correction = Literal["holm", "fdr", "none"]
Source = str | os.PathLike[str] | Mapping[str, FitResult] | FitResult

TABLE = "elements.csv"
LEVEL = 0.05
RELEVANT_M = 0.01


class CompareError(LinearIkError):
    """Two epochs that cannot be compared."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two epochs of a building.

    Attributes:
        elements: the most significant movement first; those not tested last.
        shift: the rigid motion all elements share, None of fewer than three.
        shift_removed: whether the elements' movements are without it.
        level: of significance.
        correction: for the number of elements: holm (no false "moved" among all of them but with the
            probability ``level``), fdr (Benjamini and Hochberg: at most the share ``level`` of those called
            moved), or none (each element by itself).
    """

    elements: tuple[Movement, ...]
    shift: CommonShift | None
    shift_removed: bool
    level: float
    correction: Correction


def compare(
    before: Source,
    after: Source,
    *,
    level: float = LEVEL,
    correction: Correction = "holm",
    relevant_m: float = RELEVANT_M,
    remove_shift: bool = False,
    on_file: Callable[[Path], None] | None = None,
) -> Comparison:
    """Return what moved between two epochs, each movement tested against both covariances.

    Args:
        before: a folder of results (``elements/*.json``), one result file, results by GlobalId, or one result.
        after: the same of the later epoch; elements are matched by the GlobalId in their files, else by file
            name, two single results with each other. Tags and classes come from the folders' ``elements.csv``.
        level: of significance, 0 to 1.
        correction: for the number of elements, see `Comparison`.
        relevant_m: an element whose 95 % band across reaches farther and that shows no movement is inconclusive.
        remove_shift: take the shift that all elements share out of every movement.
        on_file: called with each file that is read.

    Raises:
        CompareError: a folder without results, or with two of one element; no element in common.
        LinearIkError: a folder whose run was not finished.
        ResultError: a file that is no result.
        SettingsError: a level or length out of its range, too few elements for their common shift.
    """
    if not 0.0 < level < 1.0:
        raise SettingsError("level", f"{level:g}", "between 0 and 1")
    if not relevant_m > 0.0:
        raise SettingsError("relevant_m", f"{relevant_m:g}", "metres, above 0")
    if correction not in get_args(Correction):
        raise SettingsError("correction", repr(correction), "one of " + ", ".join(get_args(Correction)))
    first, second = (_results(source, on_file) for source in (before, after))
    if len(first) == len(second) == 1 and not (_is_folder(before) or _is_folder(after)):
        second = {next(iter(first)): next(iter(second.values()))}
    if not set(first) & set(second):
        raise CompareError(_name(after), f"no element in common with {_name(before)}", "two epochs of one design")
    movements = [movement(key, first.get(key), second.get(key)) for key in sorted({*first, *second})]
    shift = common_shift(movements)
    if remove_shift:
        if shift is None:
            raise SettingsError("remove_shift", "too few elements in both scans", f"{FEWEST} or more")
        movements = [_without(m, shift) for m in movements]
    tested = [i for i, m in enumerate(movements) if m.tested]
    adjusted = adjust(np.array([movements[i].p_value for i in tested]), correction)
    for i, p in zip(tested, adjusted, strict=True):
        movements[i] = judge(movements[i], float(p), level, relevant_m)
    about = _about(before) | _about(after)
    named = ((m, about.get(m.key, {})) for m in movements)
    movements = [replace(m, tag=row.get("tag") or "", ifc_class=row.get("ifc_class") or "") for m, row in named]
    ordered = sorted(movements, key=lambda m: (not m.tested, m.p_value if m.tested else 0.0, -m.largest_m, m.key))
    return Comparison(tuple(ordered), shift, remove_shift, level, correction)


def adjust(p: Array, correction: Correction) -> Array:
    """Return p-values [K] corrected for their number, never above 1."""
    order, k = np.argsort(p), len(p)
    out = np.array(p, dtype=np.float64)
    if correction == "holm":
        out[order] = np.minimum(np.maximum.accumulate((k - np.arange(k)) * p[order]), 1.0)
    elif correction == "fdr":
        raised = p[order] * k / (np.arange(k) + 1)
        out[order] = np.minimum(np.minimum.accumulate(raised[::-1])[::-1], 1.0)
    return out


def _without(m: Movement, shift: CommonShift) -> Movement:
    if not m.tested:
        return m
    moved, covariance = shift.at(m.nodes_m)
    return with_displacement(m, m.displacement_m - moved, m.covariance_m2 + covariance)


def _results(source: Source, on_file: Callable[[Path], None] | None) -> dict[str, FitResult]:
    if isinstance(source, FitResult):
        return {source.element.name: source}
    if isinstance(source, Mapping):
        return dict(source)
    path = Path(source)
    paths = [path]
    if path.is_dir():
        check_finished(path)
        paths = sorted((path / ELEMENTS).glob("*.json"))
        if not paths:
            raise CompareError(path, "holds no elements/*.json", "a folder that linear-ik fit wrote, or a result file")
    out: dict[str, FitResult] = {}
    for file in paths:
        if on_file is not None:
            on_file(file)
        result, guid = read_result_with_guid(file)
        # Of a building's results the histories and the joint covariances would take most of the memory.
        light = replace(result, history=(), configuration_covariance=None)
        # Names of files are not the GlobalIds where a file system takes no difference between A and a.
        key = guid or file.stem
        if key in out:
            raise CompareError(file, f"is a second result of {key}", "one result an element")
        out[key] = light
    return out


def _about(source: Source) -> dict[str, dict[str, str]]:
    """Return the rows of a run's table by GlobalId; none where there is no table.

    Raises:
        CompareError: one that cannot be read.
    """
    table = Path(source) / TABLE if isinstance(source, (str, os.PathLike)) else None
    if table is None or not table.is_file():
        return {}
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            return {row.get("guid") or "": row for row in csv.DictReader(file)}
    except (OSError, ValueError, csv.Error) as error:
        raise CompareError(table, f"cannot be read: {error}", "a table that linear-ik fit wrote") from None


def _is_folder(source: Source) -> bool:
    return isinstance(source, Mapping) or (isinstance(source, (str, os.PathLike)) and Path(source).is_dir())


def _name(source: Source) -> str:
    return str(source) if isinstance(source, (str, os.PathLike)) else "after"
