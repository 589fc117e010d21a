"""Damping: the lambda I of the paper's eq. 4, and its adaptation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from linear_ik.terms.objective import Objective

EASED = 3.0  # ours: what a step that lowered the cost divides the weight by
HARDENED = 4.0  # ours: what one that raised it multiplies the weight by


def damping(n: int, weight: float) -> Objective:
    """Return ``1/2 weight |dx|^2`` over n variables: steps stay short, nothing is biased."""
    return Objective(weight * np.eye(n), np.zeros(n))


@dataclass(frozen=True)
class Damping:
    """Relative weight of the damping term, adapted from step to step.

    A step that lowered the cost earns a smaller weight, one that raised it a larger
    (Marquardt's rule, factors of Nielsen's order of magnitude).
    """

    weight: float
    least: float = 1e-9
    most: float = 1e3

    def after(self, improved: bool) -> Damping:
        """Return the damping of the next step."""
        weight = self.weight / EASED if improved else self.weight * HARDENED
        return Damping(min(max(weight, self.least), self.most), self.least, self.most)
