"""PlacedProfile: a profile of this package where a design draws it in the plane of its section.

A design may draw a section anywhere in its plane, turned, mirrored, stretched, or seen at a
slant. Here it becomes a profile centred on its bounding box as the package draws it, a
rotation and an offset: the frame of the member takes those over.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from linear_ik.profile import LShape, Polygon, Profile, UShape

Array = npt.NDArray[np.float64]

SAME = 1e-6  # of a rotation's elements


@dataclass(frozen=True, eq=False)
class PlacedProfile:
    """A profile in a plane: the plane's coordinates are ``R @ profile's + t_m``.

    Attributes:
        profile: centred on its bounding box.
        R: [2][2] rotation.
        t_m: [2] where the middle of the profile's bounding box is.
    """

    profile: Profile
    R: Array
    t_m: Array

    def outline(self) -> Array:
        """Return the outer outline [V][2] in the plane, counter-clockwise."""
        return np.asarray(self.profile.outline() @ self.R.T + self.t_m)


def centred(profile: Profile) -> PlacedProfile:
    """Return a profile as the package draws it; a polygon is moved to the middle of its bounding box."""
    if not isinstance(profile, Polygon):
        return PlacedProfile(profile, np.eye(2), np.zeros(2))
    outline = profile.outline()
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    return PlacedProfile(Polygon(outline - middle), np.eye(2), middle)


def carried(placed: PlacedProfile, linear: Array, offset_m: Array) -> PlacedProfile | None:
    """Return a placed profile after a map of its plane: ``linear @ x + offset_m``.

    Args:
        placed: the profile.
        linear: [2][2] rotation, reflection and scale.
        offset_m: [2].

    Returns:
        None where the map is another one, after which a named profile is none any more.
    """
    whole = linear @ placed.R
    scale = float(np.sqrt(abs(np.linalg.det(whole))))
    if not scale > 0:
        return None
    turned = whole / scale
    if np.abs(turned.T @ turned - np.eye(2)).max() > SAME:
        return None
    profile = _scaled(placed.profile, scale)
    if np.linalg.det(turned) < 0:
        profile, mirror = _mirrored(profile)
        turned = turned @ mirror
    return PlacedProfile(profile, turned, linear @ placed.t_m + offset_m)


def _scaled(profile: Profile, scale: float) -> Profile:
    if abs(scale - 1) < 1e-12:
        return profile
    if isinstance(profile, Polygon):
        return Polygon(profile.outline() * scale)  # type: ignore[arg-type]
    return type(profile)(**{f.name: scale * getattr(profile, f.name) for f in fields(profile)})


def _mirrored(profile: Profile) -> tuple[Profile, Array]:
    """Return another profile and a reflection M [2][2], such that M @ the other one is the given one.

    So what a design mirrors needs no mirror: the sections are symmetric about a line, or, as
    an L, become another one of their kind.
    """
    if isinstance(profile, UShape):
        return profile, np.diag([1.0, -1.0])
    if isinstance(profile, LShape):
        return replace(profile, depth=profile.width, width=profile.depth), np.array([[0.0, 1.0], [1.0, 0.0]])
    flip = np.diag([-1.0, 1.0])
    if isinstance(profile, Polygon):
        return Polygon(profile.outline() @ flip), flip  # type: ignore[arg-type]
    return profile, flip
