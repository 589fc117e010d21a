"""A comparison as text: a table to read, CSV and JSON for programs."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from linear_ik.atomic import write_atomically
from linear_ik.common_shift import CommonShift
from linear_ik.compare import Comparison
from linear_ik.deviation_bands import BAND_95
from linear_ik.errors import OutputError
from linear_ik.movement import Movement, Verdict

SCHEMA = "linear_ik/comparison/1"
NODES = {
    "holm": "Sidak over the nodes, Holm over the elements",
    "fdr": "Sidak over the nodes, Benjamini-Hochberg over the elements",
    "none": "Sidak over the nodes, each element by itself",
}
WORDS: dict[Verdict, str] = {
    "moved": "by more than both scans' uncertainty explains",
    "not moved": "a movement that matters would have shown in any direction, all along it",
    "not moved where seen": "none found, but part of it was not scanned, or one along its axis would not have shown",
    "inconclusive": "the scans cannot tell; the line says why",
    "absent in both": "neither scan shows it",
}
LEAST_P = 0.001
COLUMNS = (
    "key", "tag", "ifc_class", "name", "verdict", "largest_m", "largest_band95_m",
    "largest_node", "largest_along_m", "largest_across_m", "largest_x_m", "largest_y_m", "largest_z_m",
    "p_value", "p_adjusted", "status_before", "status_after", "reasons",
    "unseen_along_m", "unseen_across_m", "nodes", "nodes_not_tested",
)  # fmt: skip


def check_table_format(path: str | os.PathLike[str]) -> None:
    """Raise OutputError unless the ending is .csv or .json."""
    if Path(path).suffix.lower() not in (".csv", ".json"):
        raise OutputError(path, f"unknown extension {Path(path).suffix!r}", ".csv or .json")


def write_comparison(comparison: Comparison, path: str | os.PathLike[str]) -> Path:
    """Write a comparison as CSV (one row an element) or JSON (its nodes too), by the file's ending.

    Raises:
        OutputError: another ending, or a file that cannot be written.
    """
    check_table_format(path)
    as_csv = Path(path).suffix.lower() == ".csv"
    return write_atomically(path, comparison_csv(comparison) if as_csv else comparison_json(comparison))


def comparison_csv(comparison: Comparison) -> str:
    """Return one row an element, the most significant first; metres."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for m in comparison.elements:
        row = _row(m)
        writer.writerow(["" if row[c] is None else row[c] for c in COLUMNS])
    return out.getvalue()


def comparison_json(comparison: Comparison) -> str:
    """Return everything, the nodes included; metres, null for what is not known."""
    shift = comparison.shift
    top = {
        "schema": SCHEMA,
        "level": comparison.level,
        "correction": NODES[comparison.correction],
        "shift_removed": comparison.shift_removed,
        "shift": None
        if shift is None
        else {
            "translation_m": shift.translation_m.tolist(),
            "rotation_rad": shift.rotation_rad.tolist(),
            "centre_m": shift.centre_m.tolist(),
            "covariance": shift.covariance.tolist(),
            "elements": shift.elements,
            "share": shift.share,
            "p_value": shift.p_value,
        },
    }
    lines = [f"{json.dumps(k)}: {json.dumps(v, allow_nan=False)}" for k, v in top.items()]
    rows = ",\n  ".join(
        json.dumps(_row(m) | _nodes(m), ensure_ascii=False, allow_nan=False) for m in comparison.elements
    )
    return "{\n" + ",\n".join(lines) + f',\n"elements": [\n  {rows}\n]\n' + "}\n"


