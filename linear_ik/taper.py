"""Taper: a section that varies linearly along an element, from one profile to another of its type.

Corner by corner: dimension by dimension for the named profiles, whose corners are linear
in their dimensions, so that every section in between is a profile of that type.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from linear_ik.errors import ElementError
from linear_ik.profile import Polygon, Profile

# Between edges that are not parallel a face is twisted: within this, flat to a hair.
LARGEST_TWIST_RAD = 0.01


def check_taper(start: Profile, end: Profile) -> None:
    """Check that a section can vary from one profile to another.

    Raises:
        ElementError: said of ``profile_end``: profiles of two types, another number of
            corners, or edges that turn on the way.
    """
    if not isinstance(end, Profile):
        raise ElementError("profile_end", f"{end!r}", "a profile of the type of profile, or None")
    if type(end) is not type(start):
        raise ElementError("profile_end", f"type {end.type}", f"{start.type}, the type of profile")
    first, last = start.outline(), end.outline()
    if len(first) != len(last):
        which = "corners" if isinstance(start, Polygon) else "corners, fillets included"
        raise ElementError("profile_end", f"{len(last)} {which}", f"{len(first)}, as many as profile has")
    before, after = (np.roll(corners, -1, axis=0) - corners for corners in (first, last))
    turn = np.abs(
        np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.einsum("ij,ij->i", before, after))
    )
    if turn.max() > LARGEST_TWIST_RAD:
        worst = int(turn.argmax())
        raise ElementError(
            "profile_end",
            f"the edge from corner {worst} is turned by {np.degrees(turn[worst]):.1f} degrees against profile's",
            "corners in the order of profile's, and edges parallel to them, so that faces are flat",
        )
    between(start, end, 0.5)


def between(start: Profile, end: Profile, share: float) -> Profile:
    """Return the profile at ``share`` (0 to 1) of the way from ``start`` to ``end``.

    Raises:
        ElementError: a polygon that crosses itself there.
    """
    if isinstance(start, Polygon):
        return Polygon((1.0 - share) * start.outline() + share * end.outline())  # type: ignore[arg-type]
    values = {f.name: (1.0 - share) * getattr(start, f.name) + share * getattr(end, f.name) for f in fields(start)}
    return type(start)(**values)
