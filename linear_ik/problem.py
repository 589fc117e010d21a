"""Problem: one element and one scan, brought into the element's own frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain
from linear_ik.correspondence import Matcher
from linear_ik.duplicates import point_keys, repeated
from linear_ik.element import Element
from linear_ik.scan import Scan
from linear_ik.sights import Sights
from linear_ik.surface import Surface
from linear_ik.tapered_surface import TaperedSurface, surface_of

Array = npt.NDArray[np.float64]

AXIAL = 2
MANY_POINTS = 1_000_000
POINTS_A_PIECE = 65_536  # what a core keeps in its cache
BEND_SD_RAD = np.radians(10.0)
CURVED_RAD = np.radians(10.0)  # from the element's Z; a translation along it then shows
TWIST_SD_RAD = np.radians(5.0)
FIRST_JOINT_SD_RAD = np.radians(5.0)


@dataclass(frozen=True, eq=False)
class Problem:
    """What every stage of a fit works on. Element's frame, metres, radians.

    Attributes:
        element: the design.
        chain: its kinematics.
        surface: its faces.
        matcher: finds the face of each point.
        points: [P][3] scan points within the element's reach.
        variables: [n] which of the chain's variables move: those with room in their
            box, less the torsion of a round section, which no point can see, and less the
            slide along the axis until `released`, unless the shape itself shows it.
        prior_sd: [6 + 3N] standard deviation of each variable before the scan is seen.
        prior_mean: [6 + 3N] its mean: the design.
        end_m: [3] where a held end has its place; None: where the element's own design ends.
    """

    element: Element
    chain: Chain
    surface: Surface
    matcher: Matcher
    points: Array
    variables: npt.NDArray[np.intp]
    prior_sd: Array
    prior_mean: Array
    end_m: Array | None = None

    @classmethod
    def of(cls, element: Element, scan: Scan | None, end_m: Array | None = None) -> Problem:
        """Prepare the fit of ``element`` to ``scan``, or to no point at all; its end held at ``end_m`` [3]."""
        chain = Chain.of(element)
        surface = surface_of(element)
        T = element.placement.T_world_element
        slack_m = float(np.linalg.norm(chain.upper[:3])) + surface.reach_m + 0.1
        points, sights = np.empty((0, 3)), None
        if scan is not None:
            points, near = in_reach(scan.points, T, element.length_m + slack_m)
        if scan is not None and scan.stations is not None and scan.station_index is not None:
            sights = Sights.of(points, (scan.stations - T[:3, 3]) @ T[:3, :3], scan.station_index[near])
        movable = chain.upper > chain.lower
        if surface.radius_m is not None:
            movable[BASE::3] = False
        # Faces do not show a slide along them, so it is held until something else does.
        movable[AXIAL] &= element.end in ("pinned", "fixed") or shows_slide(element, surface)
        sd = np.tile([TWIST_SD_RAD, BEND_SD_RAD, BEND_SD_RAD], element.segments + 2)
        sd[BASE : BASE + 3] = FIRST_JOINT_SD_RAD
        # A base that may move is expected anywhere in its box: uniform has this deviation.
        sd[:BASE] = np.maximum(chain.upper[:BASE] / np.sqrt(3.0), 1e-9)
        return cls(
            element,
            chain,
            surface,
            Matcher(surface, chain.segment_length_m, sights),
            points,
            np.flatnonzero(movable),
            sd,
            chain.with_q(element.design.angles_rad[:, ::-1].ravel()),
            end_m,
        )

    def seeing(self, points: Array) -> Problem:
        """Return the problem with other points [P][3]."""
        return replace(self, points=points)

    @property
    def may_slide(self) -> bool:
        """Whether the support lets the element slide along its axis."""
        return bool(self.chain.upper[AXIAL] > self.chain.lower[AXIAL])

    def released(self) -> Problem:
        """Return the problem with the slide along the axis free to move."""
        return replace(self, variables=np.union1d(self.variables, [AXIAL]))

    def held(self) -> Problem:
        """Return the problem with the slide along the axis held, unless an end or the shape does so already."""
        if self.element.end in ("pinned", "fixed") or shows_slide(self.element, self.surface):
            return self
        return replace(self, variables=np.setdiff1d(self.variables, [AXIAL]))

    def bending(self, most_rad: float) -> Problem:
        """Return the problem with joints that bend, from the design, no further than ``most_rad``."""
        chain, joints = self.chain, slice(BASE, None)
        lower, upper = chain.lower.copy(), chain.upper.copy()
        lower[joints] = np.maximum(lower[joints], self.designed[joints] - most_rad)
        upper[joints] = np.minimum(upper[joints], self.designed[joints] + most_rad)
        return replace(self, chain=chain.bounded(lower, upper))

    def expecting(self, prior_sd: Array, prior_mean: Array | None = None) -> Problem:
        """Return the problem under another prior: deviations and, where given, means [6 + 3N]."""
        return replace(self, prior_sd=prior_sd, prior_mean=self.prior_mean if prior_mean is None else prior_mean)

    def measuring(self, surface: Surface) -> Problem:
        """Return the problem with the section as it measures."""
        return self._matching(surface, self.matcher.handicap_m2)

    def favouring(self, handicap_m2: Array) -> Problem:
        """Return the problem with points given to the faces that were seen (`Matcher`)."""
        return self._matching(self.surface, handicap_m2)

    def _matching(self, surface: Surface, handicap_m2: Array | None) -> Problem:
        matcher = Matcher(surface, self.chain.segment_length_m, self.matcher.sights, handicap_m2)
        return replace(self, surface=surface, matcher=matcher)

    @property
    def wall_m(self) -> float:
        """Thickness of a hollow section's wall; inf where there is nothing inside to be seen."""
        return float(getattr(self.element.profile, "wall_thickness", np.inf))

    @property
    def designed(self) -> Array:
        """[6 + 3N] the design, put into the joint limits."""
        return self.chain.clip(self.chain.with_q(self.element.design.angles_rad[:, ::-1].ravel()))