def comparison_lines(comparison: Comparison, most: int | None = None) -> list[str]:
    """Return a table of the elements, the most significant first, and what it stands on."""
    counts = Counter(m.verdict for m in comparison.elements)
    total = len(comparison.elements)
    always: tuple[Verdict, ...] = ("moved", "not moved", "inconclusive")
    said = [(word, counts[word]) for word in WORDS if counts[word] or word in always]
    (_, moved), *others = said
    lines = [
        ", ".join([f"{moved} of {total} moved", *(f"{count} {word}" for word, count in others)]),
        *(f"  {word}: {WORDS[word]}" for word, count in said if count),
        f"level {100 * comparison.level:g} %: {NODES[comparison.correction]}",
        _shift_line(comparison.shift, comparison.shift_removed),
        "",
    ]
    shown = comparison.elements[:most]
    first = max(len(v) for v in ("inconclusive", *(m.verdict for m in shown)))
    labels = _labels(comparison.elements)[:most]
    width = max([7, *map(len, labels)])
    lines.append(
        f"{'verdict':<{first}}  {'element':<{width}}  {'largest mm':>17}  {'along':>7}  {'across':>7}  {'p':>8}"
    )
    for m, label in zip(shown, labels, strict=True):
        if m.tested:
            k = m.largest
            figures = (
                f"{1000 * m.largest_m:7.2f} +- {1000 * m.largest_band_m:6.2f}  {1000 * m.along_m[k]:7.2f}  "
                f"{1000 * m.across_m[k]:7.2f}  {_p(m.p_adjusted):>8}"
            )
        else:
            figures = f"{'-':>17}  {'-':>7}  {'-':>7}  {'-':>8}"
        why = "  " + " ".join([*m.limits, *m.reasons]) if m.limits or m.reasons else ""
        lines.append(f"{m.verdict:<{first}}  {label:<{width}}  {figures}{why}")
    if len(shown) < total:
        lines.append(f"... and {total - len(shown)} more")
    return lines


def _shift_line(shift: CommonShift | None, removed: bool) -> str:
    if shift is None:
        return "common shift: not known of fewer than three elements"
    millimetres, sigma = 1000 * shift.translation_m, 1000 * np.sqrt(np.diag(shift.covariance)[:3])
    parts = ", ".join(
        f"{axis} {v:.2f} +- {BAND_95 * s:.2f}" for axis, v, s in zip("xyz", millimetres, sigma, strict=True)
    )
    turned = f", turned by {math.degrees(float(np.linalg.norm(shift.rotation_rad))):.4f} degrees"
    text = f"common shift: {parts} mm{turned}; {100 * shift.share:.0f} % of {shift.elements} elements follow it"
    if removed:
        return text + "; taken out of the figures below"
    advice = " (registration? --remove-shift takes it out)" if shift.p_value < 0.01 else ""
    return text + "; not taken out" + advice


def _labels(elements: tuple[Movement, ...]) -> list[str]:
    """Return each element's tag and name, with the GlobalId where that is not enough to tell them apart."""
    short = [" ".join(part for part in (m.tag, m.name if m.name != m.tag else "") if part) for m in elements]
    often = Counter(short)
    return [
        label
        if m.tag and often[label] == 1
        else " ".join(part for part in (label if label != m.key else "", m.key) if part)
        for m, label in zip(elements, short, strict=True)
    ]


def _p(p: float) -> str:
    return f"<{LEAST_P:g}" if p < LEAST_P else f"{p:.2g}"


def _row(m: Movement) -> dict[str, Any]:
    k = m.largest if m.tested else 0
    x, y, z = (float(v) for v in m.displacement_m[k]) if m.tested else (math.nan,) * 3
    row: dict[str, Any] = {
        "key": m.key,
        "tag": m.tag,
        "ifc_class": m.ifc_class,
        "name": m.name,
        "verdict": m.verdict,
        "largest_m": m.largest_m,
        "largest_band95_m": m.largest_band_m,
        "largest_node": k if m.tested else None,
        "largest_along_m": float(m.along_m[k]) if m.tested else None,
        "largest_across_m": float(m.across_m[k]) if m.tested else None,
        "largest_x_m": x,
        "largest_y_m": y,
        "largest_z_m": z,
        "p_value": m.p_value,
        "p_adjusted": m.p_adjusted,
        "status_before": m.statuses[0],
        "status_after": m.statuses[1],
        "reasons": " ".join(m.reasons),
        "unseen_along_m": m.along_band_m,
        "unseen_across_m": m.across_band_m,
        "nodes": len(m.seen),
        "nodes_not_tested": m.not_tested if m.tested else len(m.seen),
    }
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in row.items()}


def _nodes(m: Movement) -> dict[str, Any]:
    return {
        "seen": m.seen.tolist(),
        "nodes_m": m.nodes_m.tolist(),
        "displacement_m": m.displacement_m.tolist(),
        "covariance_m2": m.covariance_m2.tolist(),
        "along_m": m.along_m.tolist(),
        "across_m": m.across_m.tolist(),
        "p_nodes": m.p_nodes.tolist(),
    }
