"""Problem: one element and one scan, brought into the element's own frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain
from linear_ik.correspondence import Matcher
from linear_ik.element import Element
from linear_ik.scan import Scan
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

AXIAL = 2
BEND_SD_RAD = np.radians(10.0)
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
            slide along the axis until `released`.
        prior_sd: [6 + 3N] standard deviation of each variable before the scan is seen.
    """

    element: Element
    chain: Chain
    surface: Surface
    matcher: Matcher
    points: Array
    variables: npt.NDArray[np.intp]
    prior_sd: Array

    @classmethod
    def of(cls, element: Element, scan: Scan) -> Problem:
        """Prepare the fit of ``element`` to ``scan``."""
        chain = Chain.of(element)
        surface = Surface.of(element.profile)
        T = element.placement.T_world_element
        points = (scan.points - T[:3, 3]) @ T[:3, :3]
        slack = np.linalg.norm(chain.upper[:3]) + surface.reach_m + 0.1
        near = np.einsum("ij,ij->i", points, points) <= (element.length_m + slack) ** 2
        if not near.all():
            points = points[near]
        movable = chain.upper > chain.lower
        if surface.radius_m is not None:
            movable[BASE::3] = False
        movable[AXIAL] = False
        sd = np.tile([TWIST_SD_RAD, BEND_SD_RAD, BEND_SD_RAD], element.segments + 2)
        sd[BASE : BASE + 3] = FIRST_JOINT_SD_RAD
        # A base that may move is expected anywhere in its box: uniform has this deviation.
        sd[:BASE] = np.maximum(chain.upper[:BASE] / np.sqrt(3.0), 1e-9)
        return cls(
            element, chain, surface, Matcher(surface, chain.segment_length_m), points, np.flatnonzero(movable), sd
        )

    @property
    def may_slide(self) -> bool:
        """Whether the support lets the element slide along its axis."""
        return bool(self.chain.upper[AXIAL] > self.chain.lower[AXIAL])

    def released(self) -> Problem:
        """Return the problem with the slide along the axis free to move."""
        return replace(self, variables=np.union1d(self.variables, [AXIAL]))

    def expecting(self, prior_sd: Array) -> Problem:
        """Return the problem under another prior [6 + 3N]."""
        return replace(self, prior_sd=prior_sd)

    def measuring(self, surface: Surface) -> Problem:
        """Return the problem with the section as it measures."""
        return replace(self, surface=surface, matcher=Matcher(surface, self.chain.segment_length_m))

    @property
    def straight(self) -> Array:
        """[6 + 3N] the design, put into the joint limits."""
        return self.chain.clip(np.zeros(self.chain.nv))


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
