"""What stands: a sweep brought to the length of the tessellated body, and compared with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from linear_ik.bim.sweep import Sweep, into, out_of
from linear_ik.design_axis import follow
from linear_ik.directions import turn
from linear_ik.profile import Profile
from linear_ik.taper import between

Array = npt.NDArray[np.float64]

LEAST_LENGTH_M = 1e-3


@dataclass(frozen=True)
class Agreement:
    """How a sweep and a tessellated body agree, in metres.

    Attributes:
        outside_m: how far the body's farthest vertex sticks out of the section, 0 where none does.
        short_m: how far the body stays inside the section's bounding box, on the side where it does most.
        ends_m: how far the body's ends are from the line's, on a curved line; 0 on a straight one,
            which was brought to the body's length.
    """

    outside_m: float
    short_m: float
    ends_m: float = 0.0


def stood(sweep: Sweep, vertices: Array) -> Sweep | None:
    """Return a straight sweep from where a body [V][3] begins to where it ends; a curved one as it is.

    None where nothing of the body is left.
    """
    if sweep.axis_m is not None:
        return sweep
    z = into(sweep.T_product_start, vertices)[:, 2]
    low, high = float(z.min()), float(z.max())
    if high - low < LEAST_LENGTH_M:
        return None
    T = sweep.T_product_start.copy()
    T[:3, 3] += low * T[:3, 2]
    profile, profile_end = sweep.profile, sweep.profile_end
    if profile_end is not None:
        ends = [between(profile, profile_end, at / sweep.length_m) for at in (low, high)]
        profile, profile_end = ends[0], ends[1]
    return replace(sweep, T_product_start=T, profile=profile, profile_end=profile_end, length_m=high - low)


def agreement(sweep: Sweep, vertices: Array) -> Agreement:
    """Compare a sweep with the vertices of a body [V][3] in the same coordinates."""
    local = into(sweep.T_product_start, vertices)
    if sweep.axis_m is not None:
        xy, ends_m = _around(sweep, local)
        return Agreement(_outside_m(sweep.profile, xy), _short_m(sweep.profile, xy), ends_m)
    if sweep.profile_end is None:
        xy = local[:, :2]
        return Agreement(_outside_m(sweep.profile, xy), _short_m(sweep.profile, xy))
    # Section by section of a taper; where its bounding box is reached is judged at the ends.
    shares = np.clip(local[:, 2] / sweep.length_m, 0.0, 1.0)
    worst = 0.0
    short = [np.inf, np.inf]
    for share in np.unique(shares.round(6)):
        rows = np.abs(shares - share) < 1e-6
        profile = between(sweep.profile, sweep.profile_end, float(share))
        worst = max(worst, _outside_m(profile, local[rows, :2]))
        for k, end in enumerate((0.0, 1.0)):
            if abs(share - end) < 1e-6:
                short[k] = _short_m(profile, local[rows, :2])
    return Agreement(worst, float(min(short)) if np.isfinite(short).any() else 0.0)


def box_difference_m(sweep: Sweep, vertices: Array) -> float:
    """Return how far the bounding boxes of a body [V][3] and of a round section along a curve differ; inf of others."""
    if sweep.axis_m is None or sweep.profile.radius_m is None:
        return float("inf")
    axis = out_of(sweep.T_product_start, sweep.axis_m)
    legs = np.diff(axis, axis=0)
    directions = legs / np.linalg.norm(legs, axis=1)[:, None]
    # A disk across a direction d reaches r sqrt(1 - d_x^2) along x.
    reach = sweep.profile.radius_m * np.sqrt(np.clip(1 - directions**2, 0.0, 1.0))
    ends = np.stack([axis[:-1], axis[1:]])
    low, high = (ends - reach).min(axis=(0, 1)), (ends + reach).max(axis=(0, 1))
    return float(max(np.abs(low - vertices.min(axis=0)).max(), np.abs(high - vertices.max(axis=0)).max()))


def _around(sweep: Sweep, local: Array) -> tuple[Array, float]:
    """Return vertices [V][3] in the plane of the section next to them [V][2], and how far the body's ends are off."""
    assert sweep.axis_m is not None
    axis = sweep.axis_m
    legs = np.diff(axis, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    frames = transported(axis)
    best, along, xy = np.full(len(local), np.inf), np.zeros(len(local)), np.zeros((len(local), 2))
    begins = np.cumsum(lengths) - lengths
    for k, frame in enumerate(frames):
        own = (local - axis[k]) @ frame
        # Half a leg further at both ends of the line, so that the last section is not cut off.
        over = own[:, 2] - np.clip(own[:, 2], 0.0, lengths[k])
        distance = np.hypot(np.linalg.norm(own[:, :2], axis=1), over)
        nearer = distance < best - 1e-12
        best[nearer], along[nearer], xy[nearer] = distance[nearer], (begins[k] + own[:, 2])[nearer], own[nearer, :2]
    return xy, float(max(abs(along.min()), abs(along.max() - lengths.sum())))


def transported(axis: Array) -> Array:
    """Return the frames [P-1][3][3] of the legs of a polyline [P][3], carried along without twist from the identity."""
    legs = np.diff(axis, axis=0)
    directions = legs / np.linalg.norm(legs, axis=1)[:, None]
    R, frames = np.eye(3), []
    for direction in directions:
        R = R @ turn(np.array([0.0, 0.0, 1.0]), R.T @ direction)
        frames.append(R)
    return np.array(frames)


def enough_segments(points: Array, fewest: int, most: int) -> int | None:
    """Return the first number of segments that can follow a polyline [P][3], or None."""
    from linear_ik.errors import ElementError

    for segments in range(fewest, most + 1):
        try:
            follow(tuple(map(tuple, points)), segments)
        except ElementError:
            continue
        return segments
    return None


def _outside_m(profile: Profile, xy: Array) -> float:
    """Return the distance of the farthest point [V][2] outside a profile's outline."""
    if profile.radius_m is not None:
        return max(float(np.hypot(*xy.T).max()) - profile.radius_m, 0.0)
    import shapely

    polygon = shapely.Polygon(profile.outline())
    shapely.prepare(polygon)
    return float(shapely.distance(polygon, shapely.points(xy)).max())


def _short_m(profile: Profile, xy: Array) -> float:
    outline = profile.outline()
    gaps = np.concatenate([xy.min(axis=0) - outline.min(axis=0), outline.max(axis=0) - xy.max(axis=0)])
    return float(max(gaps.max(), 0.0))
