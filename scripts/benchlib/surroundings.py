"""Surroundings: what stands beside a scanned member, as meshes for the virtual scanner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from linear_ik.bending import BentElement
from linear_ik.scene import Mesh, box_mesh, element_mesh, floor, segment_meshes, wall

Array = npt.NDArray[np.float64]

KINDS = ("floor+wall", "neighbour", "bracket", "cable")
NEIGHBOUR_GAP_M = 0.050
CABLE_M = 0.015
BRACKET_M = (0.12, 0.12, 0.15)


def body(bent: BentElement) -> Array:
    """Return the corners [V][3] of the bent member in the scan's coordinates."""
    corners = np.concatenate([mesh.vertices for mesh in segment_meshes(bent)])
    return np.asarray(corners @ bent.base_pose[:3, :3].T + bent.base_pose[:3, 3])


def floor_under(bent: BentElement, level_m: float) -> Mesh:
    """Return a floor at a level, or lower where the member reaches lower."""
    corners = body(bent)
    centre = corners.mean(axis=0)
    return floor([centre[0], centre[1], min(level_m, float(corners[:, 2].min()))], 30.0)


def wall_behind(bent: BentElement, normal: Array, gap_m: float) -> Mesh:
    """Return a wall whose front looks along ``normal`` [3], ``gap_m`` behind the member."""
    corners = body(bent)
    centre = corners.mean(axis=0)
    behind = float((corners @ normal).min()) - gap_m
    return wall(centre + (behind - float(centre @ normal)) * normal, normal, 30.0)


def neighbour_beside(bent: BentElement, gap_m: float = NEIGHBOUR_GAP_M) -> Mesh:
    """Return a straight copy of the member, ``gap_m`` from where the bent one comes nearest.

    It stands on the side that the member bends away from.
    """
    element = bent.element
    T = element.placement.T_world_element
    corners = (body(bent) - T[:3, 3]) @ T[:3, :3]
    outline = element.profile.outline()
    best: tuple[float, Array] | None = None
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            reach = float((sign * corners[:, axis]).max())
            # The copy's near side is its least coordinate along the direction.
            offset = reach + gap_m - float((sign * outline[:, axis]).min())
            if best is None or offset < best[0]:
                direction = np.zeros(3)
                direction[axis] = sign
                best = offset, direction
    assert best is not None
    straight = element_mesh(element)
    return Mesh(straight.vertices + best[0] * (T[:3, :3] @ best[1]), straight.triangles)


def bracket_on(bent: BentElement, segment: int, side: int) -> Mesh:
    """Return a box that stands flush on one side (0 to 3: +x, +y, -x, -y) of a segment (from 0)."""
    x, y, z = BRACKET_M
    outline = bent.element.profile.outline()
    axis, sign = side % 2, 1.0 if side < 2 else -1.0
    size = np.array([x, y, z])
    centre = np.append((outline.min(axis=0) + outline.max(axis=0)) / 2, bent.element.segment_length_m / 2)
    centre[axis] = sign * (float((sign * outline[:, axis]).max()) + size[axis] / 2)
    return _placed(box_mesh(centre, size), bent, segment)


def cable_along(bent: BentElement, side: int, off_m: float) -> list[Mesh]:
    """Return a cable of 15 mm along one side of every segment, ``off_m`` clear of its surface."""
    outline = bent.element.profile.outline()
    axis, sign = side % 2, 1.0 if side < 2 else -1.0
    length = bent.element.segment_length_m
    centre = np.append((outline.min(axis=0) + outline.max(axis=0)) / 2, length / 2)
    centre[axis] = sign * (float((sign * outline[:, axis]).max()) + off_m + CABLE_M / 2)
    mesh = box_mesh(centre, (CABLE_M, CABLE_M, 1.02 * length))
    return [_placed(mesh, bent, k) for k in range(bent.element.segments)]


def around(
    bent: BentElement, kinds: Sequence[str], normal: Array, floor_m: float, rng: np.random.Generator
) -> list[Mesh]:
    """Return the meshes of some of `KINDS`, "floor" and "wall".

    Args:
        bent: the member among them.
        kinds: what there is.
        normal: [3] horizontal, from the wall to the stations.
        floor_m: level of the floor.
        rng: draws gaps and places.
    """
    meshes: list[Mesh] = []
    for kind in kinds:
        if kind in ("floor", "floor+wall"):
            meshes.append(floor_under(bent, floor_m))
        if kind in ("wall", "floor+wall"):
            meshes.append(wall_behind(bent, normal, float(rng.uniform(0.05, 0.3))))
        if kind == "neighbour":
            meshes.append(neighbour_beside(bent))
        if kind == "bracket":
            segment = int(rng.integers(1, bent.element.segments))
            meshes.append(bracket_on(bent, segment, int(rng.integers(4))))
        if kind == "cable":
            meshes += cable_along(bent, int(rng.integers(4)), float(rng.uniform(0.002, 0.03)))
    return meshes


def _placed(mesh: Mesh, bent: BentElement, segment: int) -> Mesh:
    T = bent.base_pose @ bent.T_base_segment[segment]
    return Mesh(mesh.vertices @ T[:3, :3].T + T[:3, 3], mesh.triangles)
