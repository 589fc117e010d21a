"""Table: one line an element, units in the names of the columns, every figure beside its 95 % band."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import write_atomically
from linear_ik.deviation import deviations
from linear_ik.deviation_bands import BAND_95, band_along
from linear_ik.deviation_figures import Figure
from linear_ik.errors import LinearIkError
from linear_ik.model_fit.fits import Row
from linear_ik.result import FitResult

Array = npt.NDArray[np.float64]

COLUMNS = (
    "guid",
    "ifc_class",
    "name",
    "tag",
    "profile",
    "length_m",
    "status",
    "reasons",
    "reason_codes",
    "points",
    "matched_points",
    "measured_share",
    "max_offset_mm",
    "max_offset_band95_mm",
    "max_offset_at_m",
    "start_offset_mm",
    "start_offset_band95_mm",
    "end_offset_mm",
    "end_offset_band95_mm",
    "along_axis_mm",
    "along_axis_band95_mm",
    "measured_length_m",
    "measured_length_band95_mm",
    "bow_mm",
    "bow_band95_mm",
    "sag_mm",
    "sag_band95_mm",
    "sweep_mm",
    "sweep_band95_mm",
    "out_of_plumb_mm",
    "out_of_plumb_band95_mm",
    "surface_rmse_mm",
    "range_noise_mm",
    "file",
    "remark",
)


def write_table(rows: Iterable[Row], path: Path) -> None:
    """Write the table as CSV (RFC 4180, UTF-8).

    Offsets are across the designed axis, of the nodes; the shift along it stands apart, because
    surfaces hardly show it. ``length_m`` is the designed length; the measured one is empty unless
    the element has a ``length_tolerance_m`` and the scan tells its length. Bow, sag (downwards)
    and sweep (sideways) are offsets from the chord between the ends, see `deviation`. The remark
    says what of the designed body is not in the element.

    Args:
        rows: in the design's order, with whole results.
        path: of the file.

    Raises:
        OutputError: it cannot be written.
    """
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, COLUMNS)
    table.writeheader()
    for row in rows:
        table.writerow(line(row))
    write_atomically(path, text.getvalue())


def line(row: Row) -> dict[str, object]:
    """Return the values of one element; empty where there are none."""
    member, result = row.member, row.result
    values: dict[str, object] = {
        "guid": member.guid,
        "ifc_class": member.ifc_class,
        "name": member.name,
        "tag": member.tag,
        "profile": member.profile_name,
        "length_m": f"{member.element.length_m:.4f}",
        "status": row.status,
        "reasons": row.failure if result is None else "; ".join(result.reasons),
        "points": row.facts.get("received", ""),
        "remark": member.remark,
    }
    if result is None:
        return values
    values["reason_codes"] = "; ".join(result.reason_codes)
    values["file"] = row.file
    values["matched_points"] = sum(s.points for s in result.segments)
    measured = sum(s.status == "measured" for s in result.segments)
    values["measured_share"] = f"{measured / len(result.segments):.2f}"
    if result.status != "not_scanned":
        values |= {name: _number(value) for name, value in figures(result).items()}
        values |= _measured_length(result)
    return values


def figures(result: FitResult) -> dict[str, float]:
    """Return the lengths in the table, in the units that their names say."""
    off, tangents = result.moved_m, result.designed_directions
    tangents = np.vstack([tangents, tangents[-1:]])
    along = np.einsum("ki,ki->k", off, tangents)
    across = off - along[:, None] * tangents
    size, band = np.linalg.norm(across, axis=1), band_along(across, result.nodes_covariance_m2)
    k = int(size.argmax())
    middle = len(along) // 2
    along_sd = math.sqrt(max(float(tangents[middle] @ result.nodes_covariance_m2[middle] @ tangents[middle]), 0.0))
    return {
        "max_offset_mm": 1e3 * size[k],
        # A node that is less far out but less well known may be the farthest.
        "max_offset_band95_mm": 1e3 * ((size + band).max() - size[k]),
        "max_offset_at_m": k * result.fitted_element.segment_length_m,
        "start_offset_mm": 1e3 * size[0],
        "start_offset_band95_mm": 1e3 * band[0],
        "end_offset_mm": 1e3 * size[-1],
        "end_offset_band95_mm": 1e3 * band[-1],
        "along_axis_mm": 1e3 * along[middle],
        "along_axis_band95_mm": 1e3 * BAND_95 * along_sd,
        **_shape(result),
        "surface_rmse_mm": 1e3 * result.surface_rmse_m,
        "range_noise_mm": 1e3 * result.range_noise_m,
    }


def _measured_length(result: FitResult) -> dict[str, str]:
    if result.length_m is None or result.length_sd_m is None:
        return {}
    band_mm = 1e3 * BAND_95 * result.length_sd_m
    return {"measured_length_m": f"{result.length_m:.4f}", "measured_length_band95_mm": _number(band_mm)}


def _shape(result: FitResult) -> dict[str, float]:
    """Return the figures against the chord; none for an element that has no chord, such as a ring."""
    try:
        shape = deviations(result)
    except LinearIkError:
        return {}
    return {
        **_figure("bow", shape.bow_m),
        **_figure("sag", shape.sag_m),
        **_figure("sweep", shape.sweep_m),
        **_figure("out_of_plumb", shape.out_of_plumb_m),
    }


def _figure(name: str, figure: Figure) -> dict[str, float]:
    """Return a figure in metres as two columns; NaN where it says nothing."""
    value = math.nan if figure.value is None else 1e3 * figure.value
    band = math.nan if figure.band is None else 1e3 * figure.band
    return {f"{name}_mm": value, f"{name}_band95_mm": band}


def _number(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else ""
