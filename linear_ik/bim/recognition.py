"""Recognition: an outline drawn point by point as the I, L, U, T, box, tube or bar that it is.

A named profile has a dozen faces where its drawn outline has fifty, most of them chords of
fillets. Fillets and rounded edges are taken off first; what is left has right angles, and
their sequence tells the kind. An outline that is none of them stays a polygon.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from linear_ik.bim.placed_profile import PlacedProfile, centred
from linear_ik.bim.rounding import Rounded, sharpened, without_flat_corners
from linear_ik.errors import ElementError
from linear_ik.profile import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Polygon,
    Profile,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)

Array = npt.NDArray[np.float64]

FEWEST_ON_CIRCLE = 12  # an octagonal column has flats that a scanner sees
ROUND = 0.004  # of the radius
ROUND_M = 2e-4
LARGEST_HOLLOW_ROUNDING = 0.25  # of the shorter side: a cold-formed box has up to three wall thicknesses
LARGEST_EDGE_ROUNDING = 1.5  # of the thickness that ends there
QUARTERS = [np.array([[c, -s], [s, c]], dtype=np.float64) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]


def recognise(outline: Array, holes: tuple[Array, ...] = (), tolerance_m: float = 1e-3) -> PlacedProfile:
    """Return the profile that an outline draws.

    A hole makes a box or tube of a rectangle or circle when it lies in its middle; other
    holes are left out, for a scanner sees a member from outside.

    Args:
        outline: [V][2] corners in either sense, the first one repeated or not.
        holes: outlines of the same kind inside.
        tolerance_m: how far a named profile may be from the outline, rounded edges aside.

    Raises:
        ElementError: an outline that crosses itself, or has no area.
    """
    corners = without_flat_corners(Polygon(outline).outline())  # type: ignore[arg-type]
    inner = [without_flat_corners(Polygon(hole).outline()) for hole in holes]  # type: ignore[arg-type]
    for found in (_round(corners, inner), _angular(corners, inner, tolerance_m)):
        if found is not None:
            return found
    return centred(Polygon(corners))  # type: ignore[arg-type]


def _round(corners: Array, holes: list[Array]) -> PlacedProfile | None:
    """Return the circle that has all corners on it, or None."""
    circle = _circle(corners)
    if circle is None:
        return None
    middle, radius = circle
    profile: Profile = Circle(radius)
    if len(holes) == 1:
        inside = _circle(holes[0])
        if inside is not None and np.linalg.norm(inside[0] - middle) <= max(ROUND_M, 0.02 * radius):
            profile = _or(lambda: CircleHollow(radius, radius - inside[1]), profile) or profile
    return PlacedProfile(profile, np.eye(2), middle)


def _circle(corners: Array) -> tuple[Array, float] | None:
    """Return centre [2] and radius of the circle through the corners, or None."""
    if len(corners) < FEWEST_ON_CIRCLE:
        return None
    start = corners.mean(axis=0)
    x, y = (corners - start).T
    # |p|^2 = 2 c.p + (r^2 - |c|^2), linear in c and the rest.
    solution, *_ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(len(x))]), x * x + y * y, rcond=None)
    centre = solution[:2]
    distances = np.hypot(x - centre[0], y - centre[1])
    radius = float(distances.mean())
    if np.abs(distances - radius).max() > max(ROUND_M, ROUND * radius):
        return None
    # The corners of a rectangle with rounded edges may lie on a circle too, far apart.
    longest = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).max()
    return (start + centre, radius) if longest < radius else None


def _angular(corners: Array, holes: list[Array], tolerance_m: float) -> PlacedProfile | None:
    """Return the section with right angles that the corners are, or None."""
    sharp = sharpened(corners)
    match = _KINDS.get(_turns(sharp.corners))
    if match is None:
        return None
    edges = np.roll(sharp.corners, -1, axis=0) - sharp.corners
    longest = edges[np.linalg.norm(edges, axis=1).argmax()]
    angle = np.arctan2(longest[1], longest[0])
    # The quarter turn that is nearest to none first: a rectangle keeps its sides' order where it can.
    angle -= np.round(angle / (np.pi / 2)) * (np.pi / 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for quarter in QUARTERS:
        R = turn @ quarter
        placed = sharp.corners @ R
        middle = (placed.min(axis=0) + placed.max(axis=0)) / 2
        found = match(placed - middle, sharp, holes, tolerance_m)
        if found is not None:
            return PlacedProfile(found, R, R @ middle)
    return None


def _turns(corners: Array) -> str:
    """Return the sequence of left and right turns, begun where it is smallest in the alphabet."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    text = "".join("L" if c > 0 else "R" for c in cross)
    return min(text[i:] + text[:i] for i in range(len(text)))


def _rectangle(corners: Array, sharp: Rounded, holes: list[Array], tolerance_m: float) -> Profile | None:
    x, y = np.ptp(corners, axis=0)
    solid = Rectangle(x, y)
    if not _same(solid, corners, tolerance_m):
        return None
    wall = _wall_m(corners, holes, tolerance_m)
    largest = LARGEST_HOLLOW_ROUNDING * min(x, y) if wall is not None else _unseen(tolerance_m)
    if max(sharp.convex_m, default=0.0) > largest:
        return None
    return solid if wall is None else _or(lambda: RectangleHollow(x, y, wall), solid)