def shows_slide(element: Element, surface: Surface) -> bool:
    """Whether the shape itself shows a slide along the element's Z: it tapers, or leads elsewhere."""
    leads_elsewhere = element.design.rotations[:, 2, 2].min() < np.cos(CURVED_RAD)
    return bool(leads_elsewhere) or isinstance(surface, TaperedSurface)


def in_reach(points: Array, T_world_element: Array, reach_m: float) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Return the points within ``reach_m`` of the element's start, each once, in the element's frame.

    Clouds of more than a million points come back in single precision: at the element's
    size that is a tenth of a micrometre, and half the memory.

    Returns:
        The points, and which [P] of all they are.
    """
    out = np.empty(points.shape, dtype=np.float64 if len(points) <= MANY_POINTS else np.float32)
    keys = np.empty(len(points), dtype=np.uint64)
    count, kept = 0, np.empty(len(points), dtype=bool)
    for start in range(0, len(points), POINTS_A_PIECE):
        piece = points[start : start + POINTS_A_PIECE]
        local = (piece - T_world_element[:3, 3]) @ T_world_element[:3, :3]
        near = np.einsum("ij,ij->i", local, local) <= reach_m**2
        kept[start : start + POINTS_A_PIECE] = near
        if not near.all():
            piece, local = piece[near], local[near]
        out[count : count + len(local)] = local
        keys[count : count + len(local)] = point_keys(piece)
        count += len(local)
    out = out[:count]
    again = repeated(keys[:count], out)
    if again is None:
        return out, kept
    kept[np.flatnonzero(kept)[again]] = False
    return out[~again], kept


def thinned(points: Array, cell_m: float, seed: int) -> Array:
    """Return one point of each cell of a grid, chosen at random: equal density everywhere.

    A point is kept as measured; the mean of a cell would cut corners.
    """
    order = np.random.default_rng(seed).permutation(len(points))
    cells = np.floor((points[order] - points.min(axis=0)) / cell_m).astype(np.int64)
    span = cells.max(axis=0) + 1
    key = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    _, first = np.unique(key, return_index=True)
    return np.asarray(points[np.sort(order[first])])
