"""What `linear-ik check` prints: for a person as lines, for a program as JSON."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from linear_ik.design_model import DesignModel, LeftOut, Member
from linear_ik.scan import no_points

if TYPE_CHECKING:
    from linear_ik.site_check import Coverage, ScanCheck

SCHEMA = "linear_ik/check/1"
UNITS = {1.0: "metres", 0.001: "millimetres", 0.01: "centimetres", 0.3048: "feet", 0.0254: "inches"}
THINNEST_M, THICKEST_M = 0.004, 10.0  # the median of a model's sections
MOST_LINES = 15  # of a list; --json has all of it
_UNIT = re.compile(r"--scan-unit ([\w-]+)")
_SIZES = re.compile(r"[\d.]+(?: x [\d.]+)*")


def design_lines(model: DesignModel) -> list[str]:
    """Return the lines about a model."""
    lines = [_line("design", f"{model.source}: {model.schema}, in {unit_name(model.length_unit_m)}")]
    if model.members:
        low, high = extent_m(model)
        lines.append(_line("extent", _box(low, high)))
    lines += [_line("map", text) for text in _map_lines(model)]
    lines += [_line("note", note) for note in model.notes]
    lines += [_line("WARNING", text) for text in size_warnings(model)]
    lines.append(_line("elements", f"{len(model.members)} to fit"))
    kinds = Counter((m.ifc_class, m.profile_name or "no name", _shape(m)) for m in model.members)
    lines += _table([(str(n), *kind) for kind, n in sorted(kinds.items(), key=lambda one: (one[0][0], -one[1]))])
    remarks = [m for m in model.members if m.remark]
    lines += _listed("remark", [f"{_label(m)}: {m.remark}" for m in remarks])
    lines.append(
        _line(
            "left out", str(len(model.left_out)) if model.left_out else "nothing: all of the linear classes are to fit"
        )
    )
    lines += _table(_reasons(model.left_out))
    if model.obstacles:
        others = Counter(o.ifc_class for o in model.obstacles)
        lines.append(_line("others", ", ".join(f"{n} {name}" for name, n in others.most_common())))
    return lines


def scan_lines(check: ScanCheck) -> list[str]:
    """Return the lines about one scan."""
    if check.stations is None:
        stations = "stations unknown"
    else:
        stations = f"{check.stations} station{'s' if check.stations > 1 else ''}"
    near = int(check.near.sum())
    lines = ["", _line("scan", f"{check.name}: {check.points:,} points, {stations}")]
    if check.left_out:
        lines.append(_line("left out", no_points(check.left_out)))
    unit = next((found[1] for text in check.finding.sentences if (found := _UNIT.search(text))), "")
    lines.append(_line("extent", _box(check.low_m, check.high_m) + (", as if in metres" if unit else "")))
    lines += [_line("WARNING" if check.finding.place != "map" else "place", text) for text in check.finding.sentences]
    if check.finding.place == "model" and not check.finding.sentences:
        lines.append(_line("place", "in the model's coordinates"))
    if check.finding.place == "elsewhere" and unit:
        lines.append(_line("next", f"type the line again with --scan-unit {unit} to see the overlap"))
    if check.finding.place != "elsewhere":
        lines.append(_line("near", f"{near:,} points ({100 * near / check.points:.1f} %) within 50 mm of an element"))
    return lines


def coverage_lines(model: DesignModel, coverage: Sequence[Coverage]) -> list[str]:
    """Return the lines about what all scans show together."""
    covered = [c for c in coverage if c.covered]
    lines = [
        "",
        _line(
            "overlap", f"{len(covered)} of {len(coverage)} elements are covered: at least half of their segments seen"
        ),
    ]
    if not any(c.points for c in coverage):
        lines[1] = _line("overlap", f"none of {len(coverage)} elements, as the scans lie")
    if covered:
        for label, name, of in (("density", "points_per_m", "metre of length"), ("", "points_per_m2", "m2 of surface")):
            lines.append(_line(label, f"points a {of}: {_spread([getattr(c, name) for c in covered])}"))
    missed = [(m, c) for m, c in zip(model.members, coverage, strict=True) if not c.covered]
    if not any(c.points for c in coverage):
        return lines
    missed.sort(key=lambda one: -one[1].seen)
    tags = Counter(_label(m) for m in model.members)
    text = [
        f"{_label(m)}{f' {m.guid}' if tags[_label(m)] > 1 else ''}: "
        f"{c.points:,} points, {100 * c.seen:.0f} % of its length"
        for m, c in missed
    ]
    return lines + _listed("not seen", text)


def to_json(model: DesignModel, checks: Sequence[ScanCheck], coverage: Sequence[Coverage] | None) -> str:
    """Return everything as JSON, schema "linear_ik/check/1"; metres."""
    low, high = extent_m(model) if model.members else (None, None)
    conversion = model.map_conversion
    document: dict[str, Any] = {
        "schema": SCHEMA,
        "design": {
            "source": model.source,
            "ifc_schema": model.schema,
            "length_unit_m": model.length_unit_m,
            "extent_m": None if low is None or high is None else [low.tolist(), high.tolist()],
            "map_conversion": None
            if conversion is None
            else {"crs": conversion.crs, "T_map_model": conversion.T_map_model.tolist()},
            "true_north": None if model.true_north is None else list(model.true_north),
            "notes": [*model.notes, *size_warnings(model)],
            "left_out": [_plain(one, "reason") for one in model.left_out],
            "obstacles": dict(Counter(o.ifc_class for o in model.obstacles)),
        },
        "elements": [_member(m, None if coverage is None else coverage[i]) for i, m in enumerate(model.members)],
        "scans": [_scan(check) for check in checks],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def size_warnings(model: DesignModel) -> list[str]:
    """Return what looks like a wrong unit of the design: sections that no building has."""
    if not model.members:
        return []
    sides = [float(np.ptp(m.element.profile.outline(), axis=0).max()) for m in model.members]
    middle = float(np.median(sides))
    if THINNEST_M <= middle <= THICKEST_M:
        return []
    return [
        f"half of its sections are {'below' if middle < THINNEST_M else 'above'} {middle:.3g} m: is its unit right?"
    ]


def extent_m(model: DesignModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner [3] of the box around the members' axes."""
    ends = [
        m.element.design.nodes_m @ T[:3, :3].T + T[:3, 3]
        for m in model.members
        for T in (m.element.placement.T_world_element,)
    ]
    points = np.concatenate(ends)
    return points.min(axis=0), points.max(axis=0)


