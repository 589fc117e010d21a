"""FitSettings: everything a person may choose about a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from linear_ik.errors import SettingsError

Search = Literal["auto", "always", "never"]


@dataclass(frozen=True)
class FitSettings:
    """Settings of one fit; the defaults are what the project knows to be best.

    Attributes:
        max_iterations: cap on the iterations of all phases together.
        range_noise_m: standard deviation of the scanner, or None to estimate it.
        damping: weight of the damping term, relative to the mean information of a
            variable (lambda of the paper's eq. 4); adapted between iterations.
        continuity: weight of the continuity term Q, relative; 0 leaves it out.
        directional: weight of the directional constraint C, relative; 0 leaves it out.
        max_step_rad: largest change of a joint in one iteration.
        search: whether each joint's direction is searched from the base outwards.
            "auto" searches when the plain fit leaves points unexplained.
        solver: a solver qpsolvers knows by this name; "osqp" is called directly.
        seed: of the random subsets of points.

    Raises:
        SettingsError: a value out of its range, named.
    """

    max_iterations: int = 2000
    range_noise_m: float | None = None
    damping: float = 1e-6
    continuity: float = 0.0
    directional: float = 0.0
    max_step_rad: float = 0.3
    search: Search = "auto"
    solver: str = "osqp"
    seed: int = 0

    def __post_init__(self) -> None:
        """Check every field."""
        for name, low, high in (
            ("damping", 0.0, 1e6),
            ("continuity", 0.0, 1e6),
            ("directional", 0.0, 1e6),
            ("max_step_rad", 1e-6, math.pi),
            ("range_noise_m", 1e-6, 1.0),
            ("max_iterations", 1, 10**6),
            ("seed", 0, 2**63),
        ):
            value = getattr(self, name)
            if value is None and name == "range_noise_m":
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
                raise SettingsError(name, f"{value!r}", f"a number from {low:g} to {high:g}")
        for name in ("max_iterations", "seed"):
            if not isinstance(getattr(self, name), int):
                raise SettingsError(name, f"{getattr(self, name)!r}", "a whole number")
        if self.search not in get_args(Search):
            raise SettingsError("search", f"{self.search!r}", "one of " + ", ".join(get_args(Search)))
