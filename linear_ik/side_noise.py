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
Mask = npt.NDArray[np.bool_]

SIDES = 8
MAD_TO_SD = 1.4826  # median absolute deviation to standard deviation, of a normal distribution
LEAST_POINTS = 60  # of a side that has a noise of its own; the rest share the common one
MOST = 4.0  # factor of a weight, either way: a section that is not quite as designed has sides of its own, too
COS, SIN = np.cos(np.pi / SIDES), np.sin(np.pi / SIDES)
OCTANT = np.array([0, 1, 3, 2, 7, 6, 4, 5])  # by sign of v, sign of u, and which is larger
ALIKE = 1.3  # ratio of noises within which sides are one
# A quarter of a patch's points twice as far off as usual is something that touches it: mixed pixels are fewer,
# and chance does so to one patch of twenty points in ten thousand.
LEAST_OF_PATCH, TOUCHING, STRANGE = 20, 0.75, 2.0
LEAST_SCATTERED, SCATTERED = 10, 2.0  # points; chance does so to one patch of ten points in thirty thousand
LEAST_ALIKE = 3  # patches of a side, to tell what is usual there
TOUCHING_TO_SD = 1.15  # that quantile of the distances, over the standard deviation, of a normal distribution
LEAST_TRUST = 0.01  # not 0: what lies there still says a little


def sides(directions: Array) -> Index:
    """Return which of eight sides, 45 degrees each and the first about +x, each direction [P][2] faces."""
    x, y = directions[:, 0], directions[:, 1]
    # Turned by half a side, each octant is three signs; an arctangent of every point would cost a match.
    u, v = COS * x - SIN * y, SIN * x + COS * y
    return np.asarray(OCTANT[(v < 0) * 4 + (u < 0) * 2 + (np.abs(v) > np.abs(u))])


def trust_of(pairs: Correspondences, weights: Array, noise_m: float, kept: Mask | None = None) -> Array | None:
    """Return the factor [N][8] on the weights of each side of each segment, or None where all are alike.

    ``(noise / its own noise)^2`` of a side. A patch, a side of one segment, where points scatter twice as much as
    elsewhere on that side is touched by something, a bracket flush with a flange's edge: it hardly counts.

    Args:
        pairs: matches of a settled fit.
        weights: [P] theirs; matches without weight are left out.
        noise_m: standard deviation of all points together.
        kept: [N] segments that are kept from their points by a joint's limit: nothing else need touch them.
    """
    used, n = weights > 0, len(pairs.starts) - 1
    side, residual = sides(pairs.gradient[used]), np.abs(pairs.residual_m[used])
    own_m = np.full(SIDES, noise_m)
    for k in np.flatnonzero(np.bincount(side, minlength=SIDES) >= LEAST_POINTS):
        own_m[k] = MAD_TO_SD * float(np.median(residual[side == k]))
    ratio = noise_m / np.maximum(own_m, 1e-12)
    alike = (ratio < ALIKE).all() and (ratio > 1 / ALIKE).all()
    trust = np.tile(np.ones(SIDES) if alike else np.clip(ratio**2, 1 / MOST, MOST), (n, 1))
    strange = touched(pairs.segment[used], side, residual, n, noise_m)
    strange |= scattered(pairs.segment[used], side, residual, n, noise_m)
    if kept is not None:
        strange[kept] = False
    if alike and not strange.any():
        return None
    return np.where(strange, LEAST_TRUST * trust, trust)


def touched(segment: Index, side: Index, residual_m: Array, segments: int, noise_m: float) -> Mask:
    """Return the patches [N][8], a side of one segment, where points scatter twice as far as on that side elsewhere.

    And as far as the noise. Of one or two segments none is: nothing says what is usual.

    Args:
        segment: [P] of each match.
        side: [P] that it faces.
        residual_m: [P] its distance to the surface.
        segments: N.
        noise_m: standard deviation of all points together.
    """
    patch = segment * SIDES + side
    parts = np.split(
        residual_m[np.argsort(patch, kind="stable")], np.cumsum(np.bincount(patch, minlength=segments * SIDES))
    )
    scatter_m = np.array([np.quantile(p, TOUCHING) if len(p) >= LEAST_OF_PATCH else np.nan for p in parts[:-1]])
    scatter_m = scatter_m.reshape(segments, SIDES)
    usual_m = np.full(SIDES, np.inf)
    for k, column in enumerate(scatter_m.T):
        if np.isfinite(column).sum() >= LEAST_ALIKE:
            usual_m[k] = max(float(np.nanmedian(column)), TOUCHING_TO_SD * noise_m / STRANGE)
    return np.asarray(scatter_m > STRANGE * usual_m)


def scattered(segment: Index, side: Index, residual_m: Array, segments: int, noise_m: float) -> Mask:
    """Return the patches [N][8] that make up no surface: half of the points are more than two deviations off.

    Counted with the patch across: what stands about a member's end lies on both sides of it. Arguments as `touched`.
    """
    across = segment * (SIDES // 2) + side % (SIDES // 2)
    order, most = np.argsort(across, kind="stable"), segments * SIDES // 2
    parts = np.split(residual_m[order], np.cumsum(np.bincount(across, minlength=most)))
    half_m = np.array([np.median(p) if len(p) >= LEAST_SCATTERED else 0.0 for p in parts[:-1]])
    return np.tile(half_m.reshape(segments, SIDES // 2) > SCATTERED * noise_m, (1, 2))


def touched_segments(trust: Array | None, segments: int) -> Mask:
    """Return the segments [N] of which a side has lost its weight in `trust_of`."""
    return np.zeros(segments, dtype=bool) if trust is None else np.asarray((trust <= LEAST_TRUST * MOST).any(axis=1))
