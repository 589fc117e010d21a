"""Element files: YAML or JSON -> Element, checked to the last key."""

from __future__ import annotations

import difflib
import json
import os
import re
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, NoReturn

import yaml

from linear_ik.design_axis import check_axis_points, polyline_length_m
from linear_ik.element import Element, Placement, PlacementTolerance
from linear_ik.errors import ElementError
from linear_ik.profile import PROFILES, Polygon, Profile
from linear_ik.section_names import section
from linear_ik.strict_yaml import NUMBER, StrictLoader, unique_keys, whole_number

LARGEST_FILE_BYTES = 256 * 1024  # a polygon of 1000 corners takes 100 kB

AUTO = "auto"  # segments as many as the scan asks for

# Key in the file -> field of Element, where they differ.
_RENAMED = {"length": "length_m"}
_KEY_OF = {field: key for key, field in _RENAMED.items()}
_KEYS = tuple(_KEY_OF.get(f.name, f.name) for f in fields(Element) if f.name != "auto_segments")
_NEEDED = ("name", "profile", "length")
_PLACEMENT_KEYS = tuple(f.name for f in fields(Placement))
_TOLERANCE_KEYS = tuple(f.name for f in fields(PlacementTolerance))


def load_element(path: str | os.PathLike[str]) -> Element:
    """Read an element file.

    Args:
        path: YAML 1.2 or JSON, UTF-8, metres and degrees.

    Raises:
        ElementError: said of the file, naming the key and the value that is wrong.
    """
    try:
        return element_from_mapping(_parse(_read(Path(path))))
    except ElementError as error:
        what = error.what if error.subject == "element" else f"{error.subject}: {error.what}"
        raise ElementError(path, what, error.expected) from None


def element_from_mapping(mapping: Mapping[str, Any]) -> Element:
    """Return the element that an element file's keys describe.

    Raises:
        ElementError: said of the key that is wrong (``profile.x_dim``), or of "element".
    """
    # An axis has a length of its own.
    needed = ("name", "profile") if isinstance(mapping, Mapping) and "axis_points" in mapping else _NEEDED
    data = _mapping("element", mapping, _KEYS, needed)
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key == "segments" and value == AUTO:
            values["auto_segments"] = True
            continue
        values[_RENAMED.get(key, key)] = _READERS.get(key, _number)(key, value)
    if "length_m" not in values:
        values["length_m"] = polyline_length_m(check_axis_points(values["axis_points"]))
    try:
        return Element(**values)
    except ElementError as error:
        raise error.about(_KEY_OF.get(error.subject, error.subject)) from None


def element_to_mapping(element: Element) -> dict[str, Any]:
    """Return the keys of an element file that describes ``element``, as plain values.

    `element_from_mapping` makes an equal element of them.
    """
    x, y, z = (float(limit) for limit in element.joint_limit_deg)  # type: ignore[union-attr]
    placement = element.placement
    where = {"location": list(placement.location), "axis": list(placement.axis)}
    if placement.ref_direction is not None:
        where["ref_direction"] = list(placement.ref_direction)
    return {
        "name": element.name,
        "profile": profile_to_mapping(element.profile),
        "length": element.length_m,
        "segments": AUTO if element.auto_segments else element.segments,
        "placement": where,
        "start": element.start,
        "end": element.end,
        "joint_limit_deg": x if x == y == z else [x, y, z],
        "placement_tolerance": {key: getattr(element.placement_tolerance, key) for key in _TOLERANCE_KEYS},
        "end_tolerance_m": element.end_tolerance_m,
        "density_kg_m3": element.density_kg_m3,
        **({} if element.profile_end is None else {"profile_end": profile_to_mapping(element.profile_end)}),
        **({} if element.axis_points is None else {"axis_points": [list(point) for point in element.axis_points]}),
        **({"length_tolerance_m": element.length_tolerance_m} if element.length_tolerance_m else {}),
    }


def profile_to_mapping(profile: Profile) -> dict[str, Any]:
    """Return the keys of a profile: its type and dimensions."""
    if isinstance(profile, Polygon):
        return {"type": profile.type, "outline": [list(corner) for corner in profile.corners]}
    return {"type": profile.type, **{f.name: getattr(profile, f.name) for f in fields(profile)}}


def _read(path: Path) -> str:
    expected = "an element file in YAML or JSON"
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE_BYTES + 1)
    except FileNotFoundError:
        raise ElementError("element", "no such file", expected) from None
    except IsADirectoryError:
        raise ElementError("element", "is a folder", expected) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ElementError("element", f"cannot be read: {reason}", expected) from None
    if len(data) > LARGEST_FILE_BYTES:
        raise ElementError("element", f"is larger than {LARGEST_FILE_BYTES // 1024} kB", expected)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ElementError("element", f"is not text: byte {error.start} is not UTF-8", expected) from None
    if not text.strip():
        raise ElementError("element", "is empty", expected)
    return text


