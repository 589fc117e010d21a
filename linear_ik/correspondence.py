"""Correspondences: which face of which segment each scan point lies on.

Scan point to model surface, by Open3D's closest-point query on the bent chain: the
other direction (the paper's 3.2) invents a match wherever the scan has a hole.
Neither normals nor stations are needed; where stations are known, no point is given to a
face that looks away from its station.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.sights import Sights
from linear_ik.surface import Surface
from linear_ik.tapered_surface import TaperedSurface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

# Cosine of the view to a face that is taken for turned away: 3 degrees beyond grazing, for a pose that is not final.
TURNED_AWAY = -0.05


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches of P points, sorted by segment; all geometry in the segments' own frames.

    Attributes:
        order: [P] row of the point in the array that was matched.
        starts: [N+1] first match of each segment, and P.
        face: [P] edge of the outline; without meaning on a round section.
        local: [P][3] point in its segment's frame.
        residual_m: [P] signed distance to the face, positive outside.
        gradient: [P][2] direction of that distance in the section's plane.
        distance_m: [P] distance to the nearest point of the (finite) surface.
        axial: [P] the gradient's part along the axis, where the section tapers; else None.
        untapered: [P][2] see `section`, where the section tapers; else None.
    """

    order: Index
    starts: Index
    face: Index
    local: Array
    residual_m: Array
    gradient: Array
    distance_m: Array
    axial: Array | None = None
    untapered: Array | None = None

    @property
    def section(self) -> Array:
        """[P][2] the point in the section that the surface draws: its x and y, less the taper up to there."""
        return self.local[:, :2] if self.untapered is None else self.untapered

    @property
    def segment(self) -> Index:
        """[P] segment of each match, counted from 0."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))


class Matcher:
    """Finds the nearest lateral face of a bent chain for each point.

    Single precision inside Open3D decides only which face is meant; residuals are
    computed on the exact faces in double precision.
    """

    def __init__(
        self,
        surface: Surface,
        segment_length_m: Array,
        sights: Sights | None = None,
        handicap_m2: Array | None = None,
    ) -> None:
        """Prepare the meshes of the segments; their poses come with each query, the points' stations once.

        Args:
            surface: of every segment.
            segment_length_m: [N].
            sights: the points' stations.
            handicap_m2: [E] or [N][E] of each face, of each segment, added to its squared distance from a point before
                the least is taken; inf for a face that nobody saw. None: the nearest face is taken.
        """
        import open3d as o3d

        self._core = o3d.core
        self._scene = o3d.t.geometry.RaycastingScene
        self.surface = surface
        # A round section has one face: nothing to choose from.
        self.sights = sights if surface.radius_m is None else None
        many = (len(segment_length_m), len(surface.normals))
        self.handicap_m2 = None if handicap_m2 is None else np.broadcast_to(handicap_m2, many)
        self.segment_length_m = segment_length_m
        self._begin_m = np.cumsum(segment_length_m) - segment_length_m
        self._meshes, self._triangles = surface.segment_meshes(segment_length_m)

    def match(self, pose: Pose, points: Array, segments: int | None = None, first: int = 0) -> Correspondences:
        """Match ``points`` [P][3] (element's frame) to segments ``first`` to ``segments`` - 1 of the chain."""
        n = pose.n_segments if segments is None else segments
        triangle = self._nearest_triangle(pose, points, first, n)
        segment, triangle = np.divmod(triangle, np.uint32(len(self._triangles)))
        # Few segments sort by radix, in one pass over bytes.
        order = np.argsort((segment + first).astype(np.uint8 if n < 256 else np.uint16), kind="stable")
        starts = np.zeros(n + 1, dtype=np.intp)
        np.cumsum(np.bincount(segment, minlength=n - first), out=starts[first + 1 :])
        face = (triangle[order] // 2).astype(np.intp)
        local = points[order].astype(np.float64, copy=False)
        beyond = np.empty(len(local))
        for k in range(first, n):
            rows = slice(starts[k], starts[k + 1])
            local[rows] = (local[rows] - pose.nodes_m[k]) @ pose.rotations[k]
            z = local[rows, 2]
            np.subtract(z, np.clip(z, 0.0, self.segment_length_m[k]), out=beyond[rows])
        if self.sights is not None or self.handicap_m2 is not None:
            face = self._seen(pose, points[order], starts, local, face)
        axial, untapered = None, None
        if isinstance(self.surface, TaperedSurface):
            begin_m = np.repeat(self._begin_m[:n], np.diff(starts))
            residual, gradient, axial, untapered = self.surface.residuals(local, face, begin_m)
        else:
            residual, gradient = self.surface.offsets(local[:, :2], face)
        distance = np.sqrt(residual * residual + beyond * beyond)
        return Correspondences(order, starts, face, local, residual, gradient, distance, axial, untapered)

    def _seen(self, pose: Pose, points: Array, starts: Index, local: Array, face: Index) -> Index:
        """Return the faces [P], where they look away from the point's station or have a handicap perhaps another's.

        Args:
            pose: of the chain.
            points: [P][3] element's frame.
            starts: [N+1] first match of each segment, and P.
            local: [P][3] points in their segment's frame.
            face: [P] nearest to each.
        """
        normals, sight, away = self.surface.normals, None, np.zeros(len(local), dtype=bool)
        if self.sights is not None:
            stations, sight = self.sights.stations_of(points), np.empty((len(local), 2))
            for k in range(len(starts) - 1):
                rows = slice(starts[k], starts[k + 1])
                seen_from = (stations[rows] - pose.nodes_m[k]) @ pose.rotations[k]
                seen_from -= local[rows]
                sight[rows] = seen_from[:, :2] / np.linalg.norm(seen_from, axis=1, keepdims=True)
            away = np.einsum("pi,pi->p", normals[face], sight) < TURNED_AWAY
        handicap_m2 = np.zeros((len(starts) - 1, len(normals))) if self.handicap_m2 is None else self.handicap_m2
        # The nearest face loses to none that is farther and has no less of a handicap.
        segment = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        handicapped = handicap_m2 > handicap_m2.min(axis=1, keepdims=True)
        which = np.flatnonzero(away | handicapped[segment, face])
        best, least_m2 = face[which], np.full(len(which), np.inf)
        for e, squared in enumerate(self.surface.squares(local[which, :2])):
            squared += handicap_m2[segment[which], e]
            if sight is not None:
                squared[sight[which] @ normals[e] < TURNED_AWAY] = np.inf
            better = squared < least_m2
            best[better], least_m2[better] = e, squared[better]
        face = face.copy()
        face[which] = best
        return face

    def posed(self, pose: Pose, first: int = 0, segments: int | None = None) -> Any:
        """Return Open3D's scene of segments ``first`` to ``segments`` - 1 of a posed chain, mesh after mesh."""
        corners, meshes = self._meshes.shape[1], self._meshes[first:segments]
        n = first + len(meshes)
        vertices = meshes @ pose.rotations[first:n].transpose(0, 2, 1) + pose.nodes_m[first:n, None]
        each = np.arange(0, len(meshes) * corners, corners, dtype=np.uint32)
        triangles = (self._triangles + each[:, None, None]).reshape(-1, 3)
        scene, tensor = self._scene(nthreads=0), self._core.Tensor
        scene.add_triangles(tensor(vertices.reshape(-1, 3).astype(np.float32)), tensor(triangles))
        return scene

    @property
    def triangles(self) -> int:
        """Triangles of one segment in the scene."""
        return len(self._triangles)

    def _nearest_triangle(self, pose: Pose, points: Array, first: int, n: int) -> npt.NDArray[np.uint32]:
        """Return the nearest triangle [P] of segments ``first`` to n - 1."""
        query = self._core.Tensor(np.ascontiguousarray(points, dtype=np.float32))
        hit = self.posed(pose, first, n).compute_closest_points(query)
        return np.asarray(hit["primitive_ids"].numpy())
