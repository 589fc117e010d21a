"""FitSettings: everything a person may choose about a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal, NamedTuple, get_args

from linear_ik.errors import SettingsError

Method = Literal["default", "icpik"]
Search = Literal["auto", "always", "never"]


class TermWeights(NamedTuple):
    """Weights of the terms lambda, Q and C, relative to the mean information of a variable."""

    damping: float
    continuity: float
    directional: float


# The default needs no damping but for conditioning, and no shape priors: they bias. The
# paper gives no constants for its own.
TERM_WEIGHTS: dict[Method, TermWeights] = {
    "default": TermWeights(damping=1e-6, continuity=0.0, directional=0.0),
    "icpik": TermWeights(damping=1e-3, continuity=1e-3, directional=1e-3),
}


@dataclass(frozen=True)
class FitSettings:
    """Settings of one fit; the defaults are what the project knows to be best.

    Attributes:
        method: "default", or "icpik" for the paper's algorithm.
        max_iterations: cap on the iterations of all phases together; a search takes some 15 a
            segment, a clean scan about 12 in all.
        range_noise_m: standard deviation of the scanner, or None to estimate it.
        damping: weight of the damping term, relative to the mean information of a
            variable (lambda of the paper's eq. 4); adapted between iterations. None, here
            and below, stands for the method's own.
        continuity: weight of the continuity term Q, relative; 0 leaves it out.
        directional: weight of the directional constraint C, relative; 0 leaves it out.
        max_step_rad: largest change of a joint in one iteration.
        search: whether each joint's direction is searched from the base outwards.
            "auto" searches when the plain fit leaves points unexplained.
        outlier_removal: whether points without company are removed first (Open3D's statistical
            outlier removal, 20 neighbours, 2 deviations). The fit is robust without it.
        systematic_error_m: standard deviation, along each axis, of an error that all points
            share, such as that of the registration. It is added to every node's covariance
            as a translation of the whole: it cancels between nodes of one result.
        solver: a solver qpsolvers knows by this name; "osqp" is called directly.
        seed: of the random subsets of points.

    Raises:
        SettingsError: a value out of its range, named.
    """

    method: Method = "default"
    max_iterations: int = 20_000
    range_noise_m: float | None = None
    damping: float | None = None
    continuity: float | None = None
    directional: float | None = None
    max_step_rad: float = 0.3
    search: Search = "auto"
    outlier_removal: bool = False
    systematic_error_m: float = 0.0
    solver: str = "osqp"
    seed: int = 0

    def __post_init__(self) -> None:
        """Check every field; numbers of NumPy become Python's, which JSON knows."""
        if self.method not in get_args(Method):
            raise SettingsError("method", f"{self.method!r}", "one of " + ", ".join(get_args(Method)))
        for name, low, high in (
            ("damping", 0.0, 1e6),
            ("continuity", 0.0, 1e6),
            ("directional", 0.0, 1e6),
            ("max_step_rad", 1e-6, math.pi),
            ("range_noise_m", 1e-6, 1.0),
            ("systematic_error_m", 0.0, 10.0),
            ("max_iterations", 1, 10**6),
            ("seed", 0, 2**63),
        ):
            value = getattr(self, name)
            if value is None and name in ("damping", "continuity", "directional", "range_noise_m"):
                continue
            if isinstance(value, bool) or not isinstance(value, Real) or not low <= float(value) <= high:
                raise SettingsError(name, f"{value!r}", f"a number from {low:g} to {high:g}")
            if not isinstance(value, Integral):
                object.__setattr__(self, name, float(value))
        for name in ("max_iterations", "seed"):
            if not isinstance(getattr(self, name), Integral):
                raise SettingsError(name, f"{getattr(self, name)!r}", "a whole number")
            object.__setattr__(self, name, int(getattr(self, name)))
        if not isinstance(self.outlier_removal, bool):
            raise SettingsError("outlier_removal", f"{self.outlier_removal!r}", "True or False")
        if self.search not in get_args(Search):
            raise SettingsError("search", f"{self.search!r}", "one of " + ", ".join(get_args(Search)))

    @property
    def weights(self) -> TermWeights:
        """The weights of the terms, the method's own where none were given."""
        own = TERM_WEIGHTS[self.method]
        given = (self.damping, self.continuity, self.directional)
        return TermWeights(*(o if g is None else g for g, o in zip(given, own, strict=True)))
