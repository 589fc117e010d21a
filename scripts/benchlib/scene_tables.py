"""Tables of the scenes: what succeeds, what is claimed, what was doubted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from benchlib import gate
from benchlib.scene_fits import RANDOM, SceneOutcome

COLUMNS = ("profile", "bends", "stations", "stations named", "clutter", "faces", "start", "noise", "stands")
WANTED_SUCCESS, WANTED_COVERED = 99.0, 90.0


def random_rows(outcomes: Sequence[SceneOutcome]) -> list[dict[str, Any]]:
    """Return the shares over all random scenes that show every bend, then over each kind of them, and the others."""
    shown = [o for o in outcomes if o.observable]
    rows = [row("every bend shown", shown)]
    for column in COLUMNS:
        values = sorted({o.labels[column] for o in shown})
        rows += [row(f"{column}: {value}", [o for o in shown if o.labels[column] == value]) for value in values]
    hidden = [o for o in outcomes if not o.observable]
    return [*rows, *([row("bends that the scan does not show", hidden)] if hidden else [])]


def row(name: str, outcomes: Sequence[SceneOutcome]) -> dict[str, Any]:
    """Return the figures of some fits."""
    failed = [o for o in outcomes if not o.succeeded]
    return {
        "scenes": name,
        "fits": len(outcomes),
        "succeed %": percent(o.succeeded for o in outcomes),
        "worst node, median mm": float(np.median([o.across_mm for o in outcomes])),
        "worst node, worst mm": max(o.across_mm for o in outcomes),
        "converged yet wrong": sum(o.claimed_wrong for o in outcomes),
        "failures that say so %": percent(o.honest for o in failed),
        "successes that doubt %": percent(o.status != "converged" for o in outcomes if o.succeeded),
        "nodes inside 95 %": percent(i for o in outcomes for i in o.inside),
        "median time s": float(np.median([o.time_s for o in outcomes])),
    }


def case_row(name: str, outcomes: Sequence[SceneOutcome]) -> dict[str, Any]:
    """Return the figures of one named case over its seeds."""
    return {
        "case": name,
        "seeds": len(outcomes),
        "worst node, worst mm": max(o.across_mm for o in outcomes),
        "median mm": float(np.median([o.across_mm for o in outcomes])),
        "bound, median mm": float(np.median([o.bound_across_mm for o in outcomes])),
        "within its limit %": percent(o.succeeded for o in outcomes),
        "converged": sum(o.status == "converged" for o in outcomes),
        "converged yet wrong": sum(o.claimed_wrong for o in outcomes),
        "nodes inside 95 %": percent(i for o in outcomes for i in o.inside),
        "median time s": float(np.median([o.time_s for o in outcomes])),
    }


def random_notes(outcomes: Sequence[SceneOutcome]) -> list[str]:
    """Return how success is judged, and every failure that claims to be right."""
    shown = [o for o in outcomes if o.observable]
    wrong = [o for o in outcomes if o.claimed_wrong]
    return [
        f"{len(outcomes)} scenes, {len(shown)} of which show every bend (no node's bound across the axis above 10 mm). "
        "A fit succeeds where every node is within 1 mm (open profiles from one station 1.5 mm, among clutter 2 mm), "
        "or within 3 times the Cramer-Rao bound of that very scan where that is more; across the axis and along it, "
        "each by its own bound. Millimetres are across the axis.",
        f"Converged yet wrong, of all scenes: {len(wrong)}"
        + (": " + "; ".join(f"seed {o.seed} ({o.across_mm:.1f} mm)" for o in wrong) if wrong else "")
        + ".",
    ]


def case_notes(by_case: dict[str, list[SceneOutcome]]) -> list[str]:
    """Return what the limits are, and which cases miss theirs."""
    missed = [
        f"{name} ({sum(not o.succeeded for o in some)} of {len(some)})"
        for name, some in by_case.items()
        if not all(o.succeeded for o in some)
    ]
    doubted = [
        o
        for name, some in by_case.items()
        if name in ("one face visible", "a fifth of the length hidden")
        for o in some
    ]
    flagged = sum(o.status != "converged" for o in doubted)
    return [
        "Limits: 1 mm; open profiles from one station 1.5 mm; among clutter or outliers 2 mm; inside the gap 12 mm; of "
        "one face alone the error along its normal 1 mm; or 3 times the bound.",
        f"Cases that miss their limit for some seed: {', '.join(missed) or 'none'}.",
        f"One face, and the hidden fifth: {flagged} of {len(doubted)} fits say that something is not shown.",
    ]


def worst(outcomes: Sequence[SceneOutcome], count: int) -> list[str]:
    """Return lines on the worst failures, with how to make each again."""
    failed = sorted((o for o in outcomes if not o.succeeded), key=lambda o: (not o.claimed_wrong, -o.excess))
    lines = []
    for o in failed[:count]:
        labels = ", ".join(f"{k} {v}" for k, v in o.labels.items())
        lines += [
            f"{o.kind}, seed {o.seed}: {o.status}{', YET WRONG' if o.claimed_wrong else ''}: "
            f"across {o.across_mm:.2f} mm (bound {o.bound_across_mm:.2f}), along {o.along_mm:.2f} mm "
            f"(bound {o.bound_along_mm:.2f}), {o.excess:.1f} times the allowed; {labels}",
            *(f"    {reason}" for reason in o.reasons),
            f"    from benchlib.scene_fits import staged; there = staged({o.kind!r}, {o.seed})",
        ]
    return lines or ["no scene failed"]


def metrics(outcomes: Sequence[SceneOutcome], by_case: dict[str, list[SceneOutcome]]) -> list[gate.Metric]:
    """Return what the gate holds."""
    drawn = [o for o in outcomes if o.kind == RANDOM]
    failed = [o for o in drawn if not o.succeeded]
    out = [
        gate.Metric(
            "random scenes: success, %",
            percent(o.succeeded for o in drawn if o.observable),
            noise=0.02,
            better="higher",
            target=WANTED_SUCCESS,
        ),
        gate.Metric("random scenes: converged yet wrong", float(sum(o.claimed_wrong for o in drawn)), 0.0, target=0.0),
        gate.Metric(
            "random scenes: failures that do not say so", float(sum(not o.honest for o in failed)), 0.0, target=0.0
        ),
        gate.Metric(
            "nodes inside their 95 % ellipsoid, %",
            percent(i for o in outcomes for i in o.inside),
            noise=0.02,
            better="higher",
            target=WANTED_COVERED,
        ),
    ]
    named = [o for some in by_case.values() for o in some]
    if named:
        out += [
            gate.Metric(
                "named cases: within their limits, %",
                percent(o.succeeded for o in named),
                noise=0.02,
                better="higher",
                target=100.0,
            ),
            gate.Metric(
                "named cases: converged yet wrong", float(sum(o.claimed_wrong for o in named)), 0.0, target=0.0
            ),
        ]
    return out


def percent(those: Iterable[bool]) -> float:
    """Return the share of the true in percent, NaN of none."""
    values = list(those)
    return 100.0 * float(np.mean(values)) if values else float("nan")
