"""Conditions: what only the person knows of a member, loading state and precamber, for all or for each."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal, get_args

from linear_ik.errors import SettingsError, ToleranceError
from linear_ik.tolerances.profile_file import checked, read_mapping

LoadingState = Literal["unloaded", "self_weight", "loaded"]
MOST_PRECAMBER_M = 1.0
TOP = ("default", "elements")


@dataclass(frozen=True)
class Conditions:
    """What only the person knows.

    Attributes:
        loading_state: when it was scanned: unloaded, under its own weight only, or loaded; None: not stated.
        precamber_m: specified rise of the middle, where the design is drawn without; None: not stated.

    Raises:
        SettingsError: another state, a precamber that is no length.
    """

    loading_state: LoadingState | None = None
    precamber_m: float | None = None

    def __post_init__(self) -> None:
        """Check both."""
        state, precamber = self.loading_state, self.precamber_m
        if state is not None and state not in get_args(LoadingState):
            raise SettingsError("loading_state", f"{state!r}", "one of " + ", ".join(get_args(LoadingState)))
        if precamber is None:
            return
        number = isinstance(precamber, (int, float)) and not isinstance(precamber, bool)
        if not number or not abs(precamber) <= MOST_PRECAMBER_M:
            raise SettingsError("precamber_m", f"{precamber!r}", f"metres, at most {MOST_PRECAMBER_M:g}")


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
    data = checked(name, value, KEYS, ())
    try:
        return Conditions(
            data.get("loading_state", default.loading_state), data.get("precamber_m", default.precamber_m)
        )
    except SettingsError as error:
        raise ToleranceError(f"{name}.{error.subject}", error.what, error.expected) from None
