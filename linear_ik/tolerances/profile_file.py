"""Files of tolerances: YAML -> Profile, checked to the last key."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import yaml

from linear_ik.errors import ElementError, ToleranceError
from linear_ik.profile import PROFILES
from linear_ik.strict_yaml import StrictLoader
from linear_ik.tolerances.clause import ANGLES, AppliesTo, Clause, Figure, Profile, Row
from linear_ik.tolerances.formula import Quantity, evaluate

FOLDER = Path(__file__).resolve().parent.parent / "data" / "tolerances"
LARGEST_FILE_BYTES = 256 * 1024  # a hundred times the largest that is shipped
TOP = ("title", "edition", "clauses")
CLAUSE_KEYS = (
    "clause",
    "title",
    "figure",
    "applies_to",
    "classes",
    "profiles",
    "unloaded",
    "limit",
    "lower",
    "unsure_to",
    "verified_by",
    "note",
)
NEEDED = ("clause", "title", "figure", "limit", "verified_by")
ROW, ROW_NEEDED = ("over", "to", "limit", "unsure_to"), ("over", "to", "limit")
IFC_CLASS = re.compile("Ifc[A-Z][A-Za-z0-9]*")
# Any member will do to see whether a formula can be evaluated.
TRIAL = {"L": Quantity(5.0, 1), "h": Quantity(3.0, 1), "D": Quantity(0.3, 1), "B": Quantity(0.2, 1)}


def shipped() -> tuple[str, ...]:
    """Return the names of the files that come with the package."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem != "usibd_loa"))


def shipped_path(name: str) -> Path:
    """Return where a file that comes with the package lies.

    Raises:
        ToleranceError: there is none of that name.
    """
    if name not in shipped():
        raise ToleranceError(name, "no tolerances of that name", "one of " + ", ".join(shipped()))
    return FOLDER / f"{name}.yaml"


def load_tolerances(name: str | os.PathLike[str]) -> Profile:
    """Return the tolerances of a file.

    Args:
        name: one of `shipped()`, or the path of a file of one's own, such as an edited copy.

    Raises:
        ToleranceError: no such file, a key that is missing, unknown or wrong, a formula that cannot be evaluated.
    """
    text = os.fspath(name)
    path = FOLDER / f"{text}.yaml" if text in shipped() else Path(text)
    if not path.exists() and not path.suffix and path.name == text:
        raise ToleranceError(text, "no tolerances of that name", f"a file, or one of {', '.join(shipped())}")
    try:
        return profile_from_mapping(path.stem, read_mapping(path))
    except ToleranceError as error:
        raise ToleranceError(name, _said(error), error.expected) from None


def read_mapping(path: Path) -> Any:
    """Return what a YAML file holds.

    Raises:
        ToleranceError: said of "file": it cannot be read, or is no YAML.
    """
    expected = "a file of tolerances in YAML"
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE_BYTES + 1)
        if len(data) > LARGEST_FILE_BYTES:
            raise ToleranceError("file", f"is larger than {LARGEST_FILE_BYTES // 1024} kB", expected)
        return yaml.load(data.decode("utf-8-sig"), Loader=StrictLoader)
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ToleranceError("file", f"cannot be read: {reason}", expected) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise ToleranceError("file", f"{where}{error.problem or 'not readable'}", expected) from None
    except (yaml.YAMLError, ElementError) as error:
        raise ToleranceError("file", f"is not YAML: {error}", expected) from None


def profile_from_mapping(name: str, mapping: object) -> Profile:
    """Return the tolerances that a file's keys state.

    Raises:
        ToleranceError: said of the key that is wrong (``clauses[0].limit``).
    """
    top = checked("file", mapping, TOP, TOP)
    rows = top["clauses"]
    if not isinstance(rows, list) or not rows:
        raise ToleranceError("clauses", "no list of clauses", "at least one")
    clauses = tuple(_clause(f"clauses[{i}]", row) for i, row in enumerate(rows))
    return Profile(name, said("title", top["title"]), said("edition", top["edition"]), clauses)


def checked(name: str, value: object, keys: tuple[str, ...], needed: tuple[str, ...]) -> Mapping[str, Any]:
    """Return a mapping that has the keys needed and no unknown one."""
    if not isinstance(value, Mapping):
        raise ToleranceError(name, "is no set of keys", "keys: " + ", ".join(keys))
    for key in value:
        if key not in keys:
            raise ToleranceError(name, f"unknown key {str(key)[:60]!r}", "one of " + ", ".join(keys))
    for key in needed:
        if key not in value:
            raise ToleranceError(name, f"key {key} is missing", "needed: " + ", ".join(needed))
    return value


