"""Contest: a point near two elements goes to the one that explains it better.

Every element has been fitted with all points of its neighbourhood. Where two fitted surfaces
claim the same point, the nearer one has it; where both pass through it, the one that had to
move less from its design to get there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.result import FitResult
from linear_ik.site.body import Body

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

CLAIM_M = 0.010  # from a fitted surface
DISTANCE_SCALE_M = 0.003
MOVED_SCALE_M = 0.030
LEAST_LOST, LOST_SHARE = 30, 0.02  # of its own points, from where on an element is fitted again
FREED_SHARE = 0.05  # of all its points, where its fit is in doubt


@dataclass(frozen=True, eq=False)
class Claimant:
    """A fitted element that competes for points.

    Attributes:
        body: as fitted.
        moved_m: [N] how far each segment is from where it was designed, across the axis.
        claims: [N] whether the scan shows the segment; another claims nothing.
    """

    body: Body
    moved_m: Array
    claims: Mask

    @classmethod
    def of(cls, result: FitResult) -> Claimant:
        """Return the claimant that a fit makes."""
        off, along = result.moved_m, result.designed_directions
        off = (off[1:] + off[:-1]) / 2
        off -= np.einsum("ki,ki->k", off, along)[:, None] * along
        shown = result.status != "not_scanned"
        claims = np.array([shown and segment.status == "measured" for segment in result.segments])
        return cls(Body.fitted(result), np.linalg.norm(off, axis=1), claims)

    def cost(self, points: Array) -> Array:
        """Return what it costs this element to explain points [P][3]; inf for those it does not claim."""
        out = np.full(len(points), np.inf)
        near = self.body.may_touch(points, CLAIM_M)
        if not len(near):
            return out
        _, distance, segment = self.body.distances(points[near])
        cost = (distance / DISTANCE_SCALE_M) ** 2 + (self.moved_m[segment] / MOVED_SCALE_M) ** 2
        out[near] = np.where((distance <= CLAIM_M) & self.claims[segment], cost, np.inf)
        return out


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a contest ends with for one element.

    Attributes:
        taken: [P] points that a rival explains better.
        lost: how many of them the element itself had claimed.
        claimed: how many points the element had claimed.
    """

    taken: Mask
    lost: int
    claimed: int

    def calls_for_fit(self, result: FitResult) -> bool:
        """Say whether the element is to be fitted again without the points that were taken."""
        if self.lost > max(LEAST_LOST, LOST_SHARE * self.claimed):
            return True
        return result.status != "converged" and bool(self.taken.sum() > FREED_SHARE * len(self.taken))


def contest(points: Array, own: Claimant, rivals: Sequence[Claimant]) -> Verdict:
    """Return which of an element's points [P][3] its rivals explain better."""
    mine = own.cost(points)
    best = np.full(len(points), np.inf)
    for rival in rivals:
        np.minimum(best, rival.cost(points), out=best)
    taken = best < mine
    claimed = np.isfinite(mine)
    return Verdict(taken, int((taken & claimed).sum()), int(claimed.sum()))
