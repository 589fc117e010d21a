"""Continuity: the matrix Q of the paper's eq. 4."""

from __future__ import annotations

import numpy as np

from linear_ik.chain import BASE
from linear_ik.terms.objective import Objective


def continuity(n: int, weight: float) -> Objective:
    """Return ``1/2 weight sum_k |d theta_(k+1) - d theta_k|^2``: neighbouring joints turn alike.

    As in eq. 4, whose right-hand side is J'e alone, it resists steps and pulls nothing.
    Joint 1 carries the whole element's rotation, so neighbours are compared from joint 2 on.

    Args:
        n: number of the chain's variables, 6 + 3N.
        weight: [cost]/[rad^2].
    """
    rows = np.arange(BASE + 3, n - 3)
    D = np.zeros((len(rows), n))
    D[np.arange(len(rows)), rows] = -1.0
    D[np.arange(len(rows)), rows + 3] = 1.0
    return Objective(weight * (D.T @ D), np.zeros(n))
