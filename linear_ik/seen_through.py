"""Seen through: segments that stand where the scanner looked through to something behind.

Every point says that the way from its station to it is empty. A fitted segment in that
way is not where the fit says. Points anywhere behind the element tell, not only those
near it; without stations nothing is known, and nothing computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.problem import Problem
from linear_ik.scan import Scan

Array = npt.NDArray[np.float64]
Count = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]
Refuter = Callable[[Array, int], bool]
"""Whether it cannot be: of variables [6 + 3N], and how many segments of the chain there are so far."""

MOST_RAYS = 30_000
POINTS_A_PASS = 65_536  # what a core keeps in its cache
MARGIN = 4.0  # deviations of the noise
BEAM_M, BEAM_RAD = 0.002, 0.00015  # radius of a laser's beam at the station, and how it widens
AROUND = 6  # rays beside each one, as far away as the margin
LEAST_RAYS, LEAST_SHARE = 12, 0.1  # of the rays that meet a segment, to contradict it
COMPANY, OF_NEAREST = 3, 6  # rays next to one that end on the same surface
STEEPEST = 4.0  # slope of that surface against the rays


@dataclass(frozen=True, eq=False)
class Crossings:
    """Rays that meet a fitted body, by the segment that they meet first.

    Attributes:
        met: [N] rays whose way to their point, or what is just behind it, leads into the segment.
        through: [N] those of them that enter and leave the body well before their point.
    """

    met: Count
    through: Count

    @property
    def contradicted(self) -> Mask:
        """[N] segments that cannot be where they are."""
        return np.asarray((self.through >= LEAST_RAYS) & (self.through > LEAST_SHARE * self.met))


def seen_through(problem: Problem, scan: Scan, pose: Pose, noise_m: float, seed: int) -> Mask:
    """Return the segments [N] of a fitted chain that the scanner saw through.

    Args:
        problem: for the section as it measures, and the element's frame.
        scan: all points, the scan's coordinates.
        pose: of the fitted chain, element's frame.
        noise_m: standard deviation of a point about the surface.
        seed: of the choice of points.
    """
    if scan.stations is None or scan.station_index is None:
        return np.zeros(pose.n_segments, dtype=bool)
    rays = rays_near(scan, problem, pose.nodes_m, seed)
    return crossings(problem, pose, rays, noise_m).contradicted


def refuter(problem: Problem, scan: Scan, noise_m: float, seed: int) -> Refuter | None:
    """Return what says whether rays pass through a chain grown so far, or None where no station is known.

    Arguments as of `seen_through`.
    """
    if scan.stations is None:
        return None
    rays = rays_near(scan, problem, problem.chain.pose(problem.designed).nodes_m, seed)

    def refuted(x: Array, grown: int) -> bool:
        return bool(crossings(problem, problem.chain.pose(x), rays, noise_m, grown).contradicted.any())

    return refuted


@dataclass(frozen=True, eq=False)
class Rays:
    """Ways that are empty, element's frame.

    Attributes:
        stations: [R][3] where each begins.
        points: [R][3] where it ends.
    """

    stations: Array
    points: Array

    @cached_property
    def range_m(self) -> Array:
        """[R] length."""
        return np.asarray(np.linalg.norm(self.points - self.stations, axis=1))

    @cached_property
    def ahead(self) -> Array:
        """[R][3] unit vectors."""
        return np.asarray((self.points - self.stations) / np.maximum(self.range_m, 1e-9)[:, None])


def rays_near(scan: Scan, problem: Problem, nodes_m: Array, seed: int) -> Rays:
    """Return rays that may meet a chain with nodes [N+1][3], element's frame.

    These are at most 30,000, each a random choice of the scan's points that lie behind the
    sphere about the chain, or in it, as their station sees it. The scan is gone through in
    passes over every n-th point, until there are enough of them.
    """
    assert scan.stations is not None and scan.station_index is not None
    T = problem.element.placement.T_world_element
    middle = 0.5 * (nodes_m.min(axis=0) + nodes_m.max(axis=0))
    radius_m = float(np.linalg.norm(nodes_m - middle, axis=1).max()) + problem.surface.reach_m
    towards = T[:3, :3] @ middle + T[:3, 3] - scan.stations
    away_m = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    towards /= away_m[:, None]
    # From inside the sphere every direction leads through it.
    cosine = np.where(away_m > radius_m, np.sqrt(np.maximum(1.0 - (radius_m / away_m) ** 2, 0.0)), -1.0)
    rng = np.random.default_rng(seed)
    step = -(-len(scan) // POINTS_A_PASS)
    rows, count = [np.empty(0, dtype=np.intp)], 0
    for start in rng.permutation(step):
        seen_from = scan.station_index[start::step] if len(scan.stations) > 1 else 0
        x, y, z = (scan.points[start::step, i] - scan.stations[seen_from, i] for i in range(3))
        ahead_m = x * towards[seen_from, 0] + y * towards[seen_from, 1] + z * towards[seen_from, 2]
        squared = x * x + y * y + z * z
        # Points before the sphere say nothing of what is in it.
        behind = squared > (np.maximum(away_m - radius_m, 0.0) ** 2)[seen_from]
        found = np.flatnonzero(behind & (ahead_m >= cosine[seen_from] * np.sqrt(squared)))
        rows.append(start + step * found)
        count += len(found)
        if count >= MOST_RAYS:
            break
    chosen = np.concatenate(rows)
    if count > MOST_RAYS:
        chosen = rng.choice(chosen, MOST_RAYS, replace=False)
    stations = scan.stations[scan.station_index[chosen]]
    return Rays((stations - T[:3, 3]) @ T[:3, :3], (scan.points[chosen] - T[:3, 3]) @ T[:3, :3])


def crossings(problem: Problem, pose: Pose, rays: Rays, noise_m: float, grown: int | None = None) -> Crossings:
    """Count the rays that meet the body of each segment, and those that pass through it.

    A ray passes through only where the rays around it do as well, as far away as 4 deviations
    and the radius of the beam: a ray that grazes an edge tells nothing. So much before the point,
    too, they must have left the body. Mixed pixels, which lie between an edge and what is behind
    it, are told by their neighbours where it would matter: these lie on either.

    Args:
        problem: for the section.
        pose: of the chain, element's frame.
        rays: past it and through it.
        noise_m: standard deviation of a point about the surface.
        grown: how many segments there are so far; all, unless given.
    """
    range_m, ahead = rays.range_m, rays.ahead
    margin_m = MARGIN * noise_m + BEAM_M + BEAM_RAD * range_m
    body = _Body(problem, pose, grown)
    hit_m, segment, faces_ray = body.first_hit(rays.stations, ahead)
    met = faces_ray & (hit_m < range_m + margin_m)
    rows = np.flatnonzero(met & (hit_m < range_m - margin_m))
    for turn in (None, *np.arange(AROUND) * (2 * np.pi / AROUND)):
        margin, u = margin_m[rows, None], ahead[rows]
        start = rays.points[rows] - margin * u
        if turn is not None:
            start += margin * _beside(u, float(turn))
        # Looking back from there, the next face must be one where a ray leaves the body.
        left_m, _, faces_point = body.first_hit(start, -u)
        rows = rows[faces_point & (left_m < range_m[rows])]
    n = pose.n_segments
    found = Crossings(np.bincount(segment[met], minlength=n), np.bincount(segment[rows], minlength=n))
    if not found.contradicted.any():
        return found
    rows = rows[in_company(rays, rows)]
    return replace(found, through=np.bincount(segment[rows], minlength=n))


def in_company(rays: Rays, rows: Count) -> Mask:
    """Return which of the rays in ``rows`` [K] end on a surface, as half of their station's next to them do."""
    from scipy.spatial import cKDTree

    _, seen_from = np.unique(rays.stations, axis=0, return_inverse=True)
    # Rays of other stations are no neighbours: farther than any direction.
    key = np.column_stack([rays.ahead, 10.0 * seen_from.reshape(-1)])
    tree = cKDTree(key, balanced_tree=False, compact_nodes=False)
    # The first is the ray itself.
    apart, beside = (np.asarray(found)[:, 1:] for found in tree.query(key[rows], OF_NEAREST + 1))
    known = apart <= 2.0  # as far as two directions can be apart
    other_m = rays.range_m[np.where(known, beside, 0)]
    own_m = rays.range_m[rows, None]
    near = known & (np.abs(other_m - own_m) < STEEPEST * apart * own_m)
    return np.asarray(OF_NEAREST * near.sum(axis=1) >= COMPANY * known.sum(axis=1))