def unit_name(unit_m: float) -> str:
    """Return the name of a length unit, or its size in metres."""
    near = next((name for size, name in UNITS.items() if math.isclose(size, unit_m, rel_tol=1e-6)), None)
    return near or f"units of {unit_m:g} m"


def _map_lines(model: DesignModel) -> list[str]:
    lines = []
    conversion = model.map_conversion
    if conversion is None:
        lines.append("no map conversion: scans have to be in the model's coordinates")
    else:
        e, n, h = conversion.T_map_model[:3, 3]
        angle = math.degrees(math.atan2(conversion.T_map_model[1, 0], conversion.T_map_model[0, 0]))
        scale = float(np.hypot(*conversion.T_map_model[:2, 0]))
        where = f"{conversion.crs or 'map of no name'}: origin at E {e:.3f} N {n:.3f} H {h:.3f}"
        lines.append(
            f"{where}, X turned {angle:.3f} degrees from east, a metre of the model is {scale:.6g} m of the map"
        )
    if model.true_north is not None:
        x, y = model.true_north
        left = math.degrees(math.atan2(-x, y))
        where = "along" if abs(left) < 0.005 else f"{abs(left):.2f} degrees {'left' if left > 0 else 'right'} of"
        lines.append(f"true north is {where} the model's Y")
    return lines


def _reasons(left_out: Sequence[LeftOut]) -> list[tuple[str, ...]]:
    """Return the reasons without their figures, how often, and an example."""
    groups: dict[tuple[str, str], list[LeftOut]] = {}
    for one in left_out:
        groups.setdefault((one.ifc_class, _SIZES.sub("#", one.reason)), []).append(one)
    rows = sorted(groups.items(), key=lambda group: -len(group[1]))
    return [(str(len(ones)), name, ones[0].reason, f"such as {_name(ones[0])}") for (name, _), ones in rows]


def _shape(member: Member) -> str:
    element = member.element
    kind = element.profile.type.replace("_", " ")
    return kind + (", tapered" if element.is_tapered else "") + (", curved" if element.axis_points else "")


def _label(member: Member) -> str:
    return " ".join(part for part in (member.tag or member.guid, member.profile_name) if part)


def _name(one: LeftOut) -> str:
    return one.name or one.guid or "one without a name"


def _member(member: Member, coverage: Coverage | None) -> dict[str, Any]:
    found = _plain(member, "tag", "profile_name", "remark")
    element = member.element
    found |= {"profile": element.profile.type, "length_m": element.length_m, "segments": element.segments}
    if coverage is not None:
        found |= {
            "points": coverage.points,
            "points_per_m": coverage.points_per_m,
            "points_per_m2": coverage.points_per_m2,
            "seen": coverage.seen,
            "covered": coverage.covered,
        }
    return found


def _scan(check: ScanCheck) -> dict[str, Any]:
    return {
        "file": check.name,
        "points": check.points,
        "points_left_out": check.left_out,
        "extent_m": [check.low_m.tolist(), check.high_m.tolist()],
        "stations": check.stations,
        "place": check.finding.place,
        "sentences": list(check.finding.sentences),
        "points_near": int(check.near.sum()),
    }


def _plain(one: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(one, name) for name in ("guid", "ifc_class", "name", *names)}


def _spread(values: list[float]) -> str:
    return f"least {min(values):,.0f}, median {float(np.median(values)):,.0f}, most {max(values):,.0f}"


def _box(low: np.ndarray, high: np.ndarray) -> str:
    return ", ".join(f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in zip("xyz", low, high, strict=True)) + " m"


def _listed(label: str, texts: list[str]) -> list[str]:
    lines = [_line(label if i == 0 else "", text) for i, text in enumerate(texts[:MOST_LINES])]
    if len(texts) > MOST_LINES:
        lines.append(_line("", f"and {len(texts) - MOST_LINES} more (--json lists all)"))
    return lines


def _table(rows: list[tuple[str, ...]]) -> list[str]:
    shown = rows[: 2 * MOST_LINES]
    if not shown:
        return []
    widths = [min(max(len(row[k]) for row in shown), 60) for k in range(len(shown[0]))]
    lines = []
    for row in shown:
        cells = [row[0].rjust(widths[0]), *(cell.ljust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        lines.append(_line("", "  ".join(cells).rstrip()))
    if len(rows) > len(shown):
        lines.append(_line("", f"and {len(rows) - len(shown)} more kinds (--json lists all)"))
    return lines


def _line(label: str, text: str) -> str:
    return f"{label:<11}{text}"
