"""Conditions: what only the person knows of a member: loading state, precamber, supports, material and class."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Literal, get_args

from linear_ik.elastic_sag import MATERIALS, SHARE_95, Material, Supports
from linear_ik.errors import SettingsError, ToleranceError
from linear_ik.tolerances.profile_file import IFC_CLASS, checked, read_mapping, said

LoadingState = Literal["unloaded", "self_weight", "loaded"]
MOST_PRECAMBER_M = 1.0  # more is a length in millimetres
TOP = ("default", "elements")
MATERIAL_KEYS = ("elastic_modulus_gpa", "density_kg_m3", "name", "source")


@dataclass(frozen=True)
class Conditions:
    """What only the person knows.

    Attributes:
        loading_state: when it was scanned: unloaded, under its own weight only, or loaded; None: not stated.
        precamber_m: specified rise of the middle, where the design is drawn without; None: not stated.
        supports: how it was held when it was scanned under its own weight; None: not stated.
        material: what it is made of; None: not stated.
        sag_share95: half-width of the 95 % band of the elastic sag that these make, as a share of it.
        ifc_class: such as IfcBeam, for clauses that are for some classes only; None: not stated.

    Raises:
        SettingsError: another state, other supports, a precamber that is no length, no such share, no IFC class.
    """

    loading_state: LoadingState | None = None
    precamber_m: float | None = None
    supports: Supports | None = None
    material: Material | None = None
    sag_share95: float = SHARE_95
    ifc_class: str | None = None

    def __post_init__(self) -> None:
        """Check all of them."""
        for name, allowed in (("loading_state", get_args(LoadingState)), ("supports", get_args(Supports))):
            value = getattr(self, name)
            if value is not None and value not in allowed:
                raise SettingsError(name, f"{value!r}", "one of " + ", ".join(allowed))
        if self.precamber_m is not None and not abs(_number(self.precamber_m)) <= MOST_PRECAMBER_M:
            raise SettingsError("precamber_m", f"{self.precamber_m!r}", f"metres, at most {MOST_PRECAMBER_M:g}")
        if self.material is not None and not isinstance(self.material, Material):
            raise SettingsError("material", f"{self.material!r}", "a Material, such as MATERIALS['steel']")
        if not 0.0 <= _number(self.sag_share95) <= 1.0:
            raise SettingsError("sag_share95", f"{self.sag_share95!r}", "a share, 0 to 1")
        named = self.ifc_class is None or (isinstance(self.ifc_class, str) and IFC_CLASS.fullmatch(self.ifc_class))
        if not named:
            raise SettingsError("ifc_class", f"{self.ifc_class!r}", "a class of IFC, such as IfcBeam")


def material_named(name: str) -> Material:
    """Return a material by its name, or by its figures: ``E_GPA,KG_M3``.

    Raises:
        SettingsError: neither.
    """
    expected = f"one of {', '.join(MATERIALS)}, or E in GPa and kg/m3 with a comma between, such as 11,420"
    if name in MATERIALS:
        return MATERIALS[name]
    try:
        modulus, density = (float(part) for part in name.split(","))
        return Material(modulus, density, source="as stated")
    except (ValueError, SettingsError):
        raise SettingsError("material", f"{name!r}", expected) from None


KEYS = tuple(f.name for f in fields(Conditions))


@dataclass(frozen=True)
class ConditionsOfEach:
    """Conditions of the members of a run.

    Attributes:
        default: of those that are not named.
        named: by GlobalId, tag or name.
    """

    default: Conditions = field(default_factory=Conditions)
    named: Mapping[str, Conditions] = field(default_factory=dict)

    def of(self, *names: str) -> Conditions:
        """Return the conditions under the first of a member's names that is there."""
        return next((self.named[name] for name in names if name in self.named), self.default)


def load_conditions(path: str | os.PathLike[str], default: Conditions | None = None) -> ConditionsOfEach:
    """Return the conditions that a file states: ``default``, and ``elements`` by GlobalId, tag or name.

    What an element's own keys leave out is as in the default.

    Args:
        path: of the YAML file.
        default: where the file states none.

    Raises:
        ToleranceError: said of the file: it cannot be read, or a key is unknown or wrong.
    """
    try:
        top = checked("file", read_mapping(Path(path)), TOP, ())
        general = _conditions("default", top.get("default", {}), default or Conditions())
        elements = top.get("elements", {})
        if not isinstance(elements, Mapping):
            raise ToleranceError("elements", "is no set of keys", "GlobalId, tag or name: {" + ", ".join(KEYS) + "}")
        named = {str(name): _conditions(f"elements.{name}", row, general) for name, row in elements.items()}
    except ToleranceError as error:
        what = error.what if error.subject == "file" else f"{error.subject}: {error.what}"
        raise ToleranceError(path, what, error.expected.replace("of tolerances", "of conditions")) from None
    return ConditionsOfEach(general, named)


def _conditions(name: str, value: object, default: Conditions) -> Conditions:
    data = dict(checked(name, value, KEYS, ()))
    try:
        if data.get("material") is not None:
            data["material"] = _material(f"{name}.material", data["material"])
        return replace(default, **data)
    except SettingsError as error:
        raise ToleranceError(f"{name}.{error.subject}", error.what, error.expected) from None


def _material(name: str, value: object) -> Material:
    if isinstance(value, str):
        return material_named(value)
    data = checked(name, value, MATERIAL_KEYS, MATERIAL_KEYS[:2])
    texts = {key: said(f"{name}.{key}", data[key]) for key in MATERIAL_KEYS[2:] if key in data}
    return Material(data["elastic_modulus_gpa"], data["density_kg_m3"], **texts)


def _number(value: object) -> float:
    """Return a number, NaN where it is none."""
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
