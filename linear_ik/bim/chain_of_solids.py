"""Straight pieces one behind the other, as bent members are written: one sweep along all of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.bim.sweep import Sweep, into
from linear_ik.profile import Profile

Array = npt.NDArray[np.float64]

GAP = 0.25  # of the section's larger side, between the end of a piece and the start of the next


def joined(sweeps: list[Sweep]) -> Sweep | None:
    """Return pieces of one section as a sweep along the polyline of their axes, or None where they are none.

    Neighbouring pieces meet where their axes come nearest: where they lean against each
    other, what is cut off or overlaps is half the section's side times the angle.
    """
    if len(sweeps) < 2 or any(s.axis_m is not None or s.profile_end is not None for s in sweeps):
        return None
    profile = sweeps[0].profile
    if any(not _same(profile, s.profile) for s in sweeps[1:]):
        return None
    ends = [
        (s.T_product_start[:3, 3], s.T_product_start[:3, 3] + s.length_m * s.T_product_start[:3, 2]) for s in sweeps
    ]
    gap = GAP * float(np.ptp(profile.outline(), axis=0).max())
    points = [ends[0][0]]
    for (_, end), (start, _) in zip(ends[:-1], ends[1:], strict=True):
        if np.linalg.norm(end - start) > gap:
            return None
        points.append((end + start) / 2)
    points.append(ends[-1][1])
    T = sweeps[0].T_product_start
    axis = into(T, np.array(points))
    if (np.diff(axis, axis=0) @ [0.0, 0.0, 1.0])[0] <= 0:
        return None
    length_m = float(np.linalg.norm(np.diff(axis, axis=0), axis=1).sum())
    if np.linalg.norm(axis[:, :2], axis=1).max() < 1e-6:
        return Sweep(T, profile, length_m)
    return Sweep(T, profile, length_m, axis_m=axis)


def _same(a: Profile, b: Profile) -> bool:
    first, second = a.outline(), b.outline()
    return type(a) is type(b) and first.shape == second.shape and bool(np.abs(first - second).max() < 1e-5)
