"""Directional constraint: the matrix C of the paper's eq. 4."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]

STRAIGHT_RAD2 = 1e-12  # sum of the squared bends below which there is no dominant axis


def directional_constraint(x: Array, weight: float) -> Objective:
    """Return a penalty on steps that bend across the dominant axis, or twist.

    The dominant bending axis is the principal direction u of the bends (theta_x,
    theta_y) that the chain has so far; ``1/2 weight (|(I - u u') d theta_xy|^2 +
    d theta_z^2)`` is summed over the joints from 2 on. A straight chain has no dominant
    axis and only its twist is penalised. As in eq. 4, whose right-hand side is J'e alone,
    it resists steps and pulls nothing.

    Args:
        x: [6 + 3N] the chain's variables, radians; (z, y, x) a segment.
        weight: [cost]/[rad^2].
    """
    n = len(x)
    bends = x[BASE + 3 :].reshape(-1, 3)
    across = np.zeros((3, 3))
    across[0, 0] = 1.0
    scatter = bends[:, 1:].T @ bends[:, 1:]
    values, vectors = np.linalg.eigh(scatter)
    if values[1] > STRAIGHT_RAD2:
        across[1:, 1:] = np.outer(vectors[:, 0], vectors[:, 0])
    H = np.zeros((n, n))
    H[BASE + 3 :, BASE + 3 :] = weight * np.kron(np.eye(len(bends)), across)
    return Objective(H, np.zeros(n))
