"""Curved segments: members that bend between the joints of their chain.

A chain bends at its joints only. Where the member has its kink between two of them, the segment there is a chord:
its points run from one side of it to the other, and both its nodes stand off the member by two thirds of that.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.correspondence import Correspondences
from linear_ik.stage import robust_cost, robust_weights

Array = npt.NDArray[np.float64]

LEAST_SAGITTA_M = 0.002  # as far as a node may be unsure by where a fit claims to be right
SURE = 5.0  # deviations
LEAST_GAIN = 0.08  # of the robust cost: what stands beside a segment is explained by a curve no better
ROBUST_SCALE, NEAR = 4.0, 6.0  # deviations; what lies farther off is something else's
ROUNDS = 5
LEAST_POINTS = 30


def sagittas(pairs: Correspondences, segment_length_m: float, noise_m: float) -> Array:
    """Return how far [N] the member's axis bulges from each segment, where the points surely show that, else 0.

    The points' distances to the segment's surface are fitted by a shift and a turn, and by these and the parabola
    ``4 t (1 - t)``, across each axis of the section, t from 0 to 1 along the segment: by least squares, reweighted
    as the fit's.

    Args:
        pairs: matches of the sample.
        segment_length_m: of all segments.
        noise_m: standard deviation of a point.
    """
    out = np.zeros(len(pairs.starts) - 1)
    for k in range(len(out)):
        rows = slice(pairs.starts[k], pairs.starts[k + 1])
        near = pairs.distance_m[rows] <= NEAR * noise_m
        if np.count_nonzero(near) >= LEAST_POINTS:
            t = pairs.local[rows, 2][near] / segment_length_m
            out[k] = _sagitta(t, pairs.gradient[rows][near], pairs.residual_m[rows][near], noise_m)
    return out


def _sagitta(t: Array, gradient: Array, residual_m: Array, noise_m: float) -> float:
    """Return the sagitta of one segment from its points: t [S] along it, [S][2] facing, [S] off its surface."""
    straight = np.stack([np.ones_like(t), t], axis=1)
    curved = np.column_stack([straight, 4.0 * t * (1.0 - t)])
    _, _, straight_cost = _fitted(straight, gradient, residual_m, noise_m)
    seen, H, cost = _fitted(curved, gradient, residual_m, noise_m)
    bulge = np.array([2, 5])
    size_m = float(np.linalg.norm(seen[bulge]))
    if size_m < LEAST_SAGITTA_M or cost > (1.0 - LEAST_GAIN) * straight_cost:
        return 0.0
    towards = np.zeros(6)
    towards[bulge] = seen[bulge] / size_m
    sd_m = noise_m * float(np.sqrt(towards @ np.linalg.solve(H, towards)))
    return size_m if size_m > SURE * sd_m else 0.0


def _fitted(shapes: Array, gradient: Array, residual_m: Array, noise_m: float) -> tuple[Array, Array, float]:
    """Return the coefficients [2M] of shapes [S][M] along x, then y, their normal matrix, and the robust cost left."""
    scale_m = ROBUST_SCALE * noise_m
    A = (gradient[:, :, None] * shapes[:, None, :]).reshape(len(shapes), -1)
    # A direction that no point faces stays where it is.
    ridge = 1e-6 * len(A) * np.eye(A.shape[1])
    left, seen, H = residual_m, np.zeros(A.shape[1]), ridge
    for _ in range(ROUNDS):
        w = robust_weights(np.abs(left), scale_m)
        H = (A * w[:, None]).T @ A + ridge
        seen = np.linalg.solve(H, A.T @ (w * residual_m))
        left = residual_m - A @ seen
    return seen, H, robust_cost(np.abs(left), scale_m)
