"""Side noise: a scanner's noise lies along its rays, so a face seen at a slant scatters less than one seen squarely.

One figure for all faces would take the square faces for better than they are, and the
covariance would be too small where they tell most.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.correspondence import Correspondences

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

SIDES = 8
MAD_TO_SD = 1.4826  # median absolute deviation to standard deviation, of a normal distribution
LEAST_POINTS = 60  # of a side that has a noise of its own; the rest share the common one
MOST = 4.0  # factor of a weight, either way: a section that is not quite as designed has sides of its own, too
COS, SIN = np.cos(np.pi / SIDES), np.sin(np.pi / SIDES)
OCTANT = np.array([0, 1, 3, 2, 7, 6, 4, 5])  # by sign of v, sign of u, and which is larger
ALIKE = 1.3  # ratio of noises within which sides are one


def sides(directions: Array) -> Index:
    """Return which of eight sides, 45 degrees each and the first about +x, each direction [P][2] faces."""
    x, y = directions[:, 0], directions[:, 1]
    # Turned by half a side, each octant is three signs; an arctangent of every point would cost a match.
    u, v = COS * x - SIN * y, SIN * x + COS * y
    return np.asarray(OCTANT[(v < 0) * 4 + (u < 0) * 2 + (np.abs(v) > np.abs(u))])


def trust_of(pairs: Correspondences, weights: Array, noise_m: float) -> Array | None:
    """Return the factor [8] on the weights of each side, ``(noise / its own noise)^2``, or None where all are alike.

    Args:
        pairs: matches of a settled fit.
        weights: [P] theirs; matches without weight are left out.
        noise_m: standard deviation of all points together.
    """
    used = weights > 0
    side, residual = sides(pairs.gradient[used]), np.abs(pairs.residual_m[used])
    own_m = np.full(SIDES, noise_m)
    for k in np.flatnonzero(np.bincount(side, minlength=SIDES) >= LEAST_POINTS):
        own_m[k] = MAD_TO_SD * float(np.median(residual[side == k]))
    ratio = noise_m / np.maximum(own_m, 1e-12)
    if (ratio < ALIKE).all() and (ratio > 1 / ALIKE).all():
        return None
    return np.asarray(np.clip(ratio**2, 1 / MOST, MOST))
