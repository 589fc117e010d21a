"""Doubts: what in the points around a fitted element says that it may be something else."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.correspondence import Correspondences
from linear_ik.reason import Reason
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

LEAST_SIDE = 0.25  # of the points that a side would have in a complete scan
ONE_SIDE = 0.98  # share of the points; where others are a twentieth, they show a second side
PARALLEL_REACH = 0.3  # of the section's size
CLOSE_M = 0.03
LEAST_SHARE = 0.3  # of the points of the side opposite
ON_SURFACE = 4.0  # deviations
DESIGNED_START = np.array([0.0, 0.0, 1.0])  # where the first segment leads, element's frame
LEAST_STEP_RAD, STEP_REACH = np.radians(10.0), 5  # joints
THIN, THIN_SHARE = 4.0, 1 / 3  # deviations; share of the points
SIDE_OFF_SCORE, SIDE_OFF, LEAST_SIDE_OFF_M = 4.0, 1.5, 0.002
MOST_BESIDE = 0.08
MOST_TURNED_AWAY, LEAST_TURNED_AWAY = 0.2, 20  # of a segment's points


def quadrants(directions: Array) -> npt.NDArray[np.intp]:
    """Return which side, +x, +y, -x or -y (0 to 3), each direction [P][2] points to."""
    x, y = directions.T
    return np.where(np.abs(x) >= np.abs(y), np.where(x > 0, 0, 2), np.where(y > 0, 1, 3)).astype(np.intp)


def seen_around(surface: Surface, pairs: Correspondences) -> bool:
    """Whether the points show all four sides of every segment, as a complete cloud would but for chance.

    With a side missing, the opposite face may have taken its place.
    """
    n = len(pairs.starts) - 1
    count = np.bincount(pairs.segment, minlength=n)
    seen = np.bincount(4 * pairs.segment + quadrants(pairs.gradient), minlength=4 * n).reshape(n, 4)
    share = np.bincount(quadrants(surface.normals), surface.widths_m, minlength=4)
    expected = share / share.sum() * count[:, None]
    return bool((seen >= np.minimum(LEAST_SIDE * expected, expected - 3.0 * np.sqrt(expected))).all())


def doubts(surface: Surface, pairs: Correspondences, matched: Mask, noise_m: float) -> tuple[Reason, ...]:
    """Return what a sample of the points puts in doubt.

    One flat side seen alone cannot be told from a wall. A surface parallel to a side
    that is not seen, within 30 % of the section's size of it, may be that side of
    another section.

    Args:
        surface: the section the points were matched to.
        pairs: matches of the sample.
        matched: [P] which of them lie on the surface.
        noise_m: standard deviation of a point.
    """
    if surface.radius_m is not None:
        return ()
    side = quadrants(pairs.gradient)
    count = np.bincount(side[matched], minlength=4)
    if not count.sum():
        return ()
    out = []
    if count.max() >= ONE_SIDE * count.sum():
        seen_side = f"only the {SIDES[int(count.argmax())]} side is seen"
        out.append(
            Reason("one_side", f"{seen_side}: along it the position is not known, and it may be a wall or a floor")
        )
    low, high = surface.corners.min(axis=0), surface.corners.max(axis=0)
    size = high - low
    for q, name in enumerate(SIDES):
        axis, sign = q % 2, 1.0 if q < 2 else -1.0
        facing = matched & (np.abs(pairs.gradient[:, axis]) > 0.9)
        there = pairs.section[facing, axis]
        outermost = [int(np.count_nonzero(np.abs(there - edge[axis]) < 4.0 * noise_m)) for edge in (high, low)]
        own, opposite = outermost if sign > 0 else outermost[::-1]
        if opposite < 60:
            continue
        seen = own > 0.1 * opposite
        # Beside a side that is seen, only a surface a plate's thickness outside is suspicious.
        low_m, high_m = (
            (4.0 * noise_m, CLOSE_M) if seen else (-PARALLEL_REACH * size[axis], PARALLEL_REACH * size[axis])
        )
        least = int((0.5 if seen else LEAST_SHARE) * opposite)
        offset_m = _parallel(surface, pairs.section[~matched], axis, sign, (low_m, high_m), noise_m, least)
        if offset_m is not None:
            where = "outside" if offset_m > 0 else "inside"
            runs = f"a surface runs along the {name} side, {abs(offset_m) * 1e3:.0f} mm {where}"
            designed = f"{size[0] * 1e3:.0f} x {size[1] * 1e3:.0f} mm"
            out.append(Reason("parallel_surface", f"{runs}: another section than {designed}, or a neighbour"))
    return tuple(out)


def turned_away(surface: Surface, pairs: Correspondences, matched: Mask, noise_m: float) -> Mask:
    """Return which points [P] lie on a face that looks away from their station, and on none that does not.

    Args:
        surface: the section the points were matched to.
        pairs: matches to faces that their stations may have seen; without stations nothing looks away.
        matched: [P] which of them lie on the surface.
        noise_m: standard deviation of a point.
    """
    out = ~matched & (np.abs(pairs.residual_m) > ON_SURFACE * noise_m)
    if surface.radius_m is None:
        out[out] = surface.distances(pairs.section[out]) < ON_SURFACE * noise_m
    else:
        out[:] = False
    return np.asarray(out)


def segments_turned_away(surface: Surface, pairs: Correspondences, matched: Mask, noise_m: float) -> Mask:
    """Return the segments [N] of which a fifth of the points `turned_away`; arguments as there."""
    away = turned_away(surface, pairs, matched, noise_m)
    n = len(pairs.starts) - 1
    count, on = (np.bincount(pairs.segment[rows], minlength=n) for rows in (away, matched))
    return np.asarray((count >= LEAST_TURNED_AWAY) & (count > MOST_TURNED_AWAY * (count + on)))


def sides_off(scores: Array, off_m: Array, noise_m: float) -> Array:
    """Return how far [N] the worst side of each segment lies off the surface, where noise does not explain it, else 0.

    Args:
        scores: [N][sides][halves] standard normal, were the points independent; NaN where too few.
        off_m: the same patches' mean distance to the surface.
        noise_m: standard deviation of a point.
    """
    off_m = np.where(np.abs(scores) > SIDE_OFF_SCORE, np.abs(off_m), 0.0).max(axis=(1, 2))
    return np.where(off_m > max(SIDE_OFF * noise_m, LEAST_SIDE_OFF_M), off_m, 0.0)


def beside_all_along(matched: Index, beside: Index) -> float:
    """Return the share of the points near the surface that lie beside it, of the median segment, where that is a doubt.

    What stands near an element stands near some segments of it; mixed pixels and noise leave a hundredth of the points
    beside the surface. A plate that goes on past its tip is another section, all along. Else 0.

    Args:
        matched: [N] points on each segment's surface.
        beside: [N] points near it that are not.
    """
    share = np.median(beside / np.maximum(matched + beside, 1))
    return float(share) if share > MOST_BESIDE else 0.0


def stepped_aside(pose: Pose) -> tuple[int, int, float] | None:
    """Return the segments (from 0) between which a chain steps aside, and how far, or None.

    Two sharp bends near each other, that cancel in a member which hardly bends elsewhere:
    steel does not do that. The chain crosses over to a neighbour, whose points explain it
    as well. The first bend counts from the design: a base may turn by a few degrees only.
    """
    along = np.concatenate([DESIGNED_START[None], pose.rotations[:, :, 2]])
    bends = np.arccos(np.clip(np.einsum("ki,ki->k", along[1:], along[:-1]), -1.0, 1.0))
    for i in range(len(bends)):
        for j in range(i + 1, min(i + STEP_REACH, len(bends))):
            lesser, greater = sorted((bends[i], bends[j]))
            rest = np.delete(bends, slice(i, j + 1))
            left = np.arccos(np.clip(along[i] @ along[j + 1], -1.0, 1.0))
            if lesser > LEAST_STEP_RAD and left < 0.4 * greater and rest.max(initial=0.0) < lesser / 3.0:
                offset = pose.nodes_m[j] - pose.nodes_m[i]
                return i, j - 1, float(np.linalg.norm(offset - (offset @ along[i]) * along[i]))
    return None


def plates_too_thin(surface: Surface, pairs: Correspondences, matched: Mask, noise_m: float, seen: Mask) -> bool:
    """Whether a third of the points lie on plates less than 4 deviations thick, told apart by nothing else.

    The points of one side of such a plate are nearer to the other side, one in forty and
    more: the section shifts to where those few want it, and the covariance does not know.

    Args:
        surface: the section the points were matched to.
        pairs: matches of the sample.
        matched: [P] which of them lie on the surface.
        noise_m: standard deviation of a point.
        seen: [E] faces that points may lie on; a plate that is seen from one side only needs no telling apart.
    """
    if surface.radius_m is not None or not matched.any():
        return False
    middle = surface.corners + 0.5 * surface.widths_m[:, None] * surface.tangents
    half_m = 0.5 * THIN * noise_m
    thin = surface.faces(seen).distances(middle - half_m * surface.normals) < 0.999 * half_m
    thin &= surface.widths_m > 2.0 * THIN * noise_m  # not the edges of the plates themselves
    return bool(np.mean(thin[pairs.face[matched]]) > THIN_SHARE)


SIDES = ("+x", "+y", "-x", "-y")


def _parallel(
    surface: Surface,
    local: Array,
    axis: int,
    sign: float,
    between_m: tuple[float, float],
    noise_m: float,
    least: int,
) -> float | None:
    """Return how far outside a side of the bounding box points [P][2] make up a parallel surface, or None."""
    low, high = surface.corners.min(axis=0), surface.corners.max(axis=0)
    face = high[axis] if sign > 0 else -low[axis]
    across = 1 - axis
    beside = (local[:, across] > low[across] - 0.02) & (local[:, across] < high[across] + 0.02)
    offset = sign * local[beside, axis] - face
    offset = offset[(offset > between_m[0]) & (offset < between_m[1]) & (np.abs(offset) > 4.0 * noise_m)]
    if len(offset) < max(least, 30):
        return None
    # The densest band as wide as a surface's scatter.
    offset = np.sort(offset)
    band = np.searchsorted(offset, offset + 6.0 * noise_m) - np.arange(len(offset))
    best = int(band.argmax())
    return float(np.median(offset[best : best + band[best]])) if band[best] >= max(least, 30) else None
