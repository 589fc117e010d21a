"""Results in: the JSON of `exports.result_json`, schema "linear_ik/result/1", checked to the last key.

Every number reads back as the same double, and null stands for one that is not known.
"""

from __future__ import annotations

import json
import math
import os
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from itertools import chain
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.element_file import element_from_mapping
from linear_ik.errors import LinearIkError
from linear_ik.result import FitResult, IterationRecord, SegmentCount, SegmentResult, SegmentStatus, Status
from linear_ik.settings import FitSettings

SCHEMA = "linear_ik/result/1"
CLOSE_M = 1e-9
EXPECTED = f'a result that linear_ik wrote, schema "{SCHEMA}"'

Array = npt.NDArray[np.float64]


class ResultError(LinearIkError):
    """A file that is no result, or a result that contradicts itself."""


def guid_of(mapping: object) -> str:
    """Return the GlobalId that a result's JSON names, "" where it names none."""
    guid = mapping.get("guid") if isinstance(mapping, dict) else None
    return guid if isinstance(guid, str) else ""


def read_result(path: str | os.PathLike[str]) -> FitResult:
    """Return the result that a file holds.

    Raises:
        ResultError: no such file, no JSON, another schema, a key that is missing or wrong.
    """
    return read_result_with_guid(path)[0]


def read_result_with_guid(path: str | os.PathLike[str]) -> tuple[FitResult, str]:
    """Return the result that a file holds, and the GlobalId that it names or "".

    Raises:
        ResultError: as `read_result`.
    """
    try:
        mapping = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultError(path, f"cannot be read: {error.strerror}", EXPECTED) from None
    except (ValueError, RecursionError) as error:
        raise ResultError(path, f"no JSON: {error}", EXPECTED) from None
    try:
        return result_from_mapping(mapping), guid_of(mapping)
    except LinearIkError as error:
        raise ResultError(path, f"{error.subject}: {error.what}", error.expected or EXPECTED) from None


def result_from_mapping(mapping: object) -> FitResult:
    """Return the result of `result_to_mapping`'s mapping; ``versions`` are left out.

    Raises:
        LinearIkError: a key that is missing or wrong, named.
    """
    top = _mapping("result", mapping)
    if top.get("schema") != SCHEMA:
        raise ResultError("schema", f"{top.get('schema')!r}", EXPECTED)
    element = element_from_mapping(_get(top, "element"))
    n = element.segments
    records = []
    for i, row in enumerate(_list("history", _get(top, "history"))):
        values = _mapping(f"history[{i}]", row)
        record: dict[str, Any] = {
            **values,
            "q": _known(f"history[{i}].q", _get(values, "q"), (3 * n,)),
            "base_pose": _known(f"history[{i}].base_pose", _get(values, "base_pose"), (4, 4)),
        }
        # No number in JSON: a match that loses no weight at any distance.
        if "scale_m" in values and values["scale_m"] is None:
            record["scale_m"] = math.inf
        records.append(_build(IterationRecord, f"history[{i}]", record))
    if "iterations" in top and top["iterations"] != len(records):
        raise ResultError("iterations", reprlib.repr(top["iterations"]), f"{len(records)}, as many as history has")
    segments = [
        _build(SegmentResult, f"segments[{i}]", _mapping(f"segments[{i}]", row))
        for i, row in enumerate(_list("segments", _get(top, "segments")))
    ]
    for i, segment in enumerate(segments):
        _one_of(f"segments[{i}].status", segment.status, get_args(SegmentStatus))
    if len(segments) != n:
        raise ResultError("segments", f"{len(segments)} of them", f"the element's {n}")
    settings = _mapping("settings", _get(top, "settings"))
    # Results of earlier versions have none.
    joint = top.get("configuration_covariance")
    reasons, codes = _reasons(top)
    return FitResult(
        element=element,
        status=_one_of("status", _get(top, "status"), get_args(Status)),
        reasons=reasons,
        reason_codes=codes,
        nodes_m=_known("nodes_m", _get(top, "nodes_m"), (n + 1, 3)),
        nodes_covariance_m2=_array("nodes_covariance_m2", _get(top, "nodes_covariance_m2"), (n + 1, 3, 3)),
        q=_known("q", _get(top, "q"), (3 * n,)),
        joint_angles_rad=_known("joint_angles_rad", _get(top, "joint_angles_rad"), (n, 3)),
        joint_limits_rad=_array("joint_limits_rad", _get(top, "joint_limits_rad"), (n, 3, 2)),
        base_pose=_known("base_pose", _get(top, "base_pose"), (4, 4)),
        rmse_m=_number("rmse_m", _get(top, "rmse_m")),
        surface_rmse_m=_number("surface_rmse_m", _get(top, "surface_rmse_m")),
        range_noise_m=_number("range_noise_m", _get(top, "range_noise_m")),
        segments=tuple(segments),
        history=tuple(records),
        settings=_build(FitSettings, "settings", settings, nan=False),
        timings_s={
            str(k): _number(f"timings_s.{k}", v) for k, v in _mapping("timings_s", _get(top, "timings_s")).items()
        },
        configuration_covariance=None
        if joint is None
        else _array("configuration_covariance", joint, (6 + 3 * n, 6 + 3 * n)),
        unobservable=_texts("unobservable", top.get("unobservable", [])),
        section_scale=_section_scale(top.get("section_scale")),
        **_length(top, element),
        segment_counts=_counts(top.get("segment_counts", []), n),
    )