def _parse(text: str) -> Any:
    try:
        # YAML nearly contains JSON, but not its tabs.
        if text.lstrip().startswith("{"):
            try:
                return json.loads(text, object_pairs_hook=unique_keys, parse_int=whole_number)
            except json.JSONDecodeError:
                pass
        return yaml.load(text, Loader=StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        what = error.problem or error.context or "not readable"
        raise ElementError("element", f"{where}{what}", "an element file in YAML or JSON") from None
    except yaml.YAMLError as error:
        raise ElementError("element", f"is not YAML: {error}", "an element file in YAML or JSON") from None
    except RecursionError:
        raise ElementError("element", "is nested too deeply", "keys and values as in the contract") from None


def _mapping(name: str, value: object, keys: tuple[str, ...], required: tuple[str, ...] = ()) -> Mapping[str, Any]:
    inside = "" if name == "element" else f"{name}."
    if not isinstance(value, Mapping):
        raise ElementError(name, f"{reprlib.repr(value)} is not a set of keys", "keys: " + ", ".join(keys))
    for key in value:
        if not isinstance(key, str) or key not in keys:
            raise ElementError(f"{inside}{_bare(key)}", "unknown key", _nearest(key, keys))
    for key in required:
        if key not in value:
            raise ElementError(name, f"key {key} is missing", "needed: " + ", ".join(required))
    return value


def _profile(name: str, value: object) -> Profile:
    types = tuple(PROFILES)
    if isinstance(value, str) and value not in PROFILES:
        try:
            return section(value)
        except ElementError as error:
            raise error.about(name) from None
    if not isinstance(value, Mapping):
        raise ElementError(
            name, f"{reprlib.repr(value)} is not a set of keys", "type and dimensions, or a section's name"
        )
    if "type" not in value:
        raise ElementError(name, "key type is missing", "one of " + ", ".join(types))
    kind = value["type"]
    if not isinstance(kind, str) or kind not in PROFILES:
        raise ElementError(f"{name}.type", f"unknown profile {_bare(kind)}", _nearest(kind, types))
    cls = PROFILES[kind]
    if cls is Polygon:
        return _within(name, Polygon, {"outline": _mapping(name, value, ("type", "outline"), ("outline",))["outline"]})
    dimensions = tuple(f.name for f in fields(cls))
    needed = tuple(f.name for f in fields(cls) if f.default is MISSING)
    data = _mapping(name, value, ("type", *dimensions), needed)
    return _within(name, cls, {key: _number(f"{name}.{key}", data[key]) for key in dimensions if key in data})


def _placement(name: str, value: object) -> Placement:
    data = _mapping(name, value, _PLACEMENT_KEYS)
    return Placement(**{key: _vector(f"{name}.{key}", v) for key, v in data.items()})


def _tolerance(name: str, value: object) -> PlacementTolerance:
    data = _mapping(name, value, _TOLERANCE_KEYS)
    return PlacementTolerance(**{key: _number(f"{name}.{key}", v) for key, v in data.items()})


def _text(name: str, value: object) -> str:
    if isinstance(value, str) and value not in PROFILES:
        return value
    hint = f'; put it in quotes: "{value}"' if isinstance(value, (int, float)) else ""
    _fail(name, value, "text", f"text{hint}")


def _segments(name: str, value: object) -> object:
    if isinstance(value, str) and re.fullmatch(NUMBER, value.strip()) is None:
        _fail(name, value, "a number", "a whole number, or auto")
    # 10.0 is how some writers say 10.
    number = _number(name, value)
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        quoted = isinstance(value, str) and re.fullmatch(NUMBER, value.strip()) is not None
        _fail(name, value, "a number", "a number without quotes" if quoted else "a number")
    return value


def _vector(name: str, value: object, expected: str = "three numbers [x, y, z]") -> tuple[float, float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        _fail(name, value, "a list of three", expected)
    x, y, z = (_number(name, v) for v in value)
    return x, y, z


def _points(name: str, value: object) -> object:
    if not isinstance(value, (list, tuple)):
        _fail(name, value, "a list of points", "points [x, y, z] in metres, the first [0, 0, 0]")
    return tuple(_vector(f"{name}[{i}]", point) for i, point in enumerate(value))


def _limits(name: str, value: object) -> object:
    if isinstance(value, (list, tuple)):
        return _vector(name, value, "one number, or three: [x, y, z]")
    return _number(name, value)


_READERS: dict[str, Callable[[str, object], object]] = {
    "name": _text,
    "profile": _profile,
    "profile_end": _profile,
    "segments": _segments,
    "placement": _placement,
    "start": _text,
    "end": _text,
    "joint_limit_deg": _limits,
    "placement_tolerance": _tolerance,
    "axis_points": _points,
}


def _within(name: str, cls: Callable[..., Profile], values: dict[str, Any]) -> Profile:
    try:
        return cls(**values)
    except ElementError as error:
        raise error.about(f"{name}.{error.subject}") from None


def _fail(name: str, value: object, kind: str, expected: str) -> NoReturn:
    what = "has no value" if value is None else f"{reprlib.repr(value)} is not {kind}"
    raise ElementError(name, what, expected)


def _nearest(value: object, choices: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(str(value)[:80].lower(), choices, n=1, cutoff=0.7)
    return f"did you mean {near[0]}?" if near else "one of " + ", ".join(choices)


def _bare(value: object) -> str:
    """Return a key or type as it stands in the file, if it looks like one."""
    return value if isinstance(value, str) and value.isidentifier() and len(value) <= 60 else reprlib.repr(value)
