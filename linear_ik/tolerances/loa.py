"""Level of accuracy of a result, after USIBD: how exactly it is known, and how well it meets the scan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from linear_ik.deviation import Deviations, deviations
from linear_ik.deviation_bands import BAND_95
from linear_ik.errors import ToleranceError
from linear_ik.result import FitResult
from linear_ik.tolerances.formula import evaluate
from linear_ik.tolerances.profile_file import FOLDER, checked, length, read_mapping, said

FILE = FOLDER / "usibd_loa.yaml"
TOP = ("title", "edition", "verified_by", "classes")
CLASS = ("name", "over", "to")


@dataclass(frozen=True)
class Accuracy:
    """Level of accuracy of one result.

    Attributes:
        level: such as LOA40, of the worse of the two; None: worse than the coarsest, or the fit is not
            converged, so that neither says how exact it is.
        measured_m: largest 95 % half-width of a node's place along one of the two axes of its section,
            from the fit's covariance; systematic errors included as far as they were given to the fit.
        represented_m: 1.96 times the rms distance of the matched points to the model's surface; of
            normally distributed distances 95 % are below it. It tells noise and misfit together, and
            nothing of where no points were matched.
        standard: title and edition.
    """

    level: str | None
    measured_m: float
    represented_m: float
    standard: str


def level_of_accuracy(result: FitResult, found: Deviations | None = None) -> Accuracy:
    """Return the level of accuracy of a result of an element that was found.

    Args:
        result: of a fit.
        found: its deviations, where the caller has them already.

    Raises:
        LinearIkError: the element was not found.
    """
    measured_m = float(np.max((found or deviations(result)).departure_m.band))
    represented_m = BAND_95 * result.surface_rmse_m
    standard, classes = _classes()
    worse = max(measured_m, represented_m) if math.isfinite(measured_m + represented_m) else math.inf
    level = None
    if result.status == "converged" and worse > 0:
        level = next((name for name, over, to in classes if over < worse <= to), None)
    return Accuracy(level, measured_m, represented_m, standard)


@cache
def _classes() -> tuple[str, list[tuple[str, float, float]]]:
    top = checked("file", read_mapping(FILE), TOP, TOP)
    rows = []
    for i, row in enumerate(top["classes"]):
        data = checked(f"classes[{i}]", row, CLASS, CLASS)
        over, to = (evaluate(length(f"classes[{i}].{key}", data[key]), {}).value for key in ("over", "to"))
        rows.append((said(f"classes[{i}].name", data["name"]), over, to))
    if not rows:
        raise ToleranceError(FILE, "no classes", "at least one")
    return f"{said('title', top['title'])}, edition: {said('edition', top['edition'])}", rows
