"""Search cloud: the points that the start-up searches in, by what they are near to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SearchCloud:
    """A thinned cloud.

    Attributes:
        points: [P][3] of even density, element's frame.
        reach_m: how far from a chain's axis a point may lie that its surface, or what is beside that, explains.
    """

    points: Array
    reach_m: float

    def within(self, node: Array, length_m: float) -> Array:
        """Return the points [S][3] that a segment of some length from a node [3] on may reach."""
        offset = self.points - node
        radius_m = length_m + self.reach_m
        return np.asarray(self.points[np.einsum("ij,ij->i", offset, offset) < radius_m**2])

    def around(self, nodes: Array) -> Array:
        """Return the points [S][3] within reach of the axis through nodes [K][3]."""
        near = np.zeros(len(self.points), dtype=bool)
        for start, end in zip(nodes[:-1], nodes[1:], strict=True):
            axis, offset = end - start, self.points - start
            offset -= np.clip(offset @ axis / (axis @ axis), 0.0, 1.0)[:, None] * axis
            near |= np.einsum("ij,ij->i", offset, offset) < self.reach_m**2
        return np.asarray(self.points[near])
