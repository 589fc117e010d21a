"""Common shift: the rigid motion that all elements seem to have made between two scans.

Buildings don't move as one: what most elements share is a difference of the two registrations.
Robust, since some elements have really moved: every element counts once, whatever its number of
nodes, and less the farther it is from what the others say (Tukey's biweight).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from linear_ik.movement import LEAST_SIGMA_M, Movement
from linear_ik.side_noise import MAD_TO_SD

Array = npt.NDArray[np.float64]

FEWEST = 3  # two elements cannot say which of them moved
ROUNDS = 30
TUKEY = 4.685  # standard deviations at which an element counts nothing: 95 % efficient where none has moved
FLAT = 1e-3  # elements in a row, or on one spot, say nothing about a rotation about it: of the largest extent


@dataclass(frozen=True, eq=False)
class CommonShift:
    """A rigid motion, small in its angle: a point p moves by t + w x (p - centre).

    Attributes:
        translation_m: [3] t.
        rotation_rad: [3] w; zeros where the elements don't span enough to say.
        centre_m: [3].
        covariance: [6][6] of t and w, 1 sigma.
        elements: how many it was estimated from.
        share: of them that follow it.
        p_value: chi-square of the translation and rotation being zero.
    """

    translation_m: Array
    rotation_rad: Array
    centre_m: Array
    covariance: Array
    elements: int
    share: float
    p_value: float

    def at(self, points_m: Array) -> tuple[Array, Array]:
        """Return the shift [M][3] of points [M][3], and its covariance [M][3][3]."""
        A = _design(points_m - self.centre_m)
        return np.asarray(
            A @ np.concatenate([self.translation_m, self.rotation_rad])
        ), A @ self.covariance @ A.transpose(0, 2, 1)


def common_shift(movements: Sequence[Movement]) -> CommonShift | None:
    """Return what all elements share, or None of fewer than three that were tested."""
    tested = [m for m in movements if m.tested]
    if len(tested) < FEWEST:
        return None
    every = np.concatenate([m.nodes_m for m in tested])
    centre = every.mean(axis=0)
    rigid = np.linalg.svd(every - centre, compute_uv=False)
    free = slice(0, 6 if rigid[1] > FLAT * rigid[0] else 3)
    blocks = []
    for m in tested:
        A = _design(m.nodes_m[m.seen] - centre)[:, :, free]
        # The nodes of one element vary together: as much as one of them is what it tells for sure.
        W = np.linalg.inv(m.covariance_m2[m.seen] + LEAST_SIGMA_M**2 * np.eye(3)) / m.seen.sum()
        blocks.append((A, W, m.displacement_m[m.seen]))
    H = np.array([np.einsum("kia,kij,kjb->ab", A, W, A) for A, W, _ in blocks])
    g = np.array([np.einsum("kia,kij,kj->a", A, W, d) for A, W, d in blocks])
    x = np.zeros(H.shape[1])
    x[:3] = np.median([m.displacement_m[m.seen].mean(axis=0) for m in tested], axis=0)
    weights = np.ones(len(tested))
    for _ in range(ROUNDS):
        off = np.array([np.sqrt(_squared(block, x) / 3.0) for block in blocks])
        # Covariances that are too small must not make most elements outliers.
        scale = max(1.0, MAD_TO_SD * float(np.median(off)))
        weights = np.clip(1.0 - (off / (TUKEY * scale)) ** 2, 0.0, None) ** 2
        before, x = x, np.linalg.solve(np.tensordot(weights, H, 1), np.tensordot(weights, g, 1))
        if np.abs(x - before).max() < 1e-9:
            break
    C = np.zeros((6, 6))
    C[free, free] = scale**2 * np.linalg.inv(np.tensordot(weights, H, 1))
    full = np.zeros(6)
    full[free] = x
    p = float(chi2.sf(x @ np.linalg.solve(C[free, free], x), len(x)))
    return CommonShift(full[:3], full[3:], centre, C, len(tested), float((weights > 0.5).mean()), p)


def _design(offsets: Array) -> Array:
    """Return d (t + w x r) / d (t, w) [M][3][6] of points r [M][3]."""
    A = np.zeros((len(offsets), 3, 6))
    A[:, :, :3] = np.eye(3)
    x, y, z = offsets.T
    A[:, 0, 4], A[:, 0, 5] = z, -y
    A[:, 1, 3], A[:, 1, 5] = -z, x
    A[:, 2, 3], A[:, 2, 4] = y, -x
    return A


def _squared(block: tuple[Array, Array, Array], x: Array) -> float:
    A, W, d = block
    r = d - A @ x
    return float(np.einsum("ki,kij,kj->", r, W, r))
