"""Tables as Markdown, CSV and JSON, and the places in a document that scripts fill in."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]


def write_table(
    stem: Path, rows: Sequence[Row], notes: Sequence[str] = (), brief: Sequence[Row] | None = None, **about: object
) -> list[Path]:
    """Write rows as ``stem``.md, .csv and .json, and return the paths.

    Args:
        stem: path without its ending.
        rows: the same keys in each; a key is a column's heading.
        notes: sentences below the table.
        brief: rows for the Markdown, where a person needs fewer columns.
        about: what else the JSON says.
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    out = [stem.with_name(stem.name + ending) for ending in (".md", ".csv", ".json")]
    text = markdown(brief or rows)
    if notes:
        text += "\n" + "".join(f"- {note}\n" for note in notes)
    out[0].write_text(text, encoding="utf-8")
    table = io.StringIO()
    writer = csv.DictWriter(table, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: _plain(v) for k, v in row.items()} for row in rows)
    out[1].write_text(table.getvalue(), encoding="utf-8")
    mapping = {**about, "machine": machine(), "notes": list(notes), "rows": [dict(row) for row in rows]}
    out[2].write_text(json.dumps(_finite(mapping), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return out


def markdown(rows: Sequence[Row]) -> str:
    """Return rows as a Markdown table; numbers with three digits."""
    headings = list(rows[0])
    lines = ["| " + " | ".join(headings) + " |"]
    right = [any(isinstance(row[h], (int, float)) for row in rows) for h in headings]
    lines.append("|" + "|".join("---:" if r else "---" for r in right) + "|")
    lines += ["| " + " | ".join(shown(row[h]) for h in headings) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def shown(value: object) -> str:
    """Return a value as a person reads it: three digits, "-" for none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value).replace("|", "\\|")
    if isinstance(value, int) or value == 0 or not math.isfinite(value):
        return str(value)
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    text = f"{value:.{digits}f}" if digits <= 6 else f"{value:.2g}"
    return text


def fill_in(document: Path, name: str, text: str) -> None:
    """Replace what stands between ``<!-- name -->`` and ``<!-- /name -->`` in a document.

    Raises:
        ValueError: the document has no such place.
    """
    whole = document.read_text(encoding="utf-8")
    opening, closing = f"<!-- {name} -->", f"<!-- /{name} -->"
    before, found, rest = whole.partition(opening)
    _, closed, after = rest.partition(closing)
    if not (found and closed):
        raise ValueError(f"{document}: no {opening} ... {closing}")
    document.write_text(f"{before}{opening}\n\n{text.strip()}\n\n{closing}{after}", encoding="utf-8")


def machine() -> dict[str, str]:
    """Return what the figures were made with."""
    versions = {}
    for package in ("linear_ik", "pin", "open3d-cpu", "open3d", "osqp", "numpy"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {"system": platform.platform(), "python": platform.python_version(), **versions}


def _plain(value: object) -> object:
    return "" if isinstance(value, float) and math.isnan(value) else value


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return value