class _Body:
    """The outer faces of a posed chain, ready for rays."""

    def __init__(self, problem: Problem, pose: Pose, grown: int | None) -> None:
        import open3d as o3d

        self._tensor, self._each = o3d.core.Tensor, problem.matcher.triangles
        self._scene = problem.matcher.posed(pose, segments=grown)

    def first_hit(self, start: Array, ahead: Array) -> tuple[Array, Count, Mask]:
        """Return how far rays [R] get, in which segment (from 0), and whether the face there looks towards the start.

        Rays that meet nothing get infinitely far, and face nothing.
        """
        hit = self._scene.cast_rays(self._tensor(np.hstack([start, ahead]).astype(np.float32)))
        far_m = hit["t_hit"].numpy().astype(np.float64)
        faces = np.isfinite(far_m) & (np.einsum("ij,ij->i", hit["primitive_normals"].numpy(), ahead) < 0)
        segment = np.where(faces, hit["primitive_ids"].numpy() // np.uint32(self._each), 0)
        return far_m, segment.astype(np.intp), faces


def _beside(ahead: Array, turn_rad: float) -> Array:
    """Return unit vectors [R][3] across rays [R][3], turned about them."""
    first = np.cross(ahead, np.eye(3)[np.abs(ahead).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.asarray(np.cos(turn_rad) * first + np.sin(turn_rad) * np.cross(ahead, first))
