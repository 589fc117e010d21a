"""Body: a member before and after, and the scan's points, as the page's 3D view reads them."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.report.cloud import NearPoints
from linear_ik.result import FitResult
from linear_ik.smooth_axis import smooth_axis

Array = npt.NDArray[np.float64]

MOST_RINGS = 60  # with 24 corners: what a page of 50 members draws at once when it is turned
PIECES = 4  # of a segment: a bend is then seen as a curve
MOST_CORNERS = 24  # of a round section, seen as round
STEPS = 32_000  # of a 16-bit coordinate, over the larger half of the view


def body_data(
    result: FitResult, frames: Array | None, near: NearPoints | None, most_points: int, largest_m: float
) -> dict[str, Any]:
    """Return what the 3D view draws, as JSON's own types.

    Metres along the scan's axes, about a local origin. ``before`` and ``after`` are
    rings [R][3 + 6]: node, then section X and Y; ``start`` and ``end`` the outlines [V][2].

    Args:
        result: of a fit.
        frames: [N][4][4] of its segments; None where it was not found.
        near: the scan's points, or None.
        most_points: how many of them are shown.
        largest_m: distance to the fitted surface at the upper end of the colours.
    """
    element, T = result.element, result.element.placement.T_world_element
    keep = np.unique(np.linspace(0, element.segments, min(MOST_RINGS, element.segments + 1)).astype(int))
    designed = element.design.nodes_m @ T[:3, :3].T + T[:3, 3]
    origin = (designed.max(axis=0) + designed.min(axis=0)) / 2
    out: dict[str, Any] = {
        "before": _rings(designed - origin, T[:3, :3] @ element.design.rotations)[keep].tolist(),
        "start": _corners(element.profile.outline()),
        "end": _corners(element.profile_at(1.0).outline()),
    }
    pieces = PIECES if PIECES * element.segments < MOST_RINGS else 1
    if frames is not None and pieces > 1:
        # The page exaggerates what moved: a chain's corners would show.
        axis = smooth_axis(result, pieces)
        once = np.concatenate([[True], np.diff(axis.s_m) > 0])  # a kink has two, of which one is drawn
        t = axis.s_m[once] / result.fitted_element.segment_length_m
        out["after"] = _turned(axis.points_m[once] - origin, axis.rotations[once])
        k = np.minimum(t.astype(int), element.segments - 1)
        between = designed[k] + (t - k)[:, None] * (designed[k + 1] - designed[k])
        sections = _rings(designed, T[:3, :3] @ element.design.rotations)[:, 3:]
        middle = (t - k)[:, None] * sections[k + 1] + (1.0 - (t - k))[:, None] * sections[k]
        out["before"] = np.round(np.concatenate([between - origin, middle], axis=1), 5).tolist()
    elif frames is not None:
        out["after"] = _rings(result.nodes_m - origin, frames[:, :3, :3])[keep].tolist()
    if near is not None and len(near.points):
        rows = np.arange(len(near.points))
        if len(rows) > most_points:
            rows = np.sort(np.random.default_rng(0).choice(rows, most_points, replace=False))
        local = near.points[rows] - origin
        scale = float(np.abs(local).max()) / STEPS
        out["scale"] = scale
        out["points"] = _packed(np.round(local / scale), "<i2")
        out["along"] = _packed(np.round(65535 * near.s_m[rows] / result.fitted_element.length_m), "<u2")
        out["distance"] = _packed(np.clip(255 * near.distance_m[rows] / largest_m, 0, 255), "u1")
    return out


def _turned(points: Array, rotations: Array) -> list[list[float]]:
    rings: list[list[float]] = np.round(
        np.concatenate([points, rotations[:, :, 0], rotations[:, :, 1]], axis=1), 5
    ).tolist()
    return rings


def _rings(nodes: Array, rotations: Array) -> Array:
    """Return each node with section axes between those of the segments that meet there [N+1][9]."""
    axes = np.concatenate([rotations[:1], (rotations[1:] + rotations[:-1]) / 2, rotations[-1:]])[:, :, :2]
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    rings = np.concatenate([nodes, axes[:, :, 0], axes[:, :, 1]], axis=1)
    return np.asarray(np.round(rings, 5))


def _corners(outline: Array) -> list[list[float]]:
    keep = outline if len(outline) <= 2 * MOST_CORNERS else outline[:: -(-len(outline) // MOST_CORNERS)]
    corners: list[list[float]] = np.round(keep, 5).tolist()
    return corners


def _packed(values: Array, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")
