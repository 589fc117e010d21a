"""Section check: does the section measure what the design says it does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.correspondence import Correspondences
from linear_ik.surface import Surface
from linear_ik.tapered_surface import TaperedSurface

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

BOTH_SIDES_SEEN = 0.25
LEAST_MISFIT_M = 0.0003
LARGEST_STRETCH = 0.03
LEAST_POINTS = 12  # of a segment that has a say


@dataclass(frozen=True, eq=False)
class SectionMisfit:
    """A section that fits better than the designed one.

    Attributes:
        scale: [2] stretch along the section's x and y that fits the points.
        plausible: whether it is the same section, out of its nominal size (up to 3 %).
    """

    scale: Array
    plausible: bool

    def sentence(self, designed: Surface) -> str:
        """Say it in millimetres, against the designed section."""
        where = " in the middle" if isinstance(designed, TaperedSurface) else ""
        if designed.radius_m is not None:
            radius = designed.radius_m * 1e3
            return (
                f"the section's radius{where} measures {radius * self.scale[0]:.1f} mm "
                f"where {radius:.1f} mm was designed"
            )
        (w, d), (sx, sy) = designed.size_m * 1e3, self.scale
        return f"the section{where} measures {w * sx:.1f} x {d * sy:.1f} mm where {w:.1f} x {d:.1f} mm was designed"


def section_misfit(surface: Surface, pairs: Correspondences, used: Mask, noise_m: float) -> SectionMisfit | None:
    """Return how the section should be stretched to fit its points, or None where it need not.

    A stretch s moves the face at p by ``n_x x s_x + n_y y s_y``; it is told from a shift
    of the segment, ``n_x a + n_y b``, only where opposite sides are seen. The residuals
    are regressed on both, each segment with its own shift; a direction counts where a
    quarter of its information is left after the shifts have taken theirs.

    Args:
        surface: the section the points were matched to.
        pairs: matches.
        used: [P] the matches on the surface.
        noise_m: standard deviation of a point.
    """
    used = used & _told_apart(surface, pairs, noise_m)
    gradient, residual = pairs.gradient[used], pairs.residual_m[used]
    # At the foot on the face: at the point itself the noise would explain itself.
    stretch = gradient * (pairs.local[used, :2] - residual[:, None] * gradient)
    if surface.radius_m is not None:
        stretch = stretch.sum(axis=1, keepdims=True)
    ends = np.searchsorted(pairs.segment[used], np.arange(len(pairs.starts)))
    told = np.flatnonzero(np.diff(ends) >= LEAST_POINTS)
    m = stretch.shape[1]
    if not len(told):
        return None
    both = np.column_stack([gradient, stretch, residual])
    # Moments of each segment: shifts first (2), stretches (m), residual (1).
    M = np.stack([both[ends[k] : ends[k + 1]].T @ both[ends[k] : ends[k + 1]] for k in told])
    G = np.linalg.pinv(M[:, :2, :2], rcond=1e-12, hermitian=True)
    left_of = M[:, 2:, 2:] - M[:, 2:, :2] @ G @ M[:, :2, 2:]
    total = np.diag(M[:, 2:, 2:].sum(axis=0))[:m]
    left, pull = left_of[:, :m, :m].sum(axis=0), left_of[:, :m, m].sum(axis=0)
    seen = (np.diag(left) > BOTH_SIDES_SEEN * total) & (total > 0)
    if not seen.any():
        return None
    s = np.zeros(m)
    s[seen] = np.linalg.solve(left[np.ix_(seen, seen)], pull[seen])
    half = surface.size_m[:m] / 2
    error = np.zeros(m)
    error[seen] = noise_m * np.sqrt(np.diag(np.linalg.inv(left[np.ix_(seen, seen)])))
    wrong = (np.abs(s) * half > LEAST_MISFIT_M) & (np.abs(s) > 6.0 * error)
    if not wrong.any():
        return None
    s = np.where(wrong, s, 0.0)
    return SectionMisfit(1.0 + np.broadcast_to(s, 2).copy(), bool((np.abs(s) <= LARGEST_STRETCH).all()))


def _told_apart(surface: Surface, pairs: Correspondences, noise_m: float) -> Mask:
    """Return the matches that noise cannot have taken from another face: there it always measures outwards.

    They lie 4 deviations within the corners of their face, of a plate 5 thick or more.
    """
    if surface.radius_m is not None:
        return np.ones(len(pairs.face), dtype=bool)
    delta = pairs.section - surface.corners[pairs.face]
    along = np.einsum("ij,ij->i", surface.tangents[pairs.face], delta)
    middle = surface.corners + 0.5 * surface.widths_m[:, None] * surface.tangents
    thick = surface.distances(middle - 2.5 * noise_m * surface.normals) > 2.499 * noise_m
    margin_m = 4.0 * noise_m
    return np.asarray((along > margin_m) & (along < surface.widths_m[pairs.face] - margin_m) & thick[pairs.face])
