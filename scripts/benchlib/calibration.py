"""Calibration: are node errors as large as the fit's covariance says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.figures import drawing, save
from benchlib.scene_fits import SceneOutcome

Array = npt.NDArray[np.float64]

WANTED = (90.0, 99.0)
LEAST_SCANS = 60
MOST_DISTANCE = 20.0
COLOURS = ("#1b7837", "#2166ac", "#d9730d", "#7b3294", "#b2182b", "#4d4d4d")


def kinds(outcomes: Sequence[SceneOutcome]) -> dict[str, list[SceneOutcome]]:
    """Return the outcomes by what the scans have in common; one may be of several kinds."""
    of: dict[str, Callable[[SceneOutcome], bool]] = {
        "all": lambda o: True,
        "clean": lambda o: _label(o, "clutter", "none") == "none" and not _hidden(o) and not _loose(o),
        "one station": lambda o: _label(o, "stations", "") == "1",
        "clutter": lambda o: _label(o, "clutter", "none") != "none",
        "faces hidden": _hidden,
        "start free": _loose,
        "noise 3 to 5 mm": lambda o: _label(o, "noise", "").startswith("3"),
        "bends not all shown": lambda o: not o.observable,
        "status converged": lambda o: o.status == "converged",
    }
    out = {name: [o for o in outcomes if chosen(o)] for name, chosen in of.items()}
    return {name: some for name, some in out.items() if some}


def _label(outcome: SceneOutcome, column: str, default: str) -> str:
    return outcome.labels.get(column, default)


def _hidden(outcome: SceneOutcome) -> bool:
    return _label(outcome, "faces", "as seen") != "as seen"


def _loose(outcome: SceneOutcome) -> bool:
    return _label(outcome, "start", "fixed") == "free"


def calibration_row(kind: str, outcomes: Sequence[SceneOutcome]) -> dict[str, Any]:
    """Return the share of node errors inside the stated ellipsoids of several sizes."""
    fitted = [o for o in outcomes if o.probability]
    p = np.array([v for o in fitted for v in o.probability])
    all_inside = [all(o.inside) for o in fitted]
    share = {size: 100.0 * float(np.mean(p <= size / 100)) if len(p) else float("nan") for size in (50, 68, 95, 99)}
    return {
        "kind": kind,
        "scans": len(fitted),
        "nodes": len(p),
        **{f"inside {size} %": value for size, value in share.items()},
        "scans with every node inside 95 %": 100.0 * float(np.mean(all_inside)) if fitted else float("nan"),
    }


def calibration_notes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what is wanted, and what misses it."""
    low, high = WANTED
    missed = [f"{r['kind']} ({r['inside 95 %']:.1f} %)" for r in rows if not low <= r["inside 95 %"] <= high]
    scans = max((r["scans"] for r in rows), default=0)
    return [
        f"Wanted: {low:g} to {high:g} % of the node errors inside their stated 95 % ellipsoid, over at least "
        f"{LEAST_SCANS} scans of mixed kinds; here {scans} scans. Outside that: {', '.join(missed) or 'none'}.",
        "Scans of which nothing was fitted (status not_scanned) state no ellipsoid and are left out. The nodes of one "
        "scan are not independent of each other.",
    ]


def draw_calibration(stem: Path, by_kind: Mapping[str, Sequence[SceneOutcome]]) -> list[Path]:
    """Draw the squared distances beside the chi-square density, and observed beside stated shares by kind."""
    from scipy.stats import chi2

    with drawing(8.5, 3.4) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        every = by_kind.get("all", [])
        edges = np.linspace(0.0, MOST_DISTANCE, 41)
        for dof, colour in ((2, COLOURS[1]), (3, COLOURS[2])):
            found = np.array([d for o in every if o.probability for d, n in _pairs(o) if n == dof])
            if not len(found):
                continue
            height, _ = np.histogram(np.minimum(found, MOST_DISTANCE - 1e-9), edges)
            label = f"{dof} dimensions: {len(found)} nodes"
            left.stairs(height / len(found) / np.diff(edges), edges, color=colour, fill=True, alpha=0.35, label=label)
            at = np.linspace(1e-3, MOST_DISTANCE, 400)
            left.plot(at, chi2.pdf(at, dof), color=colour, label=f"chi-square of {dof}")
            left.axvline(chi2.ppf(0.95, dof), color=colour, lw=0.8, ls=":")
        left.set(
            xlabel=f"squared distance in stated deviations (last bar: {MOST_DISTANCE:g} and more); dotted: 95 %",
            ylabel="density",
            yscale="log",
            xlim=(0, MOST_DISTANCE),
        )
        left.legend()
        stated = np.linspace(0.0, 1.0, 101)
        right.plot(stated, stated, color="black", lw=0.8)
        for i, (kind, some) in enumerate(by_kind.items()):
            p = np.array([v for o in some for v in o.probability])
            if len(p):
                seen = [float(np.mean(p <= s)) for s in stated]
                style = "-" if i < len(COLOURS) else "--"
                right.plot(stated, seen, style, color=COLOURS[i % len(COLOURS)], label=kind)
        right.set(
            xlabel="stated probability of the ellipsoid", ylabel="share of the node errors inside", aspect="equal"
        )
        right.legend(loc="upper left", fontsize=5.5)
        return save(figure, stem)


def _pairs(outcome: SceneOutcome) -> list[tuple[float, int]]:
    return list(zip(outcome.distance, outcome.dimensions, strict=True))
