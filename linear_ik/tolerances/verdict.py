"""Verdict: what the deviations of a member say to a limit, with the guard band of ISO 14253-1.

With a figure d, its 95 % half-width U and limits [lower, upper]: pass where all of [d - U, d + U] is
within, fail where all of it is outside, else inconclusive. What is not known makes a verdict
inconclusive as well, and the reason says what it is: a fit that may be wrong, a limit that nobody
verified, a loading state or a precamber that was not stated.

Standards limit imperfections, not elastic deflection. A member under its own weight is judged without
the sag that its supports, its section and its material explain, where the person states them
(`linear_ik.tolerances.unstressed`). Where not, own weight sags a member that is not vertical and does
not sweep it where a principal axis of its section is vertical: only the horizontal part is held
against such a limit, and of other sections (an angle, a beam rolled about its axis) nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from linear_ik.deviation import Deviations, deviations
from linear_ik.deviation_figures import Figure
from linear_ik.elastic_sag import ElasticSag
from linear_ik.errors import ToleranceError
from linear_ik.result import FitResult
from linear_ik.tolerances.clause import ANGLES, Clause, Limits, Profile
from linear_ik.tolerances.conditions import Conditions
from linear_ik.tolerances.formula import Quantity
from linear_ik.tolerances.unstressed import imperfection, not_stated, sag_of, sags_straight_down

Outcome = Literal["pass", "fail", "inconclusive", "not_applicable"]
FIELDS = {"twist": "twist_rad", "slope": "slope_max_rad", "departure": "departure_max_m"}


@dataclass(frozen=True)
class Verdict:
    """One clause, one member. Metres, or radians for twist and slope.

    Attributes:
        profile: name of the file of tolerances.
        standard: its title.
        edition: the one that the file states.
        clause: number or name.
        title: what it limits.
        figure: the deviation that was compared.
        value: of the figure, against the specified shape (with its precamber); where an elastic sag was
            computed for a clause that holds unstressed, without it: the imperfection; None: not known.
        band: half-width of its 95 % band.
        lower: least value allowed; None: not known.
        upper: largest value allowed.
        outcome: pass | fail | inconclusive | not_applicable.
        reason: a plain sentence that says why.
        loading_state: as stated, or "not stated".
        precamber_m: as stated; None: not stated, taken as none.
        verified_by: who read the limit in the standard; None: nobody.
        note: the clause's.
        as_scanned: the figure with the elastic sag in it, where ``value`` is without; else None.
        as_scanned_band: half-width of its 95 % band.
        elastic_sag_m: the largest elastic offset from the chord that was taken away; None: none was.
        elastic_of: for which supports and material.
    """

    profile: str
    standard: str
    edition: str
    clause: str
    title: str
    figure: str
    value: float | None
    band: float | None
    lower: float | None
    upper: float | None
    outcome: Outcome
    reason: str
    loading_state: str
    precamber_m: float | None
    verified_by: str | None
    note: str
    as_scanned: float | None = None
    as_scanned_band: float | None = None
    elastic_sag_m: float | None = None
    elastic_of: str = ""


def verdicts(
    result: FitResult,
    profile: Profile,
    conditions: Conditions | None = None,
    found: Deviations | None = None,
    free: Deviations | None = None,
) -> tuple[Verdict, ...]:
    """Return the verdict on each clause of a profile.

    Args:
        result: of a fit.
        profile: the tolerances.
        conditions: what only the person knows.
        found: the result's deviations with the precamber of the conditions, where the caller has them already.
        free: those without the elastic sag of the conditions, likewise.

    Raises:
        LinearIkError: the member's ends coincide.
    """
    known = conditions or Conditions()
    if result.status == "not_scanned":
        found = None
    elif found is None:
        found = deviations(result, precamber_m=known.precamber_m or 0.0)
    sag = None if found is None else sag_of(result, known)
    if sag is not None and free is None and any(clause.unloaded for clause in profile.clauses):
        free = imperfection(result, sag, known)
    without = None if sag is None or free is None else _Without(sag, free)
    return tuple(_verdict(result, found, profile, clause, known, without) for clause in profile.clauses)


class _Without(NamedTuple):
    """An elastic sag, and what a member is without it."""

    sag: ElasticSag
    free: Deviations


def overall(judged: Iterable[Verdict]) -> Outcome:
    """Return what all verdicts on a member come to: the worst one that applies."""
    outcomes = {v.outcome for v in judged}
    order: tuple[Outcome, ...] = ("fail", "inconclusive", "pass")
    return next((o for o in order if o in outcomes), "not_applicable")


def verdicts_to_mapping(judged: Iterable[Verdict]) -> list[dict[str, Any]]:
    """Return verdicts as JSON's own types."""
    return [asdict(v) for v in judged]


