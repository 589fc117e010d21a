"""Slides: hypotheses beside one that was found, where other faces of the design lie on the scan's.

A refinement finds the faces that are nearest. Where a design has parallel ones (the two sides of a
slab, the floors of a house, a row of beams) those may be the wrong ones, and the points of a large
plane hold it there. So the scan is slid along the design's main directions, and where many of its
points meet faces again, that is another hypothesis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.quality import share_within
from linear_ik.alignment.target import Target

Array = npt.NDArray[np.float64]

MOST_POINTS = 400  # a share of them is right to a few per cent
MOST_PEAKS = 4  # along one direction
LEAST_PART = 0.8  # of the share where the slide began
UPRIGHT = 0.1  # most that the z of a wall's normal is


class Reach(NamedTuple):
    """How far to slide, and in which steps.

    Attributes:
        upwards_m: along z, both ways.
        sideways_m: along both horizontal directions, both ways.
        step_m: between two places; a point so near to a face is on it.
    """

    upwards_m: float
    sideways_m: float
    step_m: float


FAR = Reach(4.5, 1.0, 0.06)  # a storey
NEAR = Reach(0.4, 0.4, 0.06)
SLABS = Reach(0.16, 0.16, 0.02)  # thin slabs and walls, and the webs of large sections
FLANGES = Reach(0.04, 0.04, 0.004)


def slid(target: Target, scan: Array, T_target_scan: Array, reach: Reach) -> list[Array]:  # noqa: N803
    """Return other hypotheses [4][4] along the design's main directions, the likeliest first.

    Args:
        target: the design.
        scan: [P][3] points in random order.
        T_target_scan: [4][4] where to begin.
        reach: how far to slide.
    """
    scan = scan[:MOST_POINTS]
    step_m = reach.step_m
    least = LEAST_PART * share_within(target, scan, T_target_scan, step_m)
    found: list[tuple[float, Array]] = []
    far = (reach.upwards_m, reach.sideways_m, reach.sideways_m)
    for direction, far_m in zip(main_directions(target), far, strict=True):
        count = round(far_m / step_m)
        shifts = np.arange(-count, count + 1) * step_m
        hypotheses = [_shifted(T_target_scan, s * direction) for s in shifts]
        shares = np.array([share_within(target, scan, T, step_m) for T in hypotheses])
        beside = np.pad(shares, 1)
        peak = (shares >= beside[:-2]) & (shares > beside[2:]) & (shares >= least) & (np.abs(shifts) > 1.5 * step_m)
        best = sorted(np.flatnonzero(peak), key=lambda i: -shares[i])[:MOST_PEAKS]
        found += [(float(shares[i]), hypotheses[i]) for i in best]
    return [T for _, T in sorted(found, key=lambda f: -f[0])]


def main_directions(target: Target) -> tuple[Array, Array, Array]:
    """Return z, and the two horizontal directions [3] that most of the upright faces look along."""
    upright = target.normals[np.abs(target.normals[:, 2]) < UPRIGHT]
    # Four times the angle: walls that look to all four sides agree.
    angle = float(np.angle(((upright[:, 0] + 1j * upright[:, 1]) ** 4).sum())) / 4
    c, s = np.cos(angle), np.sin(angle)
    return np.array([0.0, 0.0, 1.0]), np.array([c, s, 0.0]), np.array([-s, c, 0.0])


def _shifted(T: Array, offset: Array) -> Array:  # noqa: N803
    out = T.copy()
    out[:3, 3] += offset
    return np.asarray(out)
