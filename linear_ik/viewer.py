"""Viewer: the designed, the scanned and the fitted element in a browser (meshcat).

The solver knows nothing of it: `Viewer.on_iteration` is one of the callables that
`linear_ik.fit` may be given.
"""

from __future__ import annotations

import math
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import write_atomically
from linear_ik.chain import Chain
from linear_ik.element import Element
from linear_ik.result import FitResult, IterationRecord
from linear_ik.scan import Scan
from linear_ik.viewer_camera import seen_side, turn_camera
from linear_ik.viewer_cloud import SCANNED, colours_of, largest_shown_m, near, ramp, rows_shown
from linear_ik.viewer_page import Scene
from linear_ik.viewer_pairs import FittedSurface, LivePairs, show_pairs
from linear_ik.viewer_playback import Playback
from linear_ik.viewer_result import (
    FPS,
    JOINT_COLOUR,
    colour_segments,
    play_back,
    show_ellipsoids,
    show_joints,
    steps_of,
)
from linear_ik.viewer_shapes import (
    design_body,
    designed_nodes_m,
    material,
    segment_bodies,
    transform,
)

Array = npt.NDArray[np.float64]

LEAST_BETWEEN_S = 0.08  # of a search's states: twelve a second, more than an eye tells apart
FITTED_OPACITY, DESIGNED_OPACITY = 0.5, 0.35  # the points inside both are seen, and the fit before the design
DESIGNED, FITTED = 0xFFFFFF, 0x35B24A
# As three.js draws axes.
AXES = "linear-gradient(90deg, #f60 33%, #3f0 33% 66%, #06f 66%)"
POINT_SHARE = 1 / 400  # of the length: a point's size, 2 pixels where the member fills a screen


