"""Damping: the lambda I of the paper's eq. 4, and its adaptation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from linear_ik.terms.objective import Objective

EASED, HARDENED = 3.0, 4.0  # Marquardt's rule leaves the factors open


def damping(n: int, weight: float) -> Objective:
    """Return ``1/2 weight |dx|^2`` over n variables: steps stay short, nothing is biased."""
    return Objective(weight * np.eye(n), np.zeros(n))


@dataclass(frozen=True)
class Damping:
    """Relative weight of the damping term, adapted from step to step.

    A step that lowered the mean cost of a match earns a smaller weight, one that raised it
    a larger (Marquardt's rule).
    """

    weight: float
    least: float = 1e-9
    most: float = 1e3

    def after(self, improved: bool) -> Damping:
        """Return the damping of the next step."""
        weight = self.weight / EASED if improved else self.weight * HARDENED
        return Damping(min(max(weight, self.least), self.most), self.least, self.most)
