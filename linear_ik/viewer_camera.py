"""Viewer, camera: where a member is looked at from."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.viewer_shapes import reach_m

Array = npt.NDArray[np.float64]

# Of the length: a member's ends stay within the 75 degrees that meshcat's camera shows. And how steeply down.
EYE_SHARE, EYE_RISE = 0.85, 0.5
NEAREST, FARTHEST = 1 / 1000, 100.0  # of the length: what is drawn
PAST_SIDE = 0.5  # a little past the side that was seen, so that the neighbouring face shows too
# Of the reach: points all round have their middle nearer to the axis than this, and no side was seen.
NO_SIDE = 0.002


def turn_camera(vis: Any, side: Array, extent_m: float) -> None:
    """Turn the camera to the middle of the view, from one side and a little above.

    Args:
        vis: meshcat's Visualizer.
        side: [3] across what is looked at.
        extent_m: how long that is.
    """
    side = side + np.array([0.0, 0.0, EYE_RISE])
    eye = side / np.linalg.norm(side) * extent_m * EYE_SHARE
    # The camera lives in a frame with Y up, and has no setter of its own.
    camera = vis["/Cameras/default/rotated/<object>"]
    camera.set_property("position", [eye[0], eye[2], -eye[1]])
    camera.set_property("near", extent_m * NEAREST)
    camera.set_property("far", extent_m * FARTHEST)


def seen_side(element: Element, points: Array) -> Array | None:
    """Return the side [3] of a member that most of the points [P][3] on it are on; None where it is none."""
    T, half = element.placement.T_world_element, element.length_m / 2
    inside = (points - T[:3, 3]) @ T[:3, :3]
    reach = 2 * reach_m(element)
    on_it = inside[np.linalg.norm(inside[:, :2], axis=1) < reach + half / 5, :2]
    if not len(on_it):
        return None
    x, y = on_it.mean(axis=0)
    if not np.hypot(x, y) > NO_SIDE * reach:
        return None
    across = np.array([x, y]) / np.hypot(x, y)
    return np.asarray(T[:3, :2] @ (across + PAST_SIDE * np.array([-across[1], across[0]])))
