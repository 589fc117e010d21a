"""Viewer, result: the iterations played back, each segment by its status, each node with its ellipsoid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.result import FitResult
from linear_ik.viewer_shapes import material, transform

Array = npt.NDArray[np.float64]

FRAMES, FPS = 60, 12  # five seconds, as fast as an eye tells states apart
# 95 % of a normal distribution in three dimensions, in standard deviations: sqrt of chi-square 0.95 with 3 degrees.
RADIUS_95 = 2.7955
MOST_ELLIPSOIDS = 60  # of a longer chain they would touch
ELLIPSOID_SHARE = 1 / 80  # of the length: what is smaller is not seen
# By which they are enlarged: numbers that a person divides by.
SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
STATUS_COLOURS = {"inferred": 0xE2B53C, "not_scanned": 0x8A919B}
ELLIPSOID_COLOUR = 0xC2410C
JOINT_COLOUR, JOINT_SHARE = 0xFACC15, 1 / 200  # of the length: a dot of a few pixels


def steps_of(result: FitResult) -> list[tuple[str, Array, Array]]:
    """Return what is shown of a fit, step by step: label, q and base pose; the result is the last."""
    steps = []
    count = len(result.history)
    for i in np.unique(np.linspace(0, count - 1, FRAMES).astype(int)) if count else ():
        record = result.history[i]
        rms = f", {1e3 * record.surface_rmse_m:.2f} mm rms" if np.isfinite(record.surface_rmse_m) else ""
        label = f"iteration {record.iteration} of {count}, {record.phase}{rms}"
        steps.append((label, record.q, record.base_pose))
    return [*steps, ("result", result.q, result.base_pose)]


def play_back(vis: Any, steps: list[list[Array]]) -> None:
    """Give the page a fit as an animation.

    Args:
        vis: meshcat's Visualizer.
        steps: transforms [N][4][4] of the segments at each step.
    """
    from meshcat.animation import Animation

    animation = Animation(default_framerate=FPS)
    for i, poses in enumerate(steps):
        for k, T in enumerate(poses):
            with animation.at_frame(vis, i) as frame:
                frame[f"fitted/{k + 1}"].set_transform(T)
    vis.set_animation(animation)


def show_joints(vis: Any, element: Element) -> None:
    """Draw a ball at each joint and at the end; they move with the segments that they belong to."""
    from meshcat.geometry import MeshBasicMaterial, Sphere

    ball = Sphere(min(JOINT_SHARE * element.length_m, element.segment_length_m / 4.0))
    # Inside the member, and seen through it.
    yellow = MeshBasicMaterial(color=JOINT_COLOUR, transparent=True, depthTest=False)
    joints = [vis[f"fitted/{k + 1}/joint"] for k in range(element.segments)]
    end = vis[f"fitted/{element.segments}/end"]
    for joint in (*joints, end):
        joint.set_object(ball, yellow)
        joint.set_property("renderOrder", 1)
    end.set_transform(transform(np.eye(3), np.array([0.0, 0.0, element.segment_length_m])))


def colour_segments(vis: Any, result: FitResult, bodies: list[Any], opacity: float) -> list[tuple[str, str]]:
    """Draw what the scan does not fix in another colour, and return the lines of the legend."""
    lines = []
    for status, colour in STATUS_COLOURS.items():
        which = [k for k, segment in enumerate(result.segments) if segment.status == status]
        for k in which:
            vis[f"fitted/{k + 1}"].set_object(bodies[k], material(colour, opacity))
        if which:
            numbers = ", ".join(str(k + 1) for k in which[:12]) + (", ..." if len(which) > 12 else "")
            lines.append((f"#{colour:06x}", f"{status.replace('_', ' ')}: segment {numbers}"))
    return lines


def show_ellipsoids(vis: Any, result: FitResult, local: Callable[[Array], Array]) -> tuple[str, str] | None:
    """Draw the 95 % ellipsoid of each node, enlarged so that it is seen; return the line of the legend.

    Args:
        vis: meshcat's Visualizer.
        result: of a fit.
        local: takes points [P][3] to the view's coordinates.
    """
    from meshcat.geometry import Ellipsoid

    known = np.flatnonzero(np.isfinite(result.nodes_covariance_m2).all(axis=(1, 2)))
    if len(known) > MOST_ELLIPSOIDS:
        known = known[np.unique(np.linspace(0, len(known) - 1, MOST_ELLIPSOIDS).astype(int))]
    variances, axes = np.linalg.eigh(result.nodes_covariance_m2[known])
    radii = RADIUS_95 * np.sqrt(np.maximum(variances, 0.0))
    seen = radii[:, -1] > 0
    if not seen.any():
        return None
    wanted = ELLIPSOID_SHARE * result.element.length_m / float(np.median(radii[seen, -1]))
    scale = max([s for s in SCALES if s <= wanted], default=1)
    # A held node has no width at all in some directions, which a body cannot have.
    radii = np.maximum(scale * radii, 1e-4 * result.element.length_m)
    orange = material(ELLIPSOID_COLOUR, 0.75)
    for k, R, r in zip(known[seen], axes[seen], radii[seen], strict=True):
        R = R * np.sign(np.linalg.det(R))
        vis[f"nodes/{k}"].set_object(Ellipsoid(r), orange)
        vis[f"nodes/{k}"].set_transform(transform(R, local(result.nodes_m[k])))
    times = "" if scale == 1 else f", drawn {scale} times as large"
    return f"#{ELLIPSOID_COLOUR:06x}", f"nodes: 95 % ellipsoids{times}"