def _wall_m(corners: Array, holes: list[Array], tolerance_m: float) -> float | None:
    """Return the thickness of the wall that a hole leaves all around, or None.

    The hole is in the plane as drawn, the corners are centred and turned; areas don't mind.
    """
    if len(holes) != 1:
        return None
    inside = sharpened(holes[0]).corners
    if len(inside) != 4:
        return None
    x, y = np.ptp(corners, axis=0)
    sides = np.linalg.norm(np.roll(inside, -1, axis=0) - inside, axis=1)
    long, short = (sides[0] + sides[2]) / 2, (sides[1] + sides[3]) / 2
    if (long - short) * (x - y) < 0:
        long, short = short, long
    walls = np.array([x - long, y - short]) / 2
    return float(walls.mean()) if np.ptp(walls) <= tolerance_m and walls.min() > 0 else None


def _i_shape(corners: Array, sharp: Rounded, holes: list[Array], tolerance_m: float) -> Profile | None:
    x, y = np.abs(corners).T
    width, depth = 2 * x.max(), 2 * y.max()
    web, flange = 2 * _least(x), depth / 2 - _least(y)
    return _checked(lambda r: IShape(width, depth, web, flange, r), corners, sharp, min(web, flange), tolerance_m)


def _l_shape(corners: Array, sharp: Rounded, holes: list[Array], tolerance_m: float) -> Profile | None:
    width, depth = np.ptp(corners, axis=0)
    inner = corners[_reflex(corners)][0]
    legs = inner + [width / 2, depth / 2]
    if legs.min() <= 0 or np.ptp(legs) > tolerance_m:
        return None
    thickness = float(legs.mean())
    return _checked(lambda r: LShape(depth, width, thickness, r), corners, sharp, thickness, tolerance_m)


def _u_shape(corners: Array, sharp: Rounded, holes: list[Array], tolerance_m: float) -> Profile | None:
    width, depth = np.ptp(corners, axis=0)
    inner = corners[_reflex(corners)]
    web, flange = float(inner[:, 0].mean() + width / 2), float(depth / 2 - np.abs(inner[:, 1]).mean())
    return _checked(lambda r: UShape(depth, width, web, flange, r), corners, sharp, min(web, flange), tolerance_m)


def _t_shape(corners: Array, sharp: Rounded, holes: list[Array], tolerance_m: float) -> Profile | None:
    width, depth = np.ptp(corners, axis=0)
    inner = corners[_reflex(corners)]
    web, flange = 2 * float(np.abs(inner[:, 0]).mean()), float(depth / 2 - inner[:, 1].mean())
    return _checked(lambda r: TShape(depth, width, web, flange, r), corners, sharp, min(web, flange), tolerance_m)


Match = Callable[[Array, Rounded, list[Array], float], "Profile | None"]
_KINDS: dict[str, Match] = {
    "LLLL": _rectangle,
    "LLLLLR": _l_shape,
    "LLLLLLRR": _u_shape,
    "LLLLRLLR": _t_shape,
    "LLLLRRLLLLRR": _i_shape,
}


def _checked(
    make: Callable[[float], Profile], corners: Array, sharp: Rounded, thickness_m: float, tolerance_m: float
) -> Profile | None:
    """Return the profile if it has these corners and edges no rounder than rolled ones, else None."""
    plain = _or(lambda: make(0.0), None)
    if plain is None or not _same(plain, corners, tolerance_m):
        return None
    if max(sharp.convex_m, default=0.0) > max(LARGEST_EDGE_ROUNDING * thickness_m, _unseen(tolerance_m)):
        return None
    if not sharp.concave_m:
        return plain
    return _or(lambda: make(float(np.mean(sharp.concave_m))), plain)


def _same(profile: Profile, corners: Array, tolerance_m: float) -> bool:
    """Say whether a profile without fillets has these corners [V][2], in whatever order."""
    own = profile.outline()
    if len(own) != len(corners):
        return False
    apart = np.linalg.norm(own[:, None] - corners[None], axis=2)
    return bool(max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= tolerance_m)


def _unseen(tolerance_m: float) -> float:
    """Return the radius whose arc is within the tolerance of the sharp corner's sides."""
    return float(tolerance_m / (1 - np.sqrt(0.5)))


def _reflex(corners: Array) -> npt.NDArray[np.bool_]:
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    return np.asarray(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0)


def _least(values: Array) -> float:
    """Return the mean of the smaller values: those of the web's or the flanges' inner corners."""
    return float(np.sort(values)[:4].mean())


def _or(make: Callable[[], Profile], otherwise: Profile | None) -> Profile | None:
    """Return what ``make`` makes, or the other one where the dimensions contradict each other."""
    try:
        return make()
    except ElementError:
        return otherwise
