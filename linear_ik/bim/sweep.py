"""Sweep: a section along a line, in the coordinates of a product, before it is a member."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.bim.placed_profile import PlacedProfile
from linear_ik.profile import Profile

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sweep:
    """A section along a straight or curved line.

    Attributes:
        T_product_start: [4][4] rigid: origin on the line's start, Z along it, X and Y those of the profile.
        profile: at the start.
        profile_end: at the end of a tapered one, else None.
        length_m: along the line.
        axis_m: [P][3] the line in the frame of the start where it is not straight, else None.
    """

    T_product_start: Array
    profile: Profile
    length_m: float
    profile_end: Profile | None = None
    axis_m: Array | None = None


def line_frame(start: Array, direction: Array, x: Array) -> Array:
    """Return the rigid frame [4][4] at a point with Z along a direction and X as near as can be to a vector."""
    z = direction / np.linalg.norm(direction)
    across = x - (x @ z) * z
    if np.linalg.norm(across) < 1e-6 * np.linalg.norm(x):
        across = np.eye(3)[np.abs(z).argmin()]
        across = across - (across @ z) * z
    across /= np.linalg.norm(across)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = across, np.cross(z, across), z, start
    return T


def seated(T_line: Array, placed: PlacedProfile) -> Array:
    """Return the frame [4][4] of a line moved into the middle of a profile in its XY plane, and turned with it."""
    T = np.eye(4)
    T[:2, :2], T[:2, 3] = placed.R, placed.t_m
    return np.asarray(T_line @ T)


def into(T: Array, points: Array) -> Array:
    """Return points [P][3] in the coordinates of a rigid frame [4][4]."""
    return np.asarray((points - T[:3, 3]) @ T[:3, :3])


def out_of(T: Array, points: Array) -> Array:
    """Return points [P][3] of the coordinates of a frame [4][4] in those that the frame is given in."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])
