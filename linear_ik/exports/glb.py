"""The as-built member as GLB (glTF 2.0), for any 3D viewer."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import check_writable, write_atomically
from linear_ik.element import Element
from linear_ik.exports.posed import Array, check_posed
from linear_ik.result import FitResult
from linear_ik.section import cap_triangles, extruded_mesh, outlines, side_triangles
from linear_ik.smooth_axis import smooth_axis
from linear_ik.urdf import RGBA, generate_urdf, joint_names, segment_names

# Viewers compute in single precision: at this distance they are 0.01 mm off.
FARTHEST_M = 100.0


def write_glb(element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike, path: str | os.PathLike[str]) -> Path:
    """Write the bent element as GLB, every segment with its true section.

    Nodes: ``scan``, the root, whose matrix turns the scan's axes (Z up) into glTF's (Y up) -> ``base``
    -> ``segment_01`` ... and ``end``, whose origins are the chain's nodes; the segments
    share one mesh, unless the section tapers. A member more than 100 m from the scan's origin is moved to a local
    origin. The scene's extras hold it: a point of ``scan`` plus
    ``linear_ik.local_origin_m`` is the point in the scan's coordinates.

    Args:
        element: what was fitted, `FitResult.fitted_element`.
        q: [3N] (z, y, x) a segment, radians.
        base_pose: [4][4] T_world_base.
        path: of the GLB; missing folders are made.

    Returns:
        The path.

    Raises:
        ChainError: ``q`` or ``base_pose`` of another shape.
        OutputError: a path that cannot be written to.
    """
    import trimesh
    from trimesh.visual import TextureVisuals

    angles, pose = check_posed(element, q, base_pose)
    target = check_writable(path)
    origin = _local_origin(pose[:3, 3])
    T_scan_base = pose.copy()  # noqa: N806 (T_target_source)
    T_scan_base[:3, 3] -= origin

    material, bodies = _material(), {}
    for k, name in enumerate(segment_names(element.segments) if element.is_tapered else ["segment"]):
        start, end = element.segment_profiles(k)
        bodies[name] = extruded_mesh(start, element.segment_length_m, end)
        bodies[name].metadata.clear()
        bodies[name].visual = TextureVisuals(material=material)

    scene = _scene(element, origin)
    scene.graph.update(frame_from="scan", frame_to="base", matrix=T_scan_base)
    scene.geometry.update(bodies)
    for name, T_base_link in _forward_kinematics(element, angles).items():
        shape = {} if name == "end" else {"geometry": name if element.is_tapered else "segment"}
        scene.graph.update(frame_from="base", frame_to=name, matrix=T_base_link, **shape)
    # Without normals glTF shades each face flat, as the faces of a section are.
    return write_atomically(target, trimesh.exchange.gltf.export_glb(scene, include_normals=False))


def write_smooth_glb(result: FitResult, path: str | os.PathLike[str], pieces: int = 4) -> Path:
    """Write the fitted member as GLB, one body along its smooth axis (`smooth_axis`).

    Nodes: ``scan`` -> ``member``; axes and local origin as in `write_glb`. The extras'
    ``linear_ik.axis_m`` are the points of the axis, in the coordinates of ``scan``, a kink's once. At a kink the
    body is mitred, unless it turns back there or the pieces beside it are too short: then it keeps both sections.

    Args:
        result: of a fit that found the element.
        path: of the GLB; missing folders are made.
        pieces: into how many each segment is divided.

    Returns:
        The path.

    Raises:
        OutputError: a path that cannot be written to.
    """
    import trimesh
    from trimesh.visual import TextureVisuals

    target = check_writable(path)
    axis, element = smooth_axis(result, pieces), result.element
    origin = _local_origin(axis.points_m[0])
    length_m = float(axis.s_m[-1])
    sections = [outlines(element.profile_at(float(s_m) / length_m)) for s_m in axis.s_m]
    points = axis.points_m - origin
    rings = [
        point + np.concatenate(section) @ R[:, :2].T
        for point, R, section in zip(points, axis.rotations, sections, strict=True)
    ]
    # A kink is there twice, with the direction before it and the one after.
    again = np.flatnonzero(np.diff(axis.s_m) == 0.0)
    tried = {int(i): _mitre(rings, points, axis.tangents, int(i)) for i in again}
    mitred = {i: ring for i, ring in tried.items() if ring is not None}
    rings = [mitred.get(i, ring) for i, ring in enumerate(rings) if i - 1 not in mitred]
    m, sides = len(rings[0]), side_triangles(sections[0])
    triangles = [cap_triangles(sections[0])[:, ::-1], *(sides + i * m for i in range(len(rings) - 1))]
    triangles.append(cap_triangles(sections[-1]) + (len(rings) - 1) * m)
    body = trimesh.Trimesh(np.concatenate(rings), np.concatenate(triangles), process=False)
    body.metadata.clear()
    body.visual = TextureVisuals(material=_material())
    scene = _scene(element, origin)
    scene.metadata["linear_ik"]["axis_m"] = np.delete(points, again, axis=0).tolist()
    scene.geometry["member"] = body
    scene.graph.update(frame_from="scan", frame_to="member", matrix=np.eye(4), geometry="member")
    return write_atomically(target, trimesh.exchange.gltf.export_glb(scene, include_normals=False))


def _mitre(rings: list[Array], points: Array, tangents: Array, i: int) -> Array | None:
    """Return the ring [V][3] in which two meet that stand at a kink, i and i + 1; None: there is no room for it.

    Every corner goes along its own direction to the plane that halves the kink; a twist between the two is halved.
    """
    halving = tangents[i] + tangents[i + 1]
    met = []
    for k, beyond in ((i, i - 1), (i + 1, i + 2)):
        off = rings[k] - points[k]
        along = float(tangents[k] @ halving)
        if along <= 0.0:
            return None  # it turns back
        slides = (off @ halving) / along
        if np.abs(slides).max() >= np.linalg.norm(points[beyond] - points[k]):
            return None
        met.append(off - slides[:, None] * tangents[k])
    return np.asarray(points[i] + (met[0] + met[1]) / 2.0)


def _material() -> Any:
    from trimesh.visual.material import PBRMaterial

    return PBRMaterial(baseColorFactor=[round(255 * c) for c in RGBA], metallicFactor=0.1, roughnessFactor=0.7)


def _scene(element: Element, origin: Array) -> Any:
    """Return a scene with the scan's axes in it, Y up as glTF asks."""
    import trimesh

    scene = trimesh.Scene(base_frame="world")
    scene.metadata["linear_ik"] = {"name": element.name, "local_origin_m": origin.tolist()}
    y_up = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)).round(12)
    scene.graph.update(frame_from="world", frame_to="scan", matrix=y_up)
    return scene


def _forward_kinematics(element: Element, q: Array) -> dict[str, Array]:
    """Return T_base_link of every segment and the end, from the element's URDF."""
    import yourdfpy

    urdf = BytesIO(generate_urdf(element).encode())
    robot = yourdfpy.URDF.load(urdf, load_meshes=False, build_scene_graph=True)
    robot.update_cfg(dict(zip(joint_names(element.segments), q, strict=True)))
    transforms: dict[str, Array] = {}
    previous, T = "base", np.eye(4)  # noqa: N806 (T_target_source)
    # Link by link: over a long path trimesh spends most of its time on the order of the products.
    for name in [*segment_names(element.segments), "end"]:
        T = T @ robot.get_transform(name, previous)  # noqa: N806
        transforms[name], previous = T, name
    return transforms


def _local_origin(position: Array) -> Array:
    far = float(np.abs(position).max()) > FARTHEST_M
    return np.round(position) if far else np.zeros(3)
