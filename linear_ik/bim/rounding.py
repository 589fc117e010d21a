"""Outlines without what hides their shape: corners that are none, fillets and rounded edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FLAT_M = 2e-5  # a corner so little off the line of its neighbours is a point on an edge
LEAST_TURN_RAD = np.radians(1.0)
LARGEST_STEP_RAD = np.radians(60.0)  # between chords of an arc; a real corner turns by more
RIGHT_RAD = np.radians(1.0)  # how right an angle has to be


@dataclass(frozen=True, eq=False)
class Rounded:
    """An outline with its arcs replaced by the corners that they cut off or fill.

    Attributes:
        corners: [V][2], counter-clockwise; those of the outline itself where an angle is not right.
        convex_m: radius of each rounded edge.
        concave_m: radius of each fillet.
    """

    corners: Array
    convex_m: tuple[float, ...]
    concave_m: tuple[float, ...]


def without_flat_corners(corners: Array) -> Array:
    """Return an outline [V][2] without the points that lie on its edges, the flattest taken off first."""
    kept = corners
    while len(kept) > 3:
        before, after = np.roll(kept, 1, axis=0), np.roll(kept, -1, axis=0)
        chord, offset = after - before, kept - before
        length = np.maximum(np.linalg.norm(chord, axis=1), 1e-12)
        off = np.abs(chord[:, 0] * offset[:, 1] - chord[:, 1] * offset[:, 0]) / length
        # One at a time: with a point on the edge beside it a real corner looks flat too.
        flattest = int(off.argmin())
        if off[flattest] >= FLAT_M:
            break
        kept = np.delete(kept, flattest, axis=0)
    return kept


def sharpened(corners: Array) -> Rounded:
    """Take the arcs of an outline [V][2], counter-clockwise, for the right-angled corners behind them."""
    edges = np.roll(corners, -1, axis=0) - corners
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    turns = (heading - np.roll(heading, 1) + np.pi) % (2 * np.pi) - np.pi
    soft = (np.abs(turns) > LEAST_TURN_RAD) & (np.abs(turns) < LARGEST_STEP_RAD)
    plain = Rounded(corners, (), ())
    if not soft.any():
        return plain
    # From the end of the longest edge on, which is no chord: no arc is cut in two.
    first = int(np.linalg.norm(edges, axis=1).argmax()) + 1
    walk = _Walk(np.roll(corners, -first, axis=0), np.roll(turns, -first), np.roll(soft, -first))
    while walk.at < len(corners):
        if not walk.step():
            return plain
    return Rounded(without_flat_corners(np.array(walk.out)), tuple(walk.radii[True]), tuple(walk.radii[False]))


class _Walk:
    """Goes around an outline, from corner to corner or over an arc at a time."""

    def __init__(self, corners: Array, turns: Array, soft: npt.NDArray[np.bool_]) -> None:
        self.corners, self.turns, self.soft = corners, turns, soft
        self.at = 0
        self.out: list[Array] = []
        self.radii: dict[bool, list[float]] = {True: [], False: []}

    def step(self) -> bool:
        """Take the next corner or arc; False where an arc has no right-angled corner behind it."""
        i, n = self.at, len(self.corners)
        if not self.soft[i]:
            turn = self.turns[i]
            end, turned = self._arc(i + 1, turn)
            # A toe that is round from here on: the arc leaves its side at a right angle.
            if end > i + 1 and turn * turned > 0 and abs(abs(turn) + abs(turned) - np.pi) < 2 * RIGHT_RAD:
                corner = self._toe(self.corners[i], self.corners[end - 1], self.corners[end % n])
                self._take(end, turned, [self.corners[i], corner], corner - self.corners[end - 1])
                return True
            self.out.append(self.corners[i])
            self.at += 1
            return True
        end, turned = self._arc(i, self.turns[i])
        before, begin, last, after = (self.corners[k % n] for k in (i - 1, i, end - 1, end))
        if abs(abs(turned) - np.pi / 2) < 2 * RIGHT_RAD:
            corner = _meet(before, begin, last, after)
            self._take(end, turned, [corner], corner - begin)
            return True
        hard = self.turns[end] if end < n and not self.soft[end] else 0.0
        # The same from the other side.
        if hard * turned > 0 and abs(abs(hard) + abs(turned) - np.pi) < 2 * RIGHT_RAD:
            corner = self._toe(after, before, begin)
            self._take(end + 1, turned, [corner, after], corner - begin)
            return True
        return False

    def _arc(self, i: int, sign: float) -> tuple[int, float]:
        """Return the corner after the arc that begins at corner i, and by how much it turns."""
        turned = 0.0
        # A quarter circle at a time: the arcs at the ends of a side that both turn left are two.
        while (
            i < len(self.corners) and self.soft[i] and self.turns[i] * sign > 0 and abs(turned) < np.pi / 2 - RIGHT_RAD
        ):
            turned += float(self.turns[i])
            i += 1
        return i, turned

    def _take(self, end: int, turned: float, corners: list[Array], tangent: Array) -> None:
        self.out += corners
        self.radii[turned > 0].append(float(np.linalg.norm(tangent)))
        self.at = end

    @staticmethod
    def _toe(tip: Array, a: Array, b: Array) -> Array:
        """Return the foot [2] of the tip on the line through a and b: the corner of a toe that is round."""
        along = (b - a) / np.linalg.norm(b - a)
        return np.asarray(a + ((tip - a) @ along) * along)


def _meet(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the point [2] where the lines through a, b and through c, d meet, which are nearly at right angles."""
    u, v, w = b - a, d - c, c - a
    cross = u[0] * v[1] - u[1] * v[0]
    return np.asarray(a + u * ((w[0] * v[1] - w[1] * v[0]) / cross))
