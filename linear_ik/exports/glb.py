"""The as-built member as GLB (glTF 2.0), for any 3D viewer."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import check_writable, write_atomically
from linear_ik.element import Element
from linear_ik.exports.posed import Array, check_posed
from linear_ik.section import extruded_mesh
from linear_ik.urdf import RGBA, generate_urdf, joint_names, segment_names

# Viewers compute in single precision: at this distance they are 0.01 mm off.
FARTHEST_M = 100.0


def write_glb(element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike, path: str | os.PathLike[str]) -> Path:
    """Write the bent element as GLB, every segment with its true section.

    Nodes: ``world`` (glTF's axes, Y up) -> ``scan`` (the scan's axes, Z up) -> ``base``
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
    from trimesh.visual.material import PBRMaterial

    angles, pose = check_posed(element, q, base_pose)
    target = check_writable(path)
    origin = _local_origin(pose[:3, 3])
    T_scan_base = pose.copy()  # noqa: N806 (T_target_source)
    T_scan_base[:3, 3] -= origin

    colour = [round(255 * c) for c in RGBA]
    material = PBRMaterial(baseColorFactor=colour, metallicFactor=0.1, roughnessFactor=0.7)
    bodies = {}
    for k, name in enumerate(segment_names(element.segments) if element.is_tapered else ["segment"]):
        start, end = element.segment_profiles(k)
        bodies[name] = extruded_mesh(start, element.segment_length_m, end)
        bodies[name].metadata.clear()
        bodies[name].visual = TextureVisuals(material=material)

    scene = trimesh.Scene(base_frame="world")
    scene.metadata["linear_ik"] = {"name": element.name, "local_origin_m": origin.tolist()}
    y_up = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)).round(12)
    scene.graph.update(frame_from="world", frame_to="scan", matrix=y_up)
    scene.graph.update(frame_from="scan", frame_to="base", matrix=T_scan_base)
    scene.geometry.update(bodies)
    for name, T_base_link in _forward_kinematics(element, angles).items():
        shape = {} if name == "end" else {"geometry": name if element.is_tapered else "segment"}
        scene.graph.update(frame_from="base", frame_to=name, matrix=T_base_link, **shape)
    # Without normals glTF shades each face flat, as the faces of a section are.
    return write_atomically(target, trimesh.exchange.gltf.export_glb(scene, include_normals=False))


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
