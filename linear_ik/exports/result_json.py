"""Results out, as JSON, schema "linear_ik/result/1": what scripts are written against.

Lengths in metres, angles in radians, coordinates the scan's own; every number reads back
as the same double, and null stands for one that is not known.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import write_atomically
from linear_ik.element_file import element_to_mapping
from linear_ik.readers.result_json import SCHEMA
from linear_ik.result import FitResult, IterationRecord

PACKAGES = ("linear_ik", "numpy", "open3d", "open3d-cpu", "osqp", "pin", "qpsolvers")
# 500 segments would take 50 MB, 100 take 2.
MOST_WITH_COVARIANCE = 100
POSE_DIGITS = 5

Array = npt.NDArray[np.float64]


def result_to_mapping(result: FitResult) -> dict[str, Any]:
    """Return a result as JSON's own types, in the order of the contract."""
    return {
        "schema": SCHEMA,
        "element": element_to_mapping(result.element),
        "status": result.status,
        "reasons": list(result.reasons),
        "reason_codes": list(result.reason_codes),
        "iterations": result.iterations,
        "nodes_m": _plain(result.nodes_m),
        "nodes_covariance_m2": _plain(result.nodes_covariance_m2),
        "configuration_covariance": _plain(_kept(result)),
        "q": _plain(result.q),
        "joint_angles_rad": _plain(result.joint_angles_rad),
        "joint_limits_rad": _plain(result.joint_limits_rad),
        "base_pose": _plain(result.base_pose),
        "length_m": _plain(result.length_m),
        "length_sd_m": _plain(result.length_sd_m),
        "segment_counts": [_plain(asdict(tried)) for tried in result.segment_counts],
        "rmse_m": _plain(result.rmse_m),
        "surface_rmse_m": _plain(result.surface_rmse_m),
        "range_noise_m": _plain(result.range_noise_m),
        "unobservable": list(result.unobservable),
        "section_scale": None if result.section_scale is None else list(result.section_scale),
        "segments": [_plain(asdict(segment)) for segment in result.segments],
        "history": [{f.name: _plain(getattr(record, f.name)) for f in fields(record)} for record in result.history],
        "settings": _plain(asdict(result.settings)),
        "timings_s": _plain(dict(result.timings_s)),
        "versions": versions(),
    }


def result_to_json(result: FitResult, extra: Mapping[str, Any] | None = None) -> str:
    """Return a result as JSON text: one line a key, a segment, an iteration or a verdict.

    Args:
        result: of a fit.
        extra: further keys, such as ``verdicts``.
    """
    lines = []
    for key, value in {**result_to_mapping(result), **_plain(extra or {})}.items():
        if key in ("segments", "history", "verdicts") and value:
            # Hundreds of iterations: blanks between their numbers are a tenth of a file.
            rows = ",\n  ".join(_dump(row, tight=key == "history") for row in value)
            lines.append(f"{_dump(key)}: [\n  {rows}\n]")
        else:
            lines.append(f"{_dump(key)}: {_dump(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def with_short_history(result: FitResult) -> FitResult:
    """Return a result whose history tells what happened in half the text, for files by the thousand.

    How it came about is no result: poses of iterations to 1e-5 rad and metres, figures to four digits.
    """
    return replace(result, history=tuple(_shortened(record) for record in result.history))


def _shortened(record: IterationRecord) -> IterationRecord:
    short: dict[str, Any] = {
        name: float(f"{getattr(record, name):.4g}") for name in ("surface_rmse_m", "scale_m", "damping", "step_rad")
    }
    for name in ("q", "base_pose"):
        # + 0.0: no -0.0, which is longer.
        short[name] = np.round(getattr(record, name), POSE_DIGITS) + 0.0
    return replace(record, **short)


def write_result(result: FitResult, path: str | os.PathLike[str], extra: Mapping[str, Any] | None = None) -> Path:
    """Write a result as JSON, whole or not at all.

    Args:
        result: of a fit.
        path: of the file.
        extra: further keys, such as ``verdicts``; readers that do not know them pass over them.

    Raises:
        OutputError: the file cannot be written.
    """
    return write_atomically(path, result_to_json(result, extra))


def versions() -> dict[str, str]:
    """Return the versions of what the result depends on, those installed."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _kept(result: FitResult) -> Array | None:
    """Return the covariance of the configuration, unless it would outgrow all else."""
    return result.configuration_covariance if result.element.segments <= MOST_WITH_COVARIANCE else None


def _dump(value: object, tight: bool = False) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":") if tight else None)


def _plain(value: Any) -> Any:
    """Return JSON's own types; a number that is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
