"""Options of the verbs that judge: tolerances, and what only the person knows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from linear_ik.cli.process import about_options

if TYPE_CHECKING:
    from linear_ik.result import FitResult
    from linear_ik.tolerances import Conditions, ConditionsOfEach, Profile, Verdict


FIGURES = re.compile(r"-?\d[\d.,]*")


def tolerances_option() -> Any:
    """Return the option that names tolerances."""
    about = "Judge by these limits: a shipped name (see linear-ik tolerances) or a file."
    return typer.Option("--tolerances", metavar="NAME|FILE", help=about)


def loading_state_option() -> Any:
    """Return the option that says how a member was loaded."""
    about = "When it was scanned; limits on imperfection hold unloaded."
    return typer.Option("--loading-state", metavar="unloaded|self_weight|loaded", help=about)


def precamber_option() -> Any:
    """Return the option that says how a beam was cambered."""
    about = "Specified rise of the middle, where the design is drawn without it."
    return typer.Option("--precamber", metavar="METRES", help=about)


def supports_option() -> Any:
    """Return the option that says how a member was held under its own weight."""
    about = "How it was held under its own weight, whose elastic sag is then taken away."
    return typer.Option("--supports", metavar="simple|clamped|cantilever|cantilever_end", help=about)


def material_option() -> Any:
    """Return the option that says what a member is made of."""
    about = "Of the elastic sag: steel (210 GPa, 7850 kg/m3), or E in GPa and kg/m3 with a comma, such as 11,420."
    return typer.Option("--material", metavar="steel|GPA,KG_M3", help=about)


def judged_by(
    tolerances: str | None,
    loading_state: str | None,
    precamber: float | None,
    supports: str | None,
    material: str | None,
) -> tuple[Profile | None, Conditions]:
    """Return the tolerances and conditions that the options name.

    Raises:
        SettingsError, ToleranceError: one of them is wrong.
    """
    from linear_ik.errors import SettingsError
    from linear_ik.tolerances import Conditions, load_tolerances, material_named

    try:
        made_of = None if material is None else material_named(material)
        known = Conditions(loading_state, precamber, supports, made_of)  # type: ignore[arg-type]
    except SettingsError as error:
        raise about_options(error, precamber_m="--precamber") from None
    stated = {
        "--loading-state": loading_state,
        "--precamber": precamber,
        "--supports": supports,
        "--material": material,
    }
    given = next((option for option, value in stated.items() if value is not None), None)
    if tolerances is None and given is not None:
        raise SettingsError(given, "given without --tolerances", "--tolerances NAME")
    return None if tolerances is None else load_tolerances(tolerances), known


def conditions_of_each(path: Path | None, profile: Profile | None, general: Conditions) -> ConditionsOfEach:
    """Return the conditions of a file, those of the options for what it does not say.

    Raises:
        SettingsError: a file without tolerances.
        ToleranceError: it is wrong.
    """
    from linear_ik.errors import SettingsError
    from linear_ik.tolerances import ConditionsOfEach, load_conditions

    if path is None:
        return ConditionsOfEach(general)
    if profile is None:
        raise SettingsError("--conditions", "given without --tolerances", "--tolerances NAME")
    return load_conditions(path, general)


def judge(result: FitResult, profile: Profile | None, known: Conditions) -> tuple[Verdict, ...]:
    """Return the verdicts on a result; none without tolerances."""
    from linear_ik.tolerances import verdicts

    return () if profile is None else verdicts(result, profile, known)


def verdicts_of(judged: tuple[Verdict, ...]) -> dict[str, Any]:
    """Return verdicts as keys of a result's JSON; none where nothing was judged."""
    from linear_ik.tolerances import verdicts_to_mapping

    return {"verdicts": verdicts_to_mapping(judged)} if judged else {}


def describe_verdicts(judged: tuple[Verdict, ...]) -> list[str]:
    """Return what all verdicts come to with the most frequent reason, then a line for each clause that applies."""
    if not judged:
        return []
    from linear_ik.tolerances import overall

    applies = [v for v in judged if v.outcome != "not_applicable"]
    if not applies:
        return [f"{'verdict':<11}no clause of {judged[0].profile} applies: {most_frequent(judged)}"]
    worst = overall(judged)
    why = f": {most_frequent(applies, worst)}" if worst != "pass" else ""
    # Of one clause it has been said.
    said = bool(why) and len(applies) == 1
    each = [f"{v.outcome:<13}{v.title} ({v.profile}, {v.clause})" + ("" if said else f": {v.reason}") for v in applies]
    return [f"{'verdict':<11}{worst}{why}", *each]


def most_frequent(judged: Iterable[Verdict], outcome: str | None = None, called: str = "clauses") -> str:
    """Return the most frequent reason of some verdicts, and of how many it is where there are several.

    Reasons that differ in their figures only count as one; the first of them is said.

    Args:
        judged: the verdicts, at least one.
        outcome: count those only; None: all.
        called: what is counted: of one member clauses, of several verdicts.
    """
    reasons = [v.reason for v in judged if outcome in (None, v.outcome)]
    kinds = Counter(FIGURES.sub("#", reason) for reason in reasons)
    kind, count = kinds.most_common(1)[0]
    said = next(reason for reason in reasons if FIGURES.sub("#", reason) == kind)
    return said if len(reasons) == 1 else f"{said} ({count} of {len(reasons)} {called})"