def _verdict(
    result: FitResult,
    found: Deviations | None,
    profile: Profile,
    clause: Clause,
    known: Conditions,
    without: _Without | None,
) -> Verdict:
    scanned = figure = None if found is None else _figure(found, clause.figure)
    sag = without.sag if without is not None and clause.unloaded else None
    if without is not None and clause.unloaded:
        figure = _figure(without.free, clause.figure)
    limits: Limits | None = None
    outcome: Outcome = "inconclusive"
    reason = ""
    try:
        limits = None if clause.limit is None else clause.limits(_names(result))
    except ToleranceError as error:
        # It was evaluated for another member when it was read: this one has no height, say.
        reason = f"the limit cannot be evaluated for this member: {error.what}"
    if not reason:
        outcome, reason = _outcome(result, found, figure, clause, limits, known, sag)
    return Verdict(
        profile=profile.name,
        standard=profile.title,
        edition=profile.edition,
        clause=clause.clause,
        title=clause.title,
        figure=clause.figure,
        value=None if figure is None else figure.value,
        band=None if figure is None else figure.band,
        lower=None if limits is None else limits.lower,
        upper=None if limits is None else limits.upper,
        outcome=outcome,
        reason=reason,
        loading_state=known.loading_state or "not stated",
        precamber_m=known.precamber_m,
        verified_by=clause.verified_by,
        note=clause.note,
        as_scanned=None if sag is None or scanned is None else scanned.value,
        as_scanned_band=None if sag is None or scanned is None else scanned.band,
        elastic_sag_m=None if sag is None else sag.largest_m,
        elastic_of="" if sag is None else sag.said,
    )


def _outcome(
    result: FitResult,
    found: Deviations | None,
    figure: Figure | None,
    clause: Clause,
    limits: Limits | None,
    known: Conditions,
    sag: ElasticSag | None,
) -> tuple[Outcome, str]:
    """Return the outcome and its reason: first whether the clause holds, then what is not known, then the figure."""
    element = result.element
    other = clause.not_for(known.ifc_class, (element.profile.type, element.profile_at(1.0).type))
    if other:
        return "not_applicable", other
    if found is None or figure is None:
        return "inconclusive", "the element was not found in the scan"
    if clause.applies_to != "any" and (clause.applies_to == "vertical") != found.vertical:
        return "not_applicable", f"for members that are {clause.applies_to.replace('_', ' ')} by design"
    if clause.limit is not None and limits is None:
        return "not_applicable", f"no limit for a length of {found.length_m:g} m"
    if clause.figure == "camber" and known.precamber_m == 0.0:
        return "not_applicable", "no precamber is specified"
    if limits is None:
        return "inconclusive", "the file has no limit here yet: fill it in"
    if clause.verified_by is None:
        return "inconclusive", "nobody has verified this limit: read the clause, then name who did in verified_by"
    if figure.value is None or figure.band is None or not math.isfinite(figure.band):
        return "inconclusive", figure.note or "its band is not known"
    if clause.figure == "camber" and known.precamber_m is None:
        return "inconclusive", "the specified precamber is not stated"
    if result.status != "converged" and not result.only_its_place_is_in_doubt:
        return "inconclusive", "; ".join([f"the fit is {result.status.replace('_', ' ')}", *result.reasons[:1]])
    if sag is not None:
        outcome, reason = compare(figure.value, figure.band, limits, clause.figure in ANGLES)
        return outcome, f"without {1e3 * sag.largest_m:.2f} mm of elastic sag ({sag.said}): {reason}"
    if clause.unloaded and known.loading_state != "unloaded":
        return _loaded(result, found, clause, (figure.value, figure.band), limits, known)
    return compare(figure.value, figure.band, limits, clause.figure in ANGLES)


