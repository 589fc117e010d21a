"""Viewer, pairs: at each step of a fit, which place of the model's surface a scan point belongs to.

Shown on request. The pairs are the nearest places of a few hundred points, as the default method matches them;
weights do not show. Of a result they are of points that it lies on; while a fit runs, of points that are near
enough to count at that step, as far as its record says.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.stage import FARTHEST
from linear_ik.viewer_shapes import segment_triangles

Array = npt.NDArray[np.float64]

MOST_PAIRS = 300  # more lines are a grey mass
# While the fit runs, points near the design among which pairs are looked for: most are too far off to count at a step.
MOST_CANDIDATES = 3000
PAIR_COLOUR = 0xC026D3


class FittedSurface:
    """The surface of an element, to be asked for its nearest places at any pose."""

    def __init__(self, element: Element) -> None:
        """Take the element's segments, each in its own frame."""
        parts = element.segments if element.is_tapered else 1
        self._bodies = [segment_triangles(element, k) for k in range(parts)]

    def at(self, poses: Sequence[Array]) -> Any:
        """Return Open3D's scene of the segments at poses [N][4][4]; float32, so about a local origin."""
        import open3d as o3d

        scene = o3d.t.geometry.RaycastingScene()
        for k, T in enumerate(poses):
            vertices, triangles = self._bodies[k if len(self._bodies) > 1 else 0]
            placed = (vertices @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
            scene.add_triangles(o3d.core.Tensor(placed), o3d.core.Tensor(triangles.astype(np.uint32)))
        return scene

    def distances_m(self, points: Array, poses: Sequence[Array]) -> Array:
        """Return the distance of points [P][3] to the surface at poses."""
        return np.asarray(self.at(poses).compute_distance(_tensor(points)).numpy(), dtype=np.float64)

    def nearest(self, points: Array, poses: Sequence[Array]) -> Array:
        """Return the place [P][3] of the surface at poses that is nearest to each point [P][3]."""
        found = self.at(poses).compute_closest_points(_tensor(points))["points"]
        return np.asarray(found.numpy(), dtype=np.float64)


def show_pairs(vis: Any, surface: FittedSurface, points: Array, steps: Sequence[Sequence[Array]]) -> None:
    """Draw a line from each point to its place on the surface, hidden until somebody asks, a set for each step.

    Args:
        vis: meshcat's Visualizer.
        surface: of the fitted element.
        points: [P][3] those that lie on the result, in the view's coordinates; at most 300 are drawn.
        steps: poses [N][4][4] of the segments at each step.
    """
    from meshcat.geometry import LineBasicMaterial, LineSegments, PointsGeometry

    if len(points) > MOST_PAIRS:
        points = points[np.sort(np.random.default_rng(0).choice(len(points), MOST_PAIRS, replace=False))]
    line = LineBasicMaterial(color=PAIR_COLOUR)
    vis["pairs"].set_property("visible", False)
    for i, poses in enumerate(steps):
        ends = np.stack([points, surface.nearest(points, poses)], axis=1).reshape(-1, 3)
        vis[f"pairs/{i}"].set_object(LineSegments(PointsGeometry(ends.T.astype(np.float32)), line))


class LivePairs:
    """Pairs of a fit that runs, of the same points at each step."""

    def __init__(self, points: Array) -> None:
        """Choose among points [P][3] near the design, in the view's coordinates."""
        rows = np.random.default_rng(0).permutation(len(points))[:MOST_CANDIDATES]
        self._points = points[rows]
        self._surface: tuple[Element, FittedSurface] | None = None

    def show(self, vis: Any, element: Element, poses: Sequence[Array], scale_m: float) -> None:
        """Draw the pairs of a state.

        Args:
            vis: meshcat's Visualizer.
            element: the one that is fitted, with the state's number of segments.
            poses: [N][4][4] of the segments.
            scale_m: distance at which a match loses most of its weight; inf where all count.
        """
        from meshcat.geometry import LineBasicMaterial, LineSegments, PointsGeometry

        if not len(self._points):
            return
        if self._surface is None or self._surface[0] != element:
            self._surface = element, FittedSurface(element)
        places = self._surface[1].nearest(self._points, poses)
        counts = np.linalg.norm(places - self._points, axis=1) <= FARTHEST * scale_m
        rows = np.flatnonzero(counts)[:MOST_PAIRS]
        ends = np.stack([self._points[rows], places[rows]], axis=1).reshape(-1, 3)
        lines = LineSegments(PointsGeometry(ends.T.astype(np.float32)), LineBasicMaterial(color=PAIR_COLOUR))
        vis["pairs/live"].set_object(lines)


def _tensor(points: Array) -> Any:
    import open3d as o3d

    return o3d.core.Tensor(np.ascontiguousarray(points, dtype=np.float32))
