"""Bending: an element in a shape that is known because somebody chose it.

Its kinematics are the paper's section 3.1 written out, and not the fit's chain, so that
a simulated truth owes nothing to what it judges; a test holds the two together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element, check_number
from linear_ik.errors import ElementError, SettingsError
from linear_ik.rigid import check_rigid

Array = npt.NDArray[np.float64]
Axis = Literal["x", "y", "z"]

BEND_EXPECTED = "segment:axis:degrees, such as 8:y:22.5"


@dataclass(frozen=True)
class Bend:
    """A rotation of one joint.

    Attributes:
        segment: the segment that turns against the one before it, counted from 1.
        axis: x, y or z, of the segment before it.
        degrees: right-handed about that axis.

    Raises:
        SettingsError: a field that is none of this, named.
    """

    segment: int
    axis: Axis
    degrees: float

    def __post_init__(self) -> None:
        """Check the fields; the element says later how far it bends."""
        object.__setattr__(self, "segment", check_whole("bend segment", self.segment, 1, 10**6))
        if self.axis not in get_args(Axis):
            raise SettingsError("bend axis", f"{self.axis!r}", "x, y or z")
        object.__setattr__(self, "degrees", check_setting("bend degrees", self.degrees, -360.0, 360.0))

    @classmethod
    def parse(cls, text: str) -> Bend:
        """Return the bend written as ``segment:axis:degrees``.

        Raises:
            SettingsError: the text is not of that form.
        """
        parts = [p.strip() for p in text.split(":")]
        try:
            segment, axis, degrees = int(parts[0]), parts[1].lower(), float(parts[2])
        except (IndexError, ValueError):
            raise SettingsError("bend", f"{text!r}", BEND_EXPECTED) from None
        if len(parts) != 3 or axis not in get_args(Axis) or segment < 1 or not math.isfinite(degrees):
            raise SettingsError("bend", f"{text!r}", BEND_EXPECTED)
        return cls(segment, axis, degrees)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class BentElement:
    """An element in a known shape: the truth behind a simulated scan.

    Attributes:
        element: the design.
        joint_angles_rad: [N][3] about x, y, z, applied as R = Rz Ry Rx.
        q: [3N] the same as Pinocchio's configuration, (z, y, x) a segment.
        base_pose: [4][4] T_world_base.
        T_base_segment: [N][4][4] the segments' frames seen from the base's.
        nodes_m: [N+1][3] in the scan's coordinates.
    """

    element: Element
    joint_angles_rad: Array
    q: Array
    base_pose: Array
    T_base_segment: Array
    nodes_m: Array


def bend_element(
    element: Element,
    bends: Sequence[Bend | str] = (),
    joint_angles_rad: npt.ArrayLike | None = None,
    displacement: npt.ArrayLike | None = None,
) -> BentElement:
    """Return the element in a known shape.

    Args:
        element: the design.
        bends: rotations of single joints, as Bend or as "segment:axis:degrees"; several
            of one joint and axis add up, and all to the designed angles.
        joint_angles_rad: [N][3] about x, y, z, in place of ``bends``.
        displacement: [4][4] T_element_base: how the whole member has moved from its
            placement, in the placement's frame; see `rigid_motion`.

    Raises:
        SettingsError: an argument out of its range, a bend of a segment the element has
            not, or beyond its joint limits.
    """
    angles = _joint_angles(element, bends, joint_angles_rad)
    q = angles[:, ::-1].ravel()
    turns = joint_rotations(angles)
    T = np.tile(np.eye(4), (element.segments, 1, 1))
    T[0, :3, :3] = turns[0]
    for k in range(1, element.segments):
        before = T[k - 1, :3]
        T[k, :3, :3] = before[:, :3] @ turns[k]
        T[k, :3, 3] = before[:, 3] + element.segment_length_m * before[:, 2]
    moved = np.eye(4) if displacement is None else check_rigid("displacement", displacement)
    base = element.placement.T_world_element @ moved
    nodes = np.vstack([T[:, :3, 3], T[-1, :3, 3] + element.segment_length_m * T[-1, :3, 2]])
    return BentElement(element, angles, q, base, T, nodes @ base[:3, :3].T + base[:3, 3])


def rigid_motion(translation_m: Sequence[float] = (0, 0, 0), rotation_deg: Sequence[float] = (0, 0, 0)) -> Array:
    """Return a motion [4][4]: rotate by R = Rz Ry Rx about the origin, then translate.

    Args:
        translation_m: along x, y, z.
        rotation_deg: about x, y, z.

    Raises:
        SettingsError: not three finite numbers each.
    """
    T = np.eye(4)
    T[:3, :3] = joint_rotations(np.radians(check_array("rotation_deg", rotation_deg, (3,)))[None])[0]
    T[:3, 3] = check_array("translation_m", translation_m, (3,))
    return T


def check_setting(name: str, value: object, low: float, high: float) -> float:
    """Return ``value`` as a float within its range, or raise SettingsError naming it."""
    try:
        return check_number(name, value, low, high)
    except ElementError as error:
        raise SettingsError(error.subject, error.what, error.expected) from None


def check_whole(name: str, value: object, low: int, high: int) -> int:
    """Return ``value`` as a whole number within its range, or raise SettingsError naming it."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise SettingsError(name, f"{value!r}", f"a whole number from {low} to {high}")
    return int(value)


def check_array(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return ``value`` as finite numbers of ``shape`` (-1: any), or raise SettingsError naming it."""
    expected = "finite numbers, " + "".join(f"[{n if n >= 0 else 'any'}]" for n in shape)
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(name, "not numbers", expected) from None
    if array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)):
        raise SettingsError(name, "shape " + "".join(f"[{n}]" for n in array.shape), expected)
    if not np.isfinite(array).all():
        raise SettingsError(name, "a value that is not finite", expected)
    return array


def _joint_angles(element: Element, bends: Sequence[Bend | str], joint_angles_rad: npt.ArrayLike | None) -> Array:
    """Return the angles [N][3] in x, y, z order, each within the element's limits."""
    if isinstance(bends, (str, Bend)):
        bends = [bends]
    angles, limits = element.design.angles_rad.copy(), element.joint_limits_rad
    if joint_angles_rad is not None:
        if len(bends):
            raise SettingsError("joint_angles_rad", "given together with bends", "one of the two")
        angles = check_array("joint_angles_rad", joint_angles_rad, (element.segments, 3)).copy()
    for item in bends:
        bend = Bend.parse(item) if isinstance(item, str) else item
        if bend.segment > element.segments:
            raise SettingsError("bend", f"segment {bend.segment}", f"1 to {element.segments}, the element's segments")
        angles[bend.segment - 1, "xyz".index(bend.axis)] += math.radians(bend.degrees)
    # Degrees that add up to the limit may exceed it by a rounding: that is at the limit.
    off = angles - element.design.angles_rad
    beyond = np.argwhere(np.abs(off) > element.joint_limit_rad * (1 + 1e-12))
    if len(beyond):
        k, axis = beyond[0]
        limit = np.degrees(element.joint_limit_rad[axis])
        raise SettingsError(
            "bend",
            f"segment {k + 1} by {np.degrees(off[k, axis]):g} degrees about {'xyz'[axis]}",
            f"up to {limit:g} degrees each way, the element's joint_limit_deg",
        )
    return np.asarray(np.clip(angles, limits[..., 0], limits[..., 1]))


def joint_rotations(angles: Array) -> Array:
    """Return R = Rz Ry Rx [N][3][3] of angles [N][3] about x, y, z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles).T, np.sin(angles).T
    rows: Array = np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )
    return np.asarray(rows.transpose(2, 0, 1))
