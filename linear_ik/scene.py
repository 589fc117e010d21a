"""Scene: closed meshes of a bent member and of what stands around it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.bending import Bend, BentElement, bend_element, check_array
from linear_ik.element import Element
from linear_ik.errors import SettingsError
from linear_ik.profile import Profile
from linear_ik.section import outlines, prism_triangles

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

ROUND_CHORDS = 360  # 4 um from a circle of 100 mm radius


class Mesh(NamedTuple):
    """A triangle mesh: vertices [V][3] in metres, triangles [T][3] counter-clockwise from outside."""

    vertices: Array
    triangles: Triangles


def segment_meshes(bent: BentElement) -> list[Mesh]:
    """Return the closed body of each segment in the base's frame, mitred at the joints.

    A real member has no gaps where it bends: on the outside of a bend the faces are
    prolonged to the plane that halves the angle (as far as at 90 degrees, where it is
    sharper), on the inside the segments overlap. The outermost ends keep their caps, and
    a hollow section its inside.
    """
    element, R = bent.element, bent.T_base_segment[:, :3, :3]
    n, length = len(R), element.segment_length_m
    nodes = range(n + 1 if element.is_tapered else 1)
    rings = [_rings(element.profile_at(k / n)) for k in nodes] * (1 if element.is_tapered else n + 1)
    section = np.stack([np.concatenate(ring) for ring in rings])
    slope = np.diff(section, axis=0) / length
    z = np.zeros((n, 2, section.shape[1]))
    z[:, 1] = length
    for k in range(n - 1):
        normal = R[k, :, 2] + R[k + 1, :, 2]
        cosine_1 = 1 + R[k, :, 2] @ R[k + 1, :, 2]
        if cosine_1 < 1e-9:  # folded back on itself: no plane halves that
            continue
        reach = np.linalg.norm(section[k + 1], axis=1)
        # Where the corner's line, c + z slope, meets the plane.
        before, after = (
            section[k + 1] @ (normal @ R[i, :, :2]) / (cosine_1 + slope[i] @ (normal @ R[i, :, :2])) for i in (k, k + 1)
        )
        z[k, 1] += np.clip(-before, 0, reach)
        z[k + 1, 0] -= np.clip(after, 0, reach)
    meshes, triangles = [], prism_triangles(rings[0], rings[-1])
    for k, T in enumerate(bent.T_base_segment):
        if k and element.is_tapered:
            triangles = prism_triangles(rings[k], rings[k + 1])
        xy = section[k] + z[k][:, :, None] * slope[k]
        local = np.column_stack([xy.reshape(-1, 2), z[k].ravel()])
        meshes.append(Mesh(local @ T[:3, :3].T + T[:3, 3], triangles))
    return meshes


def is_inside(bent: BentElement, point: Array, skin_m: float = 1e-3) -> bool:
    """Return whether a point [3] in the base's frame is in the member's material, or within ``skin_m`` of it."""
    import shapely

    T, length = bent.T_base_segment, bent.element.segment_length_m
    local = np.einsum("kij,ki->kj", T[:, :3, :3], point - T[:, :3, 3])
    for k in np.flatnonzero((local[:, 2] > -skin_m) & (local[:, 2] < length + skin_m)):
        along = (k + np.clip(local[k, 2] / length, 0.0, 1.0)) / len(T)
        outer, *holes = outlines(bent.element.profile_at(float(along)))
        if shapely.distance(shapely.Polygon(outer, holes), shapely.Point(local[k, :2])) < skin_m:
            return True
    return False


def element_mesh(
    element: Element,
    bends: Sequence[Bend | str] = (),
    joint_angles_rad: npt.ArrayLike | None = None,
    displacement: npt.ArrayLike | None = None,
) -> Mesh:
    """Return the body of a bent element in the scan's coordinates; arguments as `bend_element`."""
    bent = bend_element(element, bends, joint_angles_rad, displacement)
    meshes = segment_meshes(bent)
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes])
    vertices = np.concatenate([m.vertices for m in meshes])
    triangles = np.concatenate([m.triangles + s for m, s in zip(meshes, starts[:-1], strict=True)])
    return Mesh(vertices @ bent.base_pose[:3, :3].T + bent.base_pose[:3, 3], triangles)