class Viewer:
    """A scene of one element: designed (white, translucent), scan, fitted (green).

    Coordinates are shown about a local origin, the first thing shown, because browsers
    compute in single precision.
    """

    def __init__(self, title: str = "linear_ik") -> None:
        """Start with an empty scene; nothing is served yet."""
        from meshcat import Visualizer

        self.scene = Scene(title)
        self._vis = Visualizer(window=self.scene)
        self._origin: Array | None = None
        self._element: Element | None = None
        self._chain: tuple[Element, Chain] | None = None
        self._fitted: Element | None = None
        self._playback: Playback | None = None
        self._shown_s = -math.inf
        self._shown: Array = np.empty((0, 3))
        self._pairs: LivePairs | None = None
        self._vis["/Background"].set_property("top_color", [0.45, 0.50, 0.56])
        self._vis["/Background"].set_property("bottom_color", [0.16, 0.18, 0.21])

    def show_design(self, element: Element) -> None:
        """Show an element as designed, and turn the camera to it."""
        self._element = element
        T = element.placement.T_world_element
        start, end = designed_nodes_m(element)[[0, -1]]
        self._look_at(start, end, T[:3, 0] + T[:3, 1])
        self._vis["design"].set_object(design_body(element), material(DESIGNED, DESIGNED_OPACITY))
        T_view = transform(T[:3, :3], self._local(T[:3, 3]))
        self._vis["design"].set_transform(T_view)
        self._vis["/Axes"].set_transform(T_view)
        self._caption("#ffffff", f"designed: {element.name}")
        self._caption(AXES, "axes: its local X red, Y green, Z blue, from its start")

    def show_scan(self, scan: Scan, distances_m: Array | None = None, largest_m: float = 0.005) -> None:
        """Show a scan, at most 200,000 points of it.

        Args:
            scan: the points.
            distances_m: [P] distance of each to the fitted surface; blue at 0, red at
                ``largest_m``, grey from ten times that on. None shows them all alike.
            largest_m: upper end of the colours.
        """
        from meshcat.geometry import PointCloud

        rows = rows_shown(scan.points, self._element)
        points = scan.points[rows]
        if self._origin is None:
            self._look_at(points.min(axis=0), points.max(axis=0), np.array([1.0, 1.0, 0.0]))
        local = self._local(points)
        colours, on_element = np.tile(SCANNED, (len(points), 1)), np.ones(len(points), dtype=bool)
        if distances_m is not None:
            colours, on_element = colours_of(np.asarray(distances_m)[rows] / largest_m)
        extent = self._element.length_m if self._element else float(np.ptp(local, axis=0).max())
        size = max(POINT_SHARE * extent, 1e-4)
        self._vis["scan"].set_object(PointCloud(local.T.astype(np.float32), colours.T.astype(np.float32), size=size))
        self._caption("#bfc7d1", f"scanned: {len(scan):,} points")
        if distances_m is not None:
            steps = f"yellow {500 * largest_m:g} mm off, red {1000 * largest_m:g} mm, grey elsewhere"
            self._caption(ramp(), f"points: blue on the fitted surface, {steps}")
        self._shown, self._pairs = points, None
        self._turn_to_seen_side(points[on_element])

    def show_fit(self, element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike) -> None:
        """Show an element bent.

        Args:
            element: what was designed.
            q: [3N] Pinocchio's configuration, (z, y, x) a segment.
            base_pose: T_world_base [4][4].
        """
        if self._element is None:
            self._element = element
        if self._origin is None:
            nodes = self._chain_of(element).nodes(q) @ np.asarray(base_pose)[:3, :3].T + np.asarray(base_pose)[:3, 3]
            self._look_at(nodes[0], nodes[-1], np.asarray(base_pose)[:3, :2].sum(axis=1))
        if self._fitted != element:
            self._vis["fitted"].delete()
            green = material(FITTED, FITTED_OPACITY)
            for k, body in enumerate(segment_bodies(element)):
                self._vis[f"fitted/{k + 1}"].set_object(body, green)
            show_joints(self._vis, element)
            self._fitted = element
            self._caption("#35b24a", "fitted")
            self._caption(f"#{JOINT_COLOUR:06x}", "joints")
        for k, T in enumerate(self._poses(element, q, base_pose)):
            self._vis[f"fitted/{k + 1}"].set_transform(T)

    def show_result(self, result: FitResult, scan: Scan | None = None) -> None:
        """Show a design and what became of it, the scan coloured by its distance to that."""
        self.catch_up()
        on_surface: Array = np.empty((0, 3))
        self.show_design(result.element)
        found = result.status != "not_scanned"
        if scan is not None:
            largest_m = largest_shown_m(result.range_noise_m)
            distances_m = self._distances(result, scan) if found else None
            if distances_m is not None:
                on_surface = self._local(scan.points[distances_m < largest_m])
            self.show_scan(scan, distances_m, largest_m)
        if found:
            self.show_fit(result.fitted_element, result.q, result.base_pose)
            lines = colour_segments(self._vis, result, segment_bodies(result.fitted_element), FITTED_OPACITY)
            ellipsoids = show_ellipsoids(self._vis, result, self._local)
            for colour, text in [*lines, *([ellipsoids] if ellipsoids else [])]:
                self._caption(colour, text)
            steps = steps_of(result)
            poses = [self._poses(result.fitted_element, q, base_pose) for _, q, base_pose in steps]
            self._vis["pairs"].delete()
            if len(on_surface):
                show_pairs(self._vis, FittedSurface(result.fitted_element), on_surface, poses)
            play_back(self._vis, poses)
            self.scene.tell("steps", labels=[label for label, _, _ in steps], fps=FPS, pairs=len(on_surface) > 0)
        self._caption(None, "status: " + result.status + "".join(f"\n{reason}" for reason in result.reasons))

    def on_iteration(self, record: IterationRecord) -> None:
        """Show the state after one iteration; give it to `linear_ik.fit`. Costs nothing while nobody follows it."""
        if self._element is None or not self.scene.is_seen():
            return
        # A search has hundreds of short iterations, more than an eye can tell apart.
        if record.phase == "search" and time.monotonic() - self._shown_s < LEAST_BETWEEN_S:
            return
        if self._playback is None:
            self._show_record(record)
        else:
            self._playback.put(record)
        self._shown_s = time.monotonic()

    def slow_down(self, pause_s: float = 0.08, total_s: float = 10.0) -> None:
        """Show states no faster than an eye follows; the fit goes on meanwhile.

        Args:
            pause_s: how long each is shown at least.
            total_s: over all of them; what is left then is shown at once.
        """
        if self._playback is None:
            self._playback = Playback(self._show_record, pause_s, total_s)

    def catch_up(self) -> None:
        """Wait until all states are shown that `on_iteration` was given."""
        if self._playback is not None:
            self._playback.finish()
            self._playback = None

    def follow_pairs(self, shown: bool = False) -> None:
        """Offer the pairs of scan points and surface while a fit runs; they are drawn where somebody asks for them.

        Args:
            shown: from the start, until whoever looks says otherwise.
        """
        self.scene.wanted = frozenset({"pairs"} if shown else ())
        self.scene.tell("live", pairs=shown)

    def _show_record(self, record: IterationRecord) -> None:
        element = self._element
        if element is None:
            return
        if len(record.q) != 3 * element.segments:
            # The fit tries how many segments there are, and may be at another number than what is shown.
            element = replace(element, segments=len(record.q) // 3, auto_segments=False)
        self.show_fit(element, record.q, record.base_pose)
        if self.scene.asked_for("pairs"):
            if self._pairs is None:
                self._pairs = LivePairs(self._local(self._shown[near(self._shown, element)]))
            self._pairs.show(self._vis, element, self._poses(element, record.q, record.base_pose), record.scale_m)

    def serve(self, port: int | None = None) -> str:
        """Serve the scene on the loopback address and return its URL."""
        return self.scene.serve(port)

    def wait_for_browser(self, timeout_s: float) -> bool:
        """Wait until a browser follows the scene; say whether one does."""
        end = time.monotonic() + timeout_s
        while not self.scene.watchers() and time.monotonic() < end:
            time.sleep(0.05)
        return self.scene.watchers() > 0

    def static_html(self, path: str | os.PathLike[str]) -> Path:
        """Write the scene as one HTML file that any browser opens, without a network.

        Raises:
            OutputError: the file cannot be written.
        """
        return write_atomically(path, self.scene.static_html())

    def close(self) -> None:
        """Stop serving."""
        if self._playback is not None:
            self._playback.stop()
            self._playback = None
        self.scene.close()

    def _local(self, points: Array) -> Array:
        """Return points [3] or [P][3] about the local origin."""
        return np.asarray(points if self._origin is None else points - self._origin)

    def _poses(self, element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike) -> list[Array]:
        """Return T_view_segment [4][4] of each segment."""
        T_world_base = np.array(base_pose, dtype=np.float64)
        T_world_base[:3, 3] = self._local(T_world_base[:3, 3])
        return [T_world_base @ T for T in self._chain_of(element).segment_poses(q)]

    def _chain_of(self, element: Element) -> Chain:
        """Return an element's chain; the last one is kept, as many states are of it."""
        if self._chain is None or self._chain[0] != element:
            self._chain = element, Chain.of(element)
        return self._chain[1]

    def _distances(self, result: FitResult, scan: Scan) -> Array:
        """Return the distance of every point [P] to the fitted surface."""
        poses = self._poses(result.fitted_element, result.q, result.base_pose)
        return FittedSurface(result.fitted_element).distances_m(self._local(scan.points), poses)

    def _look_at(self, start: Array, end: Array, side: Array) -> None:
        """Turn the camera to what lies between two points, from one side and a little above.

        The first call makes the middle the local origin: meshcat's camera turns about that.
        """
        if self._origin is None:
            self._origin = (start + end) / 2
        turn_camera(self._vis, side, float(np.linalg.norm(end - start)))
        floor = self._local(np.array([*(start + end)[:2] / 2, min(start[2], end[2])]))
        self._vis["/Grid"].set_transform(transform(np.eye(3), floor))

    def _turn_to_seen_side(self, points: Array) -> None:
        """Turn the camera to the side of the member that most of its points are on."""
        if self._element is None or not len(points):
            return
        side = seen_side(self._element, points)
        if side is not None:
            start, end = designed_nodes_m(self._element)[[0, -1]]
            self._look_at(start, end, side)

    def _caption(self, colour: str | None, text: str) -> None:
        kind = text.split(":")[0]
        others = [line for line in self.scene.captions if line[1].split(":")[0] != kind]
        self.scene.captions = [*others, (colour, text)]
        self.scene.tell("captions", lines=self.scene.captions)
