"""The as-built member as URDF and joint values, for robotics tools."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy.typing as npt

from linear_ik.atomic import check_writable, write_atomically
from linear_ik.element import Element
from linear_ik.exports.posed import check_posed
from linear_ik.urdf import joint_names, write_urdf

SCHEMA = "linear_ik/joints/1"


def joints_path(urdf: Path) -> Path:
    """Return the file of the joint values that belongs to a URDF file."""
    return urdf.with_name(f"{urdf.stem}_joints.json")


def write_fitted_urdf(
    element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike, path: str | os.PathLike[str]
) -> list[Path]:
    """Write the element's URDF and, beside it, ``<stem>_joints.json`` with the joint values.

    The JSON holds ``joints_rad`` (joint name -> angle), the same angles as ``q`` in
    Pinocchio's order, and ``base_pose``, which places the URDF's base in the scan.

    Args:
        element: what was fitted, `FitResult.fitted_element`.
        q: [3N] (z, y, x) a segment, radians.
        base_pose: [4][4] T_world_base.
        path: of the URDF; missing folders are made.

    Returns:
        The paths written: URDF, joint values, then the mesh if the section needs one.

    Raises:
        ChainError: ``q`` or ``base_pose`` of another shape.
        OutputError: a path that cannot be written to.
    """
    angles, pose = check_posed(element, q, base_pose)
    target = Path(path)
    joints = check_writable(joints_path(target))
    values = [float(angle) for angle in angles]
    content = {
        "schema": SCHEMA,
        "urdf": target.name,
        "joints_rad": dict(zip(joint_names(element.segments), values, strict=True)),
        "q": values,
        "base_pose": pose.tolist(),
    }
    urdf, *meshes = write_urdf(element, target)
    write_atomically(joints, json.dumps(content, indent=1) + "\n")
    return [urdf, joints, *meshes]