def said(name: str, value: object) -> str:
    """Return a text; a bare number, such as a clause 7.2, is refused because YAML makes 7.20 of it 7.2."""
    if not isinstance(value, str) or not value.strip():
        raise ToleranceError(name, f"{value!r} is no text", "a text, in quotes where it looks like a number")
    return " ".join(value.split())


def length(name: str, value: object) -> str:
    """Return a formula that comes to a length."""
    return _formula(name, value, 1)


def _clause(name: str, value: object) -> Clause:
    data = checked(name, value, CLAUSE_KEYS, NEEDED)
    figure: Any = _one_of(f"{name}.figure", data["figure"], get_args(Figure))
    applies_to: Any = _one_of(f"{name}.applies_to", data.get("applies_to", "any"), get_args(AppliesTo))
    unloaded = data.get("unloaded", False)
    if not isinstance(unloaded, bool):
        raise ToleranceError(f"{name}.unloaded", f"{unloaded!r}", "true or false")
    power = 0 if figure in ANGLES else 1
    limit = data["limit"]
    if isinstance(limit, list):
        limit = tuple(_row(f"{name}.limit[{i}]", row, power) for i, row in enumerate(limit))
        if not limit:
            raise ToleranceError(f"{name}.limit", "an empty list", "rows {over, to, limit}, or a formula")
    elif limit is not None:
        limit = _formula(f"{name}.limit", limit, power)
    verified = data["verified_by"]
    return Clause(
        clause=said(f"{name}.clause", data["clause"]),
        title=said(f"{name}.title", data["title"]),
        figure=figure,
        applies_to=applies_to,
        classes=_kinds(f"{name}.classes", data.get("classes"), IFC_CLASS, "IFC classes, such as [IfcBeam, IfcColumn]"),
        profiles=_kinds(
            f"{name}.profiles", data.get("profiles"), re.compile("|".join(PROFILES)), "of " + ", ".join(PROFILES)
        ),
        unloaded=unloaded,
        limit=limit,
        lower=_optional(name, data, "lower", power),
        unsure_to=_optional(name, data, "unsure_to", power),
        verified_by=None if verified is None else said(f"{name}.verified_by", verified),
        note=said(f"{name}.note", data["note"]) if "note" in data else "",
    )


def _row(name: str, value: object, power: int) -> Row:
    data = checked(name, value, ROW, ROW_NEEDED)
    over, to = (length(f"{name}.{key}", data[key]) for key in ("over", "to"))
    if not evaluate(over, TRIAL).value < evaluate(to, TRIAL).value:
        raise ToleranceError(name, f"over {over} to {to}", "lengths that grow")
    return Row(over, to, _formula(f"{name}.limit", data["limit"], power), _optional(name, data, "unsure_to", power))


def _optional(name: str, data: Mapping[str, Any], key: str, power: int) -> str | None:
    value = data.get(key)
    return None if value is None else _formula(f"{name}.{key}", value, power)


def _formula(name: str, value: object, power: int) -> str:
    text = value if isinstance(value, str) else repr(value)
    try:
        found = evaluate(text, TRIAL)
    except ToleranceError as error:
        raise error.about(name) from None
    if found.power != power:
        raise ToleranceError(
            name, f"{text} is {'no length' if power else 'no angle'}", "such as 3 mm" if power else "such as 0.5 deg"
        )
    return text


def _kinds(name: str, value: object, allowed: re.Pattern[str], expected: str) -> tuple[str, ...]:
    """Return a list of kinds of member; empty where the key is not there."""
    if value is None:
        return ()
    if not isinstance(value, list) or not value:
        raise ToleranceError(name, f"{value!r}", "a list " + expected)
    for one in value:
        if not isinstance(one, str) or not allowed.fullmatch(one):
            raise ToleranceError(name, f"{one!r}", expected)
    return tuple(value)


def _one_of(name: str, value: object, allowed: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in allowed:
        raise ToleranceError(name, f"{value!r}", "one of " + ", ".join(allowed))
    return value


def _said(error: ToleranceError) -> str:
    return error.what if error.subject == "file" else f"{error.subject}: {error.what}"
