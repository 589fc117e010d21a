"""Surface: the faces a scanner can see of one segment, and where points lie on them.

A segment is its profile's outer outline extruded along its own Z. The ends are open:
inside a member there are none, and at its ends a cap would draw points of whatever is
built against it. A face is one edge of the outline; a round section is one face.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from linear_ik.profile import Profile

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Surface:
    """Outer faces of a profile.

    Attributes:
        corners: [E][2] outline, counter-clockwise, metres.
        tangents: [E][2] unit direction of edge e, from corner e to corner e + 1.
        normals: [E][2] outward unit normal of edge e.
        widths_m: [E] length of edge e.
        radius_m: radius of a round section, whose edges are chords; else None.
    """

    corners: Array
    tangents: Array
    normals: Array
    widths_m: Array
    radius_m: float | None

    @classmethod
    def of(cls, profile: Profile) -> Surface:
        """Return the outer faces of ``profile``."""
        return cls.of_outline(profile.outline(), profile.radius_m)

    @staticmethod
    def of_outline(corners: Array, radius_m: float | None) -> Surface:
        """Return the faces of an outline [E][2], counter-clockwise."""
        edges = np.roll(corners, -1, axis=0) - corners
        widths = np.linalg.norm(edges, axis=1)
        tangents = edges / widths[:, None]
        normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
        return Surface(corners, tangents, normals, widths, radius_m)

    @cached_property
    def _sharp_corners(self) -> Array:
        """[E] 1 at a corner that sticks out sharper than a right angle, -1 at one that cuts in so, else 0.

        A point off such a corner may lie on the wrong side of its face's plane.
        """
        before, after = np.roll(self.tangents, 1, axis=0), self.tangents
        turn = np.sign(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
        return np.where(np.einsum("ij,ij->i", before, after) < 0, turn, 0.0)

    def scaled(self, scale: Array) -> Surface:
        """Return the faces of the section stretched by ``scale`` [2] along its x and y."""
        radius = None if self.radius_m is None else self.radius_m * float(scale[0])
        return self.of_outline(self.corners * scale, radius)

    def faces(self, which: npt.NDArray[np.bool_]) -> Surface:
        """Return some faces [E], of no closed outline: for distances only."""
        return Surface(self.corners[which], self.tangents[which], self.normals[which], self.widths_m[which], None)

    @property
    def size_m(self) -> Array:
        """Width and depth of the bounding box [2]."""
        return np.asarray(np.ptp(self.corners, axis=0))

    @property
    def perimeter_m(self) -> float:
        """Length of the outline (of the circle, for a round section)."""
        return float(self.widths_m.sum()) if self.radius_m is None else 2 * np.pi * self.radius_m

    @property
    def reach_m(self) -> float:
        """Distance from the axis to the farthest corner."""
        return float(np.linalg.norm(self.corners, axis=1).max())

    def at(self, s: Array) -> Array:
        """Return the points [P][2] at lengths ``s`` [P] along the outline, from its first corner.

        On a round section they lie on the circle, not on the chords.
        """
        ends = np.cumsum(self.widths_m)
        s = s * (ends[-1] / self.perimeter_m)
        edge = np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)
        xy = self.corners[edge] + (s - ends[edge] + self.widths_m[edge])[:, None] * self.tangents[edge]
        if self.radius_m is not None:
            xy *= (self.radius_m / np.linalg.norm(xy, axis=1))[:, None]
        return np.asarray(xy)

    def length_along(self, xy: Array, edge: Index) -> Array:
        """Return the length along the outline [P] of the feet of points [P][2] on their face [P]."""
        if self.radius_m is not None:
            return np.asarray(np.mod(np.arctan2(xy[:, 1], xy[:, 0]), 2 * np.pi) * self.radius_m)
        (tx, ty), (cx, cy) = self.tangents.T, self.corners.T
        along = tx[edge] * (xy[:, 0] - cx[edge]) + ty[edge] * (xy[:, 1] - cy[edge])
        starts = np.cumsum(self.widths_m) - self.widths_m
        return np.asarray(starts[edge] + np.minimum(np.maximum(along, 0.0), self.widths_m[edge]))

    def mesh(self, length_m: float) -> tuple[Array, npt.NDArray[np.uint32]]:
        """Return vertices [2E][3] and triangles [2E][3] of the open tube.

        Triangles 2e and 2e + 1 belong to face e.
        """
        n = len(self.corners)
        bottom = np.column_stack([self.corners, np.zeros(n)])
        return np.concatenate([bottom, bottom + [0, 0, length_m]]), self._triangles(n)

    def section(self, k: int) -> Surface:
        """Return the section in the middle of segment k, counted from 0: here that of every segment."""
        return self

    def segment_meshes(self, segment_length_m: Array) -> tuple[Array, npt.NDArray[np.uint32]]:
        """Return vertices [N][2E][3] of each segment, to tell faces apart, and triangles [2E][3] of all.

        Triangles 2e and 2e + 1 belong to face e. A round section has one face, whose
        residual needs no chords: a quarter of them tells the segments apart.
        """
        unit, triangles = self.of_outline(self._coarse(self.corners), self.radius_m).mesh(1.0)
        vertices = np.repeat(unit[None], len(segment_length_m), axis=0)
        vertices[:, :, 2] *= segment_length_m[:, None]
        return vertices, triangles

    def sample(self, each: int, segment_length_m: Array, rng: np.random.Generator) -> Array:
        """Return ``each`` random points on the surface of every segment [N][each][3], in its frame."""
        n = len(segment_length_m)
        xy = self.at(rng.random(n * each) * self.perimeter_m)
        z = rng.random(n * each) * np.repeat(segment_length_m, each)
        return np.column_stack([xy, z]).reshape(n, each, 3)

    def _coarse(self, corners: Array) -> Array:
        return corners if self.radius_m is None else corners[::4]

    @staticmethod
    def _triangles(n: int) -> npt.NDArray[np.uint32]:
        """Return the triangles [2n][3] of a tube on rings of n corners."""
        a = np.arange(n)
        b = (a + 1) % n
        triangles = np.stack([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])], axis=1)
        return triangles.reshape(-1, 3).astype(np.uint32)

    def offsets(self, xy: Array, edge: Index) -> tuple[Array, Array]:
        """Return the signed distance [P] of points to their face, and its gradient [P][2].

        Args:
            xy: [P][2] points in the segment's frame.
            edge: [P] face each point is matched to.

        Positive outside. Over a face the gradient is its normal; beyond a corner it
        is the unit offset from the corner, so that edges constrain too.
        """
        if self.radius_m is not None:
            rho = np.sqrt(np.einsum("ij,ij->i", xy, xy))
            return rho - self.radius_m, xy / np.maximum(rho, 1e-12)[:, None]
        x, y = xy[:, 0], xy[:, 1]
        # By component: a gather of rows and a sum over an axis of two cost three times as much.
        tx, ty, width = self.tangents[:, 0][edge], self.tangents[:, 1][edge], self.widths_m[edge]
        dx, dy = x - self.corners[:, 0][edge], y - self.corners[:, 1][edge]
        distance, along = ty * dx - tx * dy, tx * dx + ty * dy
        normal = np.empty((len(distance), 2))
        normal[:, 0], normal[:, 1] = ty, -tx
        past = along - np.minimum(np.maximum(along, 0.0), width)
        corner = np.flatnonzero(np.abs(past) > 1e-9)
        if len(corner):
            offset = distance[corner, None] * normal[corner] + past[corner, None] * self.tangents[edge[corner]]
            length = np.linalg.norm(offset, axis=1)
            sharp = self._sharp_corners[(edge[corner] + (past[corner] > 0)) % len(self.corners)]
            sign = np.where(sharp != 0, sharp, np.where(distance[corner] < 0, -1.0, 1.0))
            distance[corner] = sign * length
            normal[corner] = offset * (sign / length)[:, None]
        return distance, normal

    def distances(self, xy: Array) -> Array:
        """Return the unsigned distance of points [P][2] to the outline [P]."""
        if self.radius_m is not None:
            return np.asarray(np.abs(np.hypot(xy[:, 0], xy[:, 1]) - self.radius_m))
        best = np.full(len(xy), np.inf)
        for squared in self.squares(xy):
            np.minimum(best, squared, out=best)
        return np.asarray(np.sqrt(best))

    def squares(self, xy: Array) -> Iterator[Array]:
        """Yield the squared distance [P] of points [P][2] to each face, one after the other."""
        for corner, tangent, width in zip(self.corners, self.tangents, self.widths_m, strict=True):
            delta = xy - corner
            delta -= np.clip(delta @ tangent, 0.0, width)[:, None] * tangent
            yield np.einsum("ij,ij->i", delta, delta)
