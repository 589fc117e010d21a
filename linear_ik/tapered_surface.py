"""Tapered surface: the faces of a segment whose section varies linearly along the element.

Faces lean against the axis, so their normals have an axial part, and a slide along the
axis is seen. Residuals are exact on flat faces, on edges and on cones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Triangles = npt.NDArray[np.uint32]


class Feet(NamedTuple):
    """Where points lie against their faces.

    Attributes:
        residual_m: [P] signed distance, positive outside.
        gradient: [P][2] its direction, the part in the section's plane.
        axial: [P] the part along the axis.
        section: [P][2] the point, seen from its face as the mean section draws it.
    """

    residual_m: Array
    gradient: Array
    axial: Array
    section: Array


@dataclass(frozen=True, eq=False)
class TaperedSurface(Surface):
    """Outer faces of a section that varies linearly.

    As a `Surface` it is the section in the middle of the element's length.

    Attributes:
        slopes: [E][2] movement of corner e for each metre along the axis.
        radius_slope: of the radius of a round section, else 0.
        length_m: of the element.
        segments: N.
    """

    slopes: Array
    radius_slope: float
    length_m: float
    segments: int

    def scaled(self, scale: Array) -> TaperedSurface:
        """Return the faces of all sections stretched by ``scale`` [2] along their x and y."""
        mean, s = super().scaled(scale), float(scale[0])
        return _tapered(mean, self.slopes * scale, self.radius_slope * s, self.length_m, self.segments)

    @property
    def reach_m(self) -> float:
        """Distance from the axis to the farthest corner, at either end."""
        ends = (self._corners_at(share * self.length_m) for share in (0.0, 1.0))
        return max(float(np.linalg.norm(corners, axis=1).max()) for corners in ends)

    def section(self, k: int) -> Surface:
        """Return the section in the middle of segment k, counted from 0."""
        station_m = (k + 0.5) / self.segments * self.length_m
        radius_m = None if self.radius_m is None else self._radius_at(station_m)
        return self.of_outline(self._corners_at(station_m), radius_m)

    def segment_meshes(self, segment_length_m: Array) -> tuple[Array, Triangles]:
        """Return vertices [N][2E][3] of each segment, and triangles [2E][3] as `Surface.segment_meshes` does."""
        ends = np.cumsum(segment_length_m)
        meshes = []
        for begin, end in zip(ends - segment_length_m, ends, strict=True):
            rings = [self._coarse(self._corners_at(station)) for station in (begin, end)]
            z = np.repeat([0.0, end - begin], len(rings[0]))
            meshes.append(np.column_stack([np.concatenate(rings), z]))
        return np.stack(meshes), self._triangles(len(meshes[0]) // 2)

    def sample(self, each: int, segment_length_m: Array, rng: np.random.Generator) -> Array:
        """Return ``each`` points on the surface of every segment [N][each][3], uniform by area on each."""
        share = rng.random((2, len(segment_length_m), each))
        return np.stack([self.on_segment(k, *share[:, k])[0] for k in range(len(segment_length_m))])

    def on_segment(self, k: int, around: Array, along: Array) -> tuple[Array, Array]:
        """Return points [P][3] on segment k, counted from 0, and their outward unit normals [P][3].

        Args:
            k: segment.
            around: [P] share of the way around the section.
            along: [P] share of the face's area between the segment's start and the point.
        """
        length_m = self.length_m / self.segments
        begin, end = k * length_m, (k + 1) * length_m
        if self.radius_m is not None:
            first, last = self._radius_at(begin), self._radius_at(end)
            t = _share_of_length(np.full(len(around), first), np.full(len(around), last), along)
            radial = np.column_stack([np.cos(2 * np.pi * around), np.sin(2 * np.pi * around)])
            xy, normals = ((1 - t) * first + t * last)[:, None] * radial, radial
            slope = np.full(len(around), self.radius_slope)
        else:
            section = self.section(k)
            ends = np.cumsum(section.widths_m)
            s = around * ends[-1]
            edge = np.minimum(np.searchsorted(ends, s, side="right"), len(ends) - 1)
            share = (s - ends[edge] + section.widths_m[edge]) / section.widths_m[edge]
            next_one = (edge + 1) % len(ends)
            rings = [self._corners_at(station) for station in (begin, end)]
            a, b = (ring[edge] for ring in rings)
            c, d = (ring[next_one] for ring in rings)
            t = _share_of_length(np.linalg.norm(c - a, axis=1), np.linalg.norm(d - b, axis=1), along)[:, None]
            xy = (1 - share)[:, None] * ((1 - t) * a + t * b) + share[:, None] * ((1 - t) * c + t * d)
            normals, t = section.normals[edge], t[:, 0]
            lean = (1 - share)[:, None] * self.slopes[edge] + share[:, None] * self.slopes[next_one]
            slope = np.einsum("ij,ij->i", normals, lean)
        cosine = 1.0 / np.sqrt(1.0 + slope**2)
        return np.column_stack([xy, t * length_m]), np.column_stack([normals, -slope]) * cosine[:, None]

    def residuals(self, local: Array, face: Index, begin_m: Array) -> Feet:
        """Return where points lie against their faces.

        With s the slope of the face against the axis the plane's normal is
        ``(n, -s) / sqrt(1 + s^2)``, n its normal in the section; beyond an edge the
        direction is the unit offset from that edge, a line in space.

        Args:
            local: [P][3] points in their segment's frame.
            face: [P] face each point is matched to.
            begin_m: [P] where along the element the point's segment begins.
        """
        xy, station = local[:, :2], begin_m + local[:, 2] - self.length_m / 2
        if self.radius_m is not None:
            rho = np.sqrt(np.einsum("ij,ij->i", xy, xy))
            radial = xy / np.maximum(rho, 1e-12)[:, None]
            off = rho - self.radius_m - self.radius_slope * station
            cosine = 1.0 / np.sqrt(1.0 + self.radius_slope**2)
            axial = np.full(len(rho), -self.radius_slope * cosine)
            return Feet(off * cosine, radial * cosine, axial, radial * (self.radius_m + off)[:, None])
        next_one = (face + 1) % len(self.corners)
        start, tangent, width = self._edges_at(station, face, next_one)
        normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        delta = xy - start
        off, along = np.einsum("ij,ij->i", normal, delta), np.einsum("ij,ij->i", tangent, delta)
        share = np.clip(along / width, 0.0, 1.0)[:, None]
        slope = np.einsum("ij,ij->i", normal, (1 - share) * self.slopes[face] + share * self.slopes[next_one])
        cosine = 1.0 / np.sqrt(1.0 + slope**2)
        residual, gradient, axial = off * cosine, normal * cosine[:, None], -slope * cosine
        section = self.corners[face] + (along * self.widths_m[face] / width)[:, None] * self.tangents[face]
        section += off[:, None] * self.normals[face]

        # Whether a point is past an edge shows at its foot on the face, which is farther along the axis.
        start, tangent, width = self._edges_at(station - residual * axial, face, next_one)
        foot = np.einsum("ij,ij->i", tangent, xy - residual[:, None] * gradient - start)
        past = foot - np.clip(foot, 0.0, width)
        rows = np.flatnonzero(np.abs(past) > 1e-9)
        if len(rows):
            corner = np.where(past[rows] > 0, next_one[rows], face[rows])
            line = np.column_stack([self.slopes[corner], np.ones(len(rows))])
            offset = np.zeros((len(rows), 3))
            offset[:, :2] = xy[rows] - self.corners[corner] - station[rows, None] * self.slopes[corner]
            offset -= (np.einsum("ij,ij->i", offset, line) / np.einsum("ij,ij->i", line, line))[:, None] * line
            length = np.linalg.norm(offset, axis=1)
            sharp = self._sharp_corners[corner]
            sign = np.where(sharp != 0, sharp, np.where(off[rows] < 0, -1.0, 1.0))
            residual[rows] = sign * length
            direction = offset * (sign / length)[:, None]
            gradient[rows], axial[rows] = direction[:, :2], direction[:, 2]
        return Feet(residual, gradient, axial, section)

    def _edges_at(self, station_m: Array, face: Index, next_one: Index) -> tuple[Array, Array, Array]:
        """Return start [P][2], unit direction [P][2] and width [P] of edges, by their place from the middle."""
        start = self.corners[face] + station_m[:, None] * self.slopes[face]
        edge = self.corners[next_one] + station_m[:, None] * self.slopes[next_one] - start
        width = np.maximum(np.sqrt(np.einsum("ij,ij->i", edge, edge)), 1e-12)
        return start, edge / width[:, None], width

    def _corners_at(self, station_m: float) -> Array:
        return np.asarray(self.corners + (station_m - self.length_m / 2) * self.slopes)

    def _radius_at(self, station_m: float) -> float:
        return (self.radius_m or 0.0) + (station_m - self.length_m / 2) * self.radius_slope


def surface_of(element: Element, scale: tuple[float, float] | None = None) -> Surface:
    """Return the outer faces of an element's section, tapered or not.

    Args:
        element: for its profiles.
        scale: [2] along the section's x and y, where it measures otherwise than designed.
    """
    if scale is not None:
        return surface_of(element).scaled(np.array(scale))
    mean = Surface.of(element.profile_at(0.5))
    if not element.is_tapered:
        return mean
    length_m = element.segments * element.segment_length_m
    start, end = element.profile_at(0.0), element.profile_at(1.0)
    slopes = (end.outline() - start.outline()) / length_m
    radii = (start.radius_m or 0.0, end.radius_m or 0.0)
    return _tapered(mean, slopes, (radii[1] - radii[0]) / length_m, length_m, element.segments)


def _tapered(mean: Surface, slopes: Array, radius_slope: float, length_m: float, segments: int) -> TaperedSurface:
    drawn = mean.corners, mean.tangents, mean.normals, mean.widths_m, mean.radius_m
    return TaperedSurface(*drawn, slopes, radius_slope, length_m, segments)


def _share_of_length(first: Array, last: Array, share: Array) -> Array:
    """Return how far along trapezoids, ``first`` to ``last`` wide, ``share`` of their area lies (0 to 1)."""
    return np.asarray(share * (first + last) / (first + np.sqrt(first**2 + share * (last**2 - first**2))))
