"""Members of a report: results from files, with what the run's own files say of them."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.deviation import Deviations, deviations
from linear_ik.elastic_sag import ElasticSag
from linear_ik.errors import LinearIkError, ToleranceError
from linear_ik.readers.result_json import EXPECTED, ResultError, guid_of, result_from_mapping
from linear_ik.result import FitResult
from linear_ik.run_files import ELEMENTS, REPORT, TABLE, check_finished
from linear_ik.tolerances import (
    IFC_CLASS,
    Accuracy,
    Conditions,
    ConditionsOfEach,
    Profile,
    Verdict,
    imperfection,
    level_of_accuracy,
    overall,
    sag_of,
    verdicts,
)

Array = npt.NDArray[np.float64]

NOT_SHOWN = ("deviation.inputs", "options.contest")
RUN_EXPECTED = "the JSON that linear-ik fit wrote"


@dataclass(frozen=True, eq=False)
class ReportedMember:
    """One element of a report.

    Attributes:
        key: unique in the report: the GlobalId that the result's file names, or the file's own name.
        name: as designed.
        tag: the mark that drawings use; may be empty.
        ifc_class: such as IfcBeam; may be empty.
        profile: name of the section.
        result: of the fit.
        versions: of what the result was made with.
        deviations: against the specified shape, with its precamber; None where the element was not found,
            or its ends coincide.
        elastic: what its own weight makes of it, where that was stated and computed; else None.
        imperfection: the deviations without that; None where ``elastic`` is.
        accuracy: None where the element was not found.
        verdicts: on each clause; empty where no tolerances were asked for.
        outcome: what the verdicts come to; empty where there are none.
    """

    key: str
    name: str
    tag: str
    ifc_class: str
    profile: str
    result: FitResult
    versions: dict[str, str] = field(default_factory=dict)
    deviations: Deviations | None = None
    elastic: ElasticSag | None = None
    imperfection: Deviations | None = None
    accuracy: Accuracy | None = None
    verdicts: tuple[Verdict, ...] = ()
    outcome: str = ""


@dataclass(frozen=True, eq=False)
class Run:
    """What a report is about.

    Attributes:
        title: of the page.
        members: one page each.
        unfitted: elements without a result, by column: rows of the run's table, and what the run left out.
        about: what the run says of itself, by name.
        T_results_scan: [4][4] from the scan's coordinates to the results', or None where they are the same.
    """

    title: str
    members: tuple[ReportedMember, ...]
    unfitted: tuple[dict[str, str], ...] = ()
    about: dict[str, str] = field(default_factory=dict)
    T_results_scan: Array | None = None


def read_run(
    path: str | os.PathLike[str],
    profile: Profile | None = None,
    conditions: Conditions | ConditionsOfEach | None = None,
    on_member: Callable[[int, int], object] | None = None,
) -> Run:
    """Return what a report is about.

    Args:
        path: a result, or the folder of a run: its ``elements/*.json``, ``elements.csv`` and
            ``run.json``; a folder of results without those will do.
        profile: tolerances, or None for no verdicts.
        conditions: what only the person knows, of all members or of each.
        on_member: called with how many are read, of how many.

    Raises:
        ResultError: no result there, one that cannot be read, or two of one element.
        LinearIkError: a folder whose run was not finished.
        ToleranceError: conditions of an element that is not there.
    """
    known = conditions if isinstance(conditions, ConditionsOfEach) else ConditionsOfEach(conditions or Conditions())
    source = Path(path)
    files = _results(source)
    rows = _table(source / TABLE) if source.is_dir() else {}
    order = {guid: i for i, guid in enumerate(rows)}
    said = _said(source / REPORT) if source.is_dir() else {}
    left_out = said.pop("left_out", None)
    unfitted = [dict(_flat("", row)) for row in left_out or () if isinstance(row, dict)]
    members: dict[str, ReportedMember] = {}
    strangers = set(known.named)
    # Those without a result are no strangers: the file of conditions is that of the whole building.
    strangers -= {row.get(column, "") for row in (*rows.values(), *unfitted) for column in ("guid", "tag", "name")}
    for i, file in enumerate(files):
        result, versions, guid = _read(file)
        # Names of files are not the GlobalIds where a file system takes no difference between A and a.
        key = guid if guid and guid not in members else file.stem
        if key in members:
            raise ResultError(file, f"is a second result of {key}", "one result an element")
        row = rows.pop(key, {})
        names = (key, file.stem, row.get("tag", ""), row.get("name") or result.element.name)
        strangers -= {*names}
        members[key] = judged_member(result, profile, known.of(*names), key, versions, row)
        if on_member is not None:
            on_member(i + 1, len(files))
    ordered = sorted(members.values(), key=lambda member: order.get(member.key, len(order)))
    if strangers:
        raise ToleranceError("conditions", f"no element {sorted(strangers)[0]!r}", "a GlobalId, tag or name of the run")
    title = ordered[0].name if len(ordered) == 1 and not source.is_dir() else source.resolve().name
    if source.is_dir() and isinstance(said.get("design"), str):
        title = f"{said['design']} as built: {title}"
    T = _transform(source / REPORT, said.pop("T_model_scan", None))
    return Run(title, tuple(ordered), (*rows.values(), *unfitted), dict(_about(said)), T)


def judged_member(
    result: FitResult,
    profile: Profile | None = None,
    conditions: Conditions | None = None,
    key: str = "",
    versions: dict[str, str] | None = None,
    about: dict[str, str] | None = None,
) -> ReportedMember:
    """Return a result as a member of a report, measured and judged.

    Args:
        result: of a fit.
        profile: tolerances, or None for no verdicts.
        conditions: what only the person knows.
        key: unique in the report; the element's name where left out.
        versions: of what the result was made with.
        about: ``name``, ``tag``, ``ifc_class`` and ``profile``, where known.
    """
    row, element, known = about or {}, result.element, conditions or Conditions()
    if known.ifc_class is None and IFC_CLASS.fullmatch(row.get("ifc_class", "")):
        known = replace(known, ifc_class=row["ifc_class"])
    found: Deviations | None = None
    elastic: ElasticSag | None = None
    free: Deviations | None = None
    if result.status != "not_scanned":
        try:
            # Against the specified shape, as the verdicts are: one set of figures in all of the report.
            found = deviations(result, precamber_m=known.precamber_m or 0.0)
            elastic = sag_of(result, known)
            free = None if elastic is None else imperfection(result, elastic, known)
        except LinearIkError:
            pass  # its ends coincide: there is no chord to measure from, and the page says so
    judged: tuple[Verdict, ...] = ()
    if profile is not None and (found or result.status == "not_scanned"):
        judged = verdicts(result, profile, known, found, free)
    return ReportedMember(
        key=key or element.name,
        name=row.get("name") or element.name,
        tag=row.get("tag", ""),
        ifc_class=row.get("ifc_class", ""),
        profile=row.get("profile") or element.profile.type.replace("_", " "),
        result=result,
        versions=versions or {},
        deviations=found,
        elastic=elastic,
        imperfection=free,
        accuracy=None if found is None else level_of_accuracy(result, found),
        verdicts=judged,
        outcome=overall(judged) if judged else "",
    )


def _results(source: Path) -> list[Path]:
    if not source.is_dir():
        return [source]
    check_finished(source)
    folder = source / ELEMENTS if (source / ELEMENTS).is_dir() else source
    files = sorted(path for path in folder.glob("*.json") if path.name != REPORT)
    if not files:
        raise ResultError(source, "holds no results", f"a result, or a folder with {ELEMENTS}/*.json")
    return files


def _read(path: Path) -> tuple[FitResult, dict[str, str], str]:
    """Return a result, the versions it was made with and the GlobalId that its file names, or ""."""
    try:
        mapping = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultError(path, f"cannot be read: {error.strerror}", EXPECTED) from None
    except (ValueError, RecursionError) as error:
        raise ResultError(path, f"no JSON: {error}", EXPECTED) from None
    try:
        result = result_from_mapping(mapping)
    except LinearIkError as error:
        raise ResultError(path, f"{error.subject}: {error.what}", error.expected or EXPECTED) from None
    versions = mapping.get("versions")
    said = {str(k): str(v) for k, v in versions.items()} if isinstance(versions, dict) else {}
    return result, said, guid_of(mapping)


def _table(path: Path) -> dict[str, dict[str, str]]:
    """Return the rows of a run's table by GlobalId; none where there is no table."""
    if not path.is_file():
        return {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [{str(k): str(v or "") for k, v in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError, csv.Error) as error:
        raise ResultError(path, f"cannot be read: {error}", "a table with the column guid") from None
    if rows and "guid" not in rows[0]:
        raise ResultError(path, "has no column guid", "a table that linear-ik fit wrote")
    return {row["guid"]: row for row in rows}


def _said(path: Path) -> dict[str, Any]:
    """Return what a run says of itself; nothing where there is no such file."""
    if not path.is_file():
        return {}
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ResultError(path, f"cannot be read: {error}", RUN_EXPECTED) from None
    if not isinstance(said, dict):
        raise ResultError(path, "no set of keys", RUN_EXPECTED)
    return said


def _transform(path: Path, value: object) -> Array | None:
    if value is None:
        return None
    try:
        T = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        T = np.empty(0)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise ResultError(path, "T_model_scan is no 4 x 4 numbers", RUN_EXPECTED)
    return None if (T == np.eye(4)).all() else T


def _about(said: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what of a run's own words a reader wants: no fingerprints, and nothing that was not set."""
    return ((name, text) for name, text in _flat("", said) if text and name not in NOT_SHOWN)


def _flat(name: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield names and values as text, nested names joined by dots."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, list):
        yield name, ", ".join(_text(v) for v in value[:20]) + (", ..." if len(value) > 20 else "")
    else:
        yield name, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, float):
        # Coordinates on a map keep their millimetres.
        return f"{value:.6g}" if abs(value) < 1e5 else f"{value:.3f}"
    return "" if value is None else str(value)
