"""Body: an element at a known pose, and how far points are from its surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from linear_ik.bending import bend_element
from linear_ik.chain import Pose
from linear_ik.correspondence import Matcher
from linear_ik.element import Element
from linear_ik.result import FitResult
from linear_ik.tapered_surface import surface_of

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

POINTS_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class Body:
    """An element's outer faces where it stands; open at the ends, as the fit's are.

    Attributes:
        element: the design.
        T_world_base: [4][4].
        T_base_segment: [N][4][4].
    """

    element: Element
    T_world_base: Array
    T_base_segment: Array

    @classmethod
    def designed(cls, element: Element) -> Body:
        """Return the body as designed."""
        return cls(element, element.placement.T_world_element, bend_element(element).T_base_segment)

    @classmethod
    def fitted(cls, result: FitResult) -> Body:
        """Return the body as it was found."""
        limits = result.joint_limits_rad
        angles = np.clip(result.joint_angles_rad, limits[..., 0], limits[..., 1])
        bent = bend_element(result.fitted_element, joint_angles_rad=angles)
        return cls(result.fitted_element, result.base_pose, bent.T_base_segment)

    @cached_property
    def _matcher(self) -> Matcher:
        n = self.element.segments
        return Matcher(surface_of(self.element), np.full(n, self.element.segment_length_m))

    @cached_property
    def _pose(self) -> Pose:
        T, length_m = self.T_base_segment, self.element.segment_length_m
        nodes = np.vstack([T[:, :3, 3], T[-1, :3, 3] + length_m * T[-1, :3, 2]])
        return Pose(np.ascontiguousarray(T[:, :3, :3]), nodes, np.empty((6, 0)))

    def may_touch(self, points: Array, margin_m: float) -> Index:
        """Return the rows of points [P][3] in the body's box grown by ``margin_m``: no others are that near."""
        nodes, reach_m = self._pose.nodes_m, self._matcher.surface.reach_m + margin_m
        local = self._local(points)
        low, high = nodes.min(axis=0) - reach_m, nodes.max(axis=0) + reach_m
        return np.flatnonzero(((local >= low) & (local <= high)).all(axis=1))

    def deviations(self, points: Array, design: Body) -> Array:
        """Return how far points [P][3] on this body are from the same faces of the body as designed, along the normals.

        A point's foot here is carried to the design with its segment; what counts is the
        distance from there along the designed face's normal, positive outside. The nearest
        designed face would be another one where a thin plate has moved by more than its thickness.
        """
        out = np.empty(len(points))
        T_design = design.T_base_segment
        for start in range(0, len(points), POINTS_AT_ONCE):
            local = self._local(points[start : start + POINTS_AT_ONCE])
            pairs = self._matcher.match(self._pose, local)
            in_design = design._local(points[start : start + POINTS_AT_ONCE][pairs.order])
            foot, normal = pairs.local.copy(), np.zeros_like(pairs.local)
            normal[:, :2] = pairs.gradient
            if pairs.axial is not None:
                normal[:, 2] = pairs.axial
            foot -= pairs.residual_m[:, None] * normal
            for k in range(len(T_design)):
                rows = slice(pairs.starts[k], pairs.starts[k + 1])
                R, t = T_design[k, :3, :3], T_design[k, :3, 3]
                foot[rows], normal[rows] = foot[rows] @ R.T + t, normal[rows] @ R.T
            out[start + pairs.order] = np.einsum("pi,pi->p", normal, in_design - foot)
        return out

    def _local(self, points: Array) -> Array:
        return np.asarray((points - self.T_world_base[:3, 3]) @ self.T_world_base[:3, :3])

    def distances(self, points: Array) -> tuple[Array, Array, Index]:
        """Return how far points [P][3] of the scan's coordinates are from the surface.

        Returns:
            Signed distance to the nearest face [P], positive outside; distance to the nearest
            point of the surface [P], which beyond an end is larger; segment of that face [P].
        """
        signed, nearest = np.empty(len(points)), np.empty(len(points))
        segment = np.empty(len(points), dtype=np.intp)
        for start in range(0, len(points), POINTS_AT_ONCE):
            pairs = self._matcher.match(self._pose, self._local(points[start : start + POINTS_AT_ONCE]))
            rows = start + pairs.order
            signed[rows], nearest[rows], segment[rows] = pairs.residual_m, pairs.distance_m, pairs.segment
        return signed, nearest, segment
