"""Bent shape: a fitted element as a chain of sections, and its closed surface.

Everything is in the coordinates of the result, metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.bending import joint_rotations
from linear_ik.element import Element
from linear_ik.errors import LinearIkError
from linear_ik.profile import Profile
from linear_ik.result import FitResult
from linear_ik.section import cap_triangles, outlines, side_triangles

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

# Nodes and angles of one result agree to rounding; map coordinates leave less of it.
AGREE_M = 1e-5
# Two segments that are twisted against each other meet in two outlines: closer than this they are one.
SAME_M = 5e-5
SAGITTA_M = 2e-4  # between a circle and its chords
# A mitre takes at most this part of a segment, however sharp the bend.
MOST_OF_SEGMENT = 0.45


class AsBuiltError(LinearIkError):
    """A result or a design file that no as-built model can be made of."""


@dataclass(frozen=True, eq=False)
class BentShape:
    """A fitted element.

    Attributes:
        element: the design, of the length that was found.
        nodes_m: [N+1][3].
        rotations: [N][3][3] orientation of each segment: its columns are the section's X and Y and the direction.
    """

    element: Element
    nodes_m: Array
    rotations: Array


def bent_shape(result: FitResult) -> BentShape:
    """Return the shape of a result.

    Raises:
        AsBuiltError: nodes that are not finite, or that are not where the angles lead.
    """
    element, nodes = result.fitted_element, np.asarray(result.nodes_m, dtype=np.float64)
    angles = np.asarray(result.joint_angles_rad, dtype=np.float64)
    base = np.asarray(result.base_pose, dtype=np.float64)
    if not (np.isfinite(nodes).all() and np.isfinite(angles).all() and np.isfinite(base).all()):
        raise AsBuiltError("nodes_m", "a value that is not finite", "a fitted shape")
    R = base[:3, :3]
    rotations = np.empty((element.segments, 3, 3))
    for k, turn in enumerate(joint_rotations(angles)):
        R = R @ turn
        rotations[k] = R
    off = np.abs(np.diff(nodes, axis=0) - element.segment_length_m * rotations[:, :, 2]).max()
    if off > AGREE_M + 1e-12 * np.abs(nodes).max():
        raise AsBuiltError("nodes_m", f"{off:.3g} m from where the joint angles lead", "nodes and angles of one fit")
    return BentShape(element, nodes, rotations)


def skin(shape: BentShape) -> tuple[Array, Triangles]:
    """Return the closed surface, mitred at the joints: vertices [V][3], triangles [T][3] (outside counter-clockwise).

    Neighbouring segments meet in the plane that halves their angle, so that every face is the segment's own.
    A circle is chords within 0.2 mm of it.
    """
    element, R, nodes = shape.element, shape.rotations, shape.nodes_m
    n = element.segments
    chords = _round_chords(element)
    rings_2d = [_outlines(element.profile_at(k / n), chords) for k in range(n + 1)] if element.is_tapered else []
    first = rings_2d[0] if rings_2d else _outlines(element.profile, chords)
    last = rings_2d[-1] if rings_2d else first
    sections = (
        np.stack([np.concatenate(r) for r in rings_2d]) if rings_2d else np.tile(np.concatenate(first), (n + 1, 1, 1))
    )
    slopes = np.diff(sections, axis=0) / element.segment_length_m
    rings = [_at(nodes[0], R[0], sections[0], slopes[0], np.zeros(len(sections[0])))]
    for k in range(1, n):
        before, after = (
            _at(nodes[k], R[i], sections[k], slopes[i], _mitre(shape, k, i, sections[k], slopes[i])) for i in (k - 1, k)
        )
        if np.abs(before - after).max() <= SAME_M:
            rings.append((before + after) / 2)
        else:
            rings += [before, after]
    rings.append(_at(nodes[n], R[n - 1], sections[n], slopes[n - 1], np.zeros(len(sections[n]))))
    m = len(rings[0])
    sides = side_triangles(first)
    parts = [cap_triangles(first)[:, ::-1], *(sides + i * m for i in range(len(rings) - 1))]
    parts.append(cap_triangles(last) + (len(rings) - 1) * m)
    return np.concatenate(rings), np.concatenate(parts)


def _round_chords(element: Element) -> int:
    """Return how many chords a round section takes, 0 of any other."""
    radius = max((p.radius_m or 0.0) for p in (element.profile, element.profile_at(1.0)))
    if not radius:
        return 0
    half_rad = np.arccos(max(1.0 - SAGITTA_M / radius, 0.0))
    return 4 * max(3, int(np.ceil(np.pi / half_rad / 4)))


def _outlines(profile: Profile, chords: int) -> list[Array]:
    """Return the outer and the inner outline of a profile, a circle with so many chords."""
    rings = outlines(profile)
    if not chords:
        return rings
    angle = np.arange(chords) * (2 * np.pi / chords)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return [float(np.linalg.norm(ring[0])) * circle for ring in rings]


def _mitre(shape: BentShape, node: int, segment: int, corners: Array, slope: Array) -> Array:
    """Return how far [V] along a segment, from one of its nodes, each corner's line meets the node's mitre plane."""
    R = shape.rotations
    normal = R[node - 1, :, 2] + R[node, :, 2]
    across = normal @ R[segment, :, :2]
    steep = normal @ R[segment, :, 2] + slope @ across
    most = MOST_OF_SEGMENT * shape.element.segment_length_m
    # Folded back on itself there is no such plane.
    z = -(corners @ across) / np.where(np.abs(steep) > 1e-9, steep, np.inf)
    return np.asarray(np.clip(z, -most, most))


def _at(node: Array, R: Array, corners: Array, slope: Array, z: Array) -> Array:
    """Return the corners [V][3] of a section at ``z`` [V] along a segment from its node."""
    return np.asarray(node + np.column_stack([corners + slope * z[:, None], z]) @ R.T)