def _length(top: Mapping[str, Any], element: Element) -> dict[str, float | None]:
    """Return the fitted length and its deviation; results of earlier versions have none."""
    values = {key: top.get(key) for key in ("length_m", "length_sd_m")}
    given = {key: _number(key, value) for key, value in values.items() if value is not None}
    if not given:
        return {}
    if len(given) < 2:
        raise ResultError("length_m", "with one of length_m and length_sd_m null", "both or none")
    length_m, sd_m = given["length_m"], given["length_sd_m"]
    if not abs(length_m - element.length_m) <= element.length_tolerance_m + CLOSE_M:
        raise ResultError("length_m", f"{length_m:g}", "within length_tolerance_m of the element's length")
    if not 0.0 <= sd_m < math.inf:
        raise ResultError("length_sd_m", f"{sd_m:g}", "metres, 0 or more")
    return {"length_m": length_m, "length_sd_m": sd_m}


def _counts(rows: object, n: int) -> tuple[SegmentCount, ...]:
    """Return the numbers of segments that were tried; results of earlier versions have none."""
    tried = tuple(
        _build(SegmentCount, f"segment_counts[{i}]", _mapping(f"segment_counts[{i}]", row))
        for i, row in enumerate(_list("segment_counts", rows))
    )
    if tried and n not in [count.segments for count in tried]:
        raise ResultError("segment_counts", f"without the element's {n}", "what was tried, the chosen one among it")
    return tried


def _section_scale(given: Any) -> tuple[float, float] | None:
    if given is None:
        return None
    x, y = _known("section_scale", given, (2,))
    if not (x > 0.0 and y > 0.0):
        raise ResultError("section_scale", f"{x:g}, {y:g}", "two numbers above 0")
    return float(x), float(y)


def _reasons(top: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return sentences and codes; codes of later versions are kept, results of earlier ones have none."""
    reasons = _texts("reasons", _get(top, "reasons"))
    codes = _texts("reason_codes", top.get("reason_codes", []))
    if codes and len(codes) != len(reasons):
        raise ResultError("reason_codes", f"{len(codes)} of them", f"one for each of the {len(reasons)} reasons")
    return reasons, codes


def _get(mapping: Mapping[str, Any], key: str) -> Any:
    if key not in mapping:
        raise ResultError(key, "is missing", EXPECTED)
    return mapping[key]


def _mapping(name: str, value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ResultError(name, f"{reprlib.repr(value)} is no mapping", EXPECTED)
    return value


def _list(name: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ResultError(name, f"{reprlib.repr(value)} is no list", EXPECTED)
    return value


def _texts(name: str, value: object) -> tuple[str, ...]:
    texts = _list(name, value)
    for i, text in enumerate(texts):
        if not isinstance(text, str):
            raise ResultError(f"{name}[{i}]", reprlib.repr(text), "a text")
    return tuple(texts)


def _number(name: str, value: object) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ResultError(name, f"{reprlib.repr(value)} is no number", "a number or null")
    return float(value)


def _array(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return numbers of a shape; NaN for null, as `_number`."""
    expected = "numbers of shape [" + "][".join(str(n) for n in shape) + "]"
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ResultError(name, reprlib.repr(value), expected) from None
    if array.shape != shape:
        raise ResultError(name, f"shape [{']['.join(str(n) for n in array.shape)}]", expected)
    # NumPy takes texts and truth values for numbers.
    wrong = next((leaf for leaf in _leaves(value, len(shape)) if type(leaf) not in (float, int, NoneType)), None)
    if wrong is not None:
        raise ResultError(name, f"{reprlib.repr(wrong)} is no number", expected)
    return array


def _leaves(value: Any, depth: int) -> Iterator[Any]:
    return chain.from_iterable(_leaves(row, depth - 1) for row in value) if depth > 1 else iter(value)


def _known(name: str, value: object, shape: tuple[int, ...]) -> Array:
    """Return numbers of a shape, none of them null: what every result knows."""
    array = _array(name, value, shape)
    if not np.isfinite(array).all():
        raise ResultError(name, "a number is null or not finite", "numbers")
    return array


def _one_of(name: str, value: Any, allowed: tuple[str, ...]) -> Any:
    if value not in allowed:
        raise ResultError(name, reprlib.repr(value), "one of " + ", ".join(allowed))
    return value


def _build(kind: Any, name: str, values: Mapping[str, Any], nan: bool = True) -> Any:
    """Return a dataclass from the values of its own fields; what later versions add is ignored."""
    out = {}
    for f in fields(kind):
        value = _get(values, f.name) if f.name in values else _get({}, f"{name}.{f.name}")
        if f.type == "float" and nan:
            value = _number(f"{name}.{f.name}", value)
        elif f.type == "int" and (isinstance(value, bool) or not isinstance(value, int)):
            raise ResultError(f"{name}.{f.name}", reprlib.repr(value), "a whole number")
        elif f.type == "str" and not isinstance(value, str):
            raise ResultError(f"{name}.{f.name}", reprlib.repr(value), "a text")
        out[f.name] = value
    return kind(**out)
