"""Clause: one limit of a standard, as a file of tolerances states it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from linear_ik.tolerances.formula import Quantity, evaluate

AppliesTo = Literal["any", "vertical", "not_vertical"]
Figure = Literal[
    "bow",
    "sag",
    "sweep",
    "camber",
    "out_of_plumb",
    "twist",
    "end_displacement",
    "departure",
    "slope",
    "length_change",
]
ANGLES = ("twist", "slope")


class Limits(NamedTuple):
    """What a clause allows one member, metres or radians.

    Attributes:
        lower: least value.
        upper: largest value.
        widest: largest value by the widest reading of a clause that was not read to its end; else ``upper``.
        both_ways: whether ``lower`` is the negative of ``upper``.
    """

    lower: float
    upper: float
    widest: float
    both_ways: bool


@dataclass(frozen=True)
class Row:
    """A limit for some lengths.

    Attributes:
        over: formula of the length that is just too short.
        to: formula of the longest.
        limit: formula.
        unsure_to: formula, see `Clause`; None: as the limit.
    """

    over: str
    to: str
    limit: str
    unsure_to: str | None = None


@dataclass(frozen=True)
class Clause:
    """A limit, and whom and when it holds for.

    Attributes:
        clause: its number or name in the standard.
        title: what it limits, in plain words.
        figure: the deviation that is compared: see `linear_ik.deviation.Deviations`.
        applies_to: members near the vertical by design, all others, or any.
        classes: IFC classes that it is for; empty: all. A member whose class nobody stated may be of any.
        profiles: types of section that it is for, as in element files; empty: all.
        unloaded: whether it holds for the unstressed member only.
        limit: formula of the largest size, rows by length, or None where the file has none yet.
        lower: formula of the least value; None: as far below 0 as the limit is above.
        unsure_to: formula of the limit by the widest reading, where it is not known which one is
            right: between the two nothing fails. None: as the limit; rows have their own.
        verified_by: who read the figure in the standard; None: nobody.
        note: what a reader should know; may be empty.
    """

    clause: str
    title: str
    figure: Figure
    applies_to: AppliesTo = "any"
    classes: tuple[str, ...] = ()
    profiles: tuple[str, ...] = ()
    unloaded: bool = False
    limit: str | tuple[Row, ...] | None = None
    lower: str | None = None
    unsure_to: str | None = None
    verified_by: str | None = None
    note: str = ""

    def not_for(self, ifc_class: str | None, profiles: tuple[str, ...]) -> str:
        """Return why the clause is not for a member of this kind, in words; empty where it is.

        Args:
            ifc_class: such as IfcBeam; None: not stated.
            profiles: types of its section, at its start and its end.
        """
        if self.classes and ifc_class and plain_class(ifc_class) not in map(plain_class, self.classes):
            return f"for {', '.join(self.classes)}: this is an {ifc_class}"
        other = next((kind for kind in profiles if self.profiles and kind not in self.profiles), None)
        if other is not None:
            said = ", ".join(kind.replace("_", " ") for kind in self.profiles)
            return f"for sections {said}: this is a {other.replace('_', ' ')}"
        return ""

    def limits(self, names: dict[str, Quantity]) -> Limits | None:
        """Return what is allowed; None: no row for that length, or no limit at all.

        Raises:
            ToleranceError: a formula that cannot be evaluated.
        """
        if self.limit is None:
            return None
        formula: str | None = None
        unsure_to = self.unsure_to
        if isinstance(self.limit, str):
            formula = self.limit
        else:
            L = names["L"].value
            for row in self.limit:
                over, to = (evaluate(text, names).value for text in (row.over, row.to))
                if over < L <= to + 1e-9:
                    formula, unsure_to = row.limit, row.unsure_to
                    break
        if formula is None:
            return None
        upper = evaluate(formula, names).value
        widest = upper if unsure_to is None else max(upper, evaluate(unsure_to, names).value)
        lower = -upper if self.lower is None else evaluate(self.lower, names).value
        return Limits(lower, upper, widest, self.lower is None)


def plain_class(ifc_class: str) -> str:
    """Return an IFC class in lower case, standard cases (IfcBeamStandardCase) as what they are cases of."""
    return ifc_class.lower().removesuffix("standardcase")


@dataclass(frozen=True)
class Profile:
    """A file of tolerances.

    Attributes:
        name: of the file.
        title: the standard.
        edition: the one that was read.
        clauses: in the file's order.
    """

    name: str
    title: str
    edition: str
    clauses: tuple[Clause, ...]
