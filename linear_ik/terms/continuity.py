"""Continuity: the matrix Q of the paper's eq. 4."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]


def continuity(x: Array, weight: float) -> Objective:
    """Return ``1/2 weight sum_k |theta_(k+1) - theta_k|^2`` about the current angles.

    Joint 1 carries the whole element's rotation, so neighbours are compared from
    joint 2 on.

    Args:
        x: [6 + 3N] the chain's variables, radians.
        weight: [cost]/[rad^2].
    """
    n = len(x)
    rows = np.arange(BASE + 3, n - 3)
    D = np.zeros((len(rows), n))
    D[np.arange(len(rows)), rows] = -1.0
    D[np.arange(len(rows)), rows + 3] = 1.0
    return Objective(weight * (D.T @ D), weight * (D.T @ (D @ x)))