def neighbour(element: Element, offset_m: npt.ArrayLike, bends: Sequence[Bend | str] = ()) -> Mesh:
    """Return a second member beside the element: its copy, shifted in the placement's frame.

    Args:
        element: the member whose neighbour it is.
        offset_m: [3] along the placement's x, y and z.
        bends: of the neighbour; straight when none are given.
    """
    mesh = element_mesh(element, bends)
    offset = element.placement.T_world_element[:3, :3] @ check_array("offset_m", offset_m, (3,))
    return Mesh(mesh.vertices + offset, mesh.triangles)


def box_mesh(center: npt.ArrayLike, size: npt.ArrayLike) -> Mesh:
    """Return a box [3] m large about ``center`` [3], parallel to the scan's axes."""
    center, size = check_array("center", center, (3,)), check_array("size", size, (3,))
    if not (size > 0).all():
        raise SettingsError("size", f"{size.tolist()}", "three lengths above 0")
    corners = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    quads = [(3, 2, 1, 0), (4, 5, 6, 7), *((a, (a + 1) % 4, (a + 1) % 4 + 4, a + 4) for a in range(4))]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return Mesh(center + corners * size / 2, triangles)


def wall(center: npt.ArrayLike, normal: npt.ArrayLike, size_m: float = 10.0) -> Mesh:
    """Return a square wall of ``size_m`` about ``center`` [3], its front towards ``normal`` [3]."""
    center, n = check_array("center", center, (3,)), check_array("normal", normal, (3,))
    if not np.linalg.norm(n) > 1e-9:
        raise SettingsError("normal", f"{n.tolist()} has no length", "a direction")
    n = n / np.linalg.norm(n)
    u = np.cross(n, np.eye(3)[np.abs(n).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(n, u)
    corners = np.array([-u - v, u - v, u + v, v - u]) * (size_m / 2)
    return Mesh(center + corners, np.array([[0, 1, 2], [0, 2, 3]]))


def floor(center: npt.ArrayLike, size_m: float = 10.0) -> Mesh:
    """Return a square floor of ``size_m`` about ``center`` [3], looking up along the scan's z."""
    return wall(center, (0, 0, 1), size_m)


def as_mesh(name: str, other: object) -> Mesh:
    """Return ``other``, a (vertices, triangles) pair or anything with ``vertices`` and ``faces``, as a Mesh.

    Raises:
        SettingsError: it is neither, or its triangles name vertices that it has not.
    """
    if hasattr(other, "vertices") and hasattr(other, "faces"):
        pair: tuple[npt.ArrayLike, ...] = (other.vertices, other.faces)
    elif isinstance(other, (tuple, list)) and len(other) == 2:
        pair = tuple(other)
    else:
        raise SettingsError(name, f"a {type(other).__name__}", "(vertices [V][3], triangles [T][3]), or a trimesh")
    vertices = check_array(f"{name} vertices", pair[0], (-1, 3))
    triangles = check_array(f"{name} triangles", pair[1], (-1, 3)).astype(np.int64)
    if not triangles.size or triangles.min() < 0 or triangles.max() >= len(vertices):
        raise SettingsError(
            name, "triangles beyond the vertices, or none", f"rows of vertices, 0 to {len(vertices) - 1}"
        )
    return Mesh(vertices, triangles)


def _rings(profile: Profile) -> list[Array]:
    """Return the outlines of a profile, circles with as many chords as a scanner might see."""
    rings = outlines(profile)
    if profile.radius_m is None:
        return rings
    angle = np.arange(ROUND_CHORDS) * (2 * np.pi / ROUND_CHORDS)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return [np.linalg.norm(ring[0]) * circle for ring in rings]