def _loaded(
    result: FitResult,
    found: Deviations,
    clause: Clause,
    figure: tuple[float, float],
    limits: Limits,
    known: Conditions,
) -> tuple[Outcome, str]:
    """Return the outcome of a clause that holds for the unstressed member, which this one is not; of value and band."""
    if known.loading_state is None:
        return "inconclusive", (
            "holds for the unloaded member: the loading state is not stated "
            "(unloaded, or self_weight with supports and material)"
        )
    if known.loading_state == "loaded":
        return "inconclusive", "holds for the unloaded member: it was scanned loaded"
    if not found.vertical and clause.figure in ("bow", "sweep") and not sags_straight_down(result):
        return "inconclusive", (
            "holds for the unloaded member: no principal axis of its section is vertical, so own weight bends it "
            f"sideways too; to have that computed, {not_stated(result, known)}"
        )
    if found.vertical or clause.figure == "sweep":
        # Own weight bends neither.
        return compare(*figure, limits, clause.figure in ANGLES)
    sideways = found.sweep_m
    if clause.figure == "bow" and sideways.value is not None and sideways.band is not None:
        outcome, reason = compare(sideways.value, sideways.band, limits, False)
        if outcome == "fail":
            return outcome, f"its horizontal part alone, which no own weight causes: {reason}"
    return "inconclusive", (
        f"holds for the unloaded member, and own weight sags it; to have that computed, {not_stated(result, known)}"
    )


def compare(value: float, band: float, limits: Limits, angle: bool) -> tuple[Outcome, str]:
    """Return the outcome of the guard band rule, and the sentence."""
    unit, scale = ("deg", math.degrees(1.0)) if angle else ("mm", 1e3)
    low, high = value - band, value + band
    span = f"{scale * low:.2f} to {scale * high:.2f} {unit} (95 %)"
    allowed = f"{scale * limits.upper:.2f} {unit}"
    if not limits.both_ways:
        allowed = f"{scale * limits.lower:.2f} to {allowed}"
    if limits.lower <= low and high <= limits.upper:
        return "pass", f"{span} is within {allowed}"
    if low > limits.widest or high < (-limits.widest if limits.both_ways else limits.lower):
        return "fail", f"{span} is outside {allowed}"
    if low > limits.upper or high < limits.lower:
        return "inconclusive", f"{span} is outside {allowed}, but may be allowed to {scale * limits.widest:.2f} {unit}"
    return "inconclusive", f"{span} crosses the limit of {allowed}"


def _figure(found: Deviations, name: str) -> Figure:
    figure: Figure = getattr(found, FIELDS.get(name, f"{name}_m"))
    return figure


def _names(result: FitResult) -> dict[str, Quantity]:
    """Return what a formula may name: length, height, depth and width of the section."""
    element = result.element
    T, nodes = element.placement.T_world_element, element.design.nodes_m
    height_m = abs(float((nodes[-1] - nodes[0]) @ T[2, :3]))
    width_m, depth_m = np.ptp(element.profile.outline(), axis=0)
    return {
        "L": Quantity(element.length_m, 1),
        "h": Quantity(height_m, 1),
        "D": Quantity(float(depth_m), 1),
        "B": Quantity(float(width_m), 1),
    }
