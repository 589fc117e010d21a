"""Search directions: where a new segment may point, and a free base stand, as the start-up tries them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain
from linear_ik.problem import Problem

Array = npt.NDArray[np.float64]

SHIFT_STEP_M, MOST_STEPS = 0.02, 8  # of a floating base, each way; a large tolerance is searched more coarsely
# Fine near straight, where most members are.
RINGS_RAD = np.radians([0.0, 1.5, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0, 21.0, 27.0, 34.0, 42.0, 51.0, 60.0, 70.0, 80.0, 90.0])
AROUND = 16  # directions of a ring
WIDEST_OF_BASE_RAD = np.radians(9.5)  # of the first joint on a base that moves: a placement is off by a few degrees


def base_shifts(chain: Chain) -> Array:
    """Return the translations [S][3] across the axis that a free base may have."""
    steps = [np.linspace(-r, r, 2 * min(int(np.ceil(r / SHIFT_STEP_M)), MOST_STEPS) + 1) for r in chain.upper[:2]]
    x, y = np.meshgrid(*steps)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def joint_bends(problem: Problem, joint: int, x: Array) -> Array:
    """Return candidate angles (y, x) [D][2] of a joint (from 0) within its limits: about the designed ones.

    And the angles of the joint before, as an arc goes on.
    """
    chain, design = problem.chain, problem.designed
    rows = [BASE + 3 * joint + 1, BASE + 3 * joint + 2]
    low, high = chain.lower[rows], chain.upper[rows]
    if joint == 0:
        low, high = low + chain.lower[4:6], high + chain.upper[4:6]
    floating = bool(chain.upper[0] > 0)
    rings = RINGS_RAD[RINGS_RAD <= (WIDEST_OF_BASE_RAD if joint == 0 and floating else np.pi / 2)]
    around = np.arange(AROUND) * (2 * np.pi / AROUND)
    tilt, azimuth = (g.ravel() for g in np.meshgrid(rings, around))
    # Direction (sin t cos a, sin t sin a, cos t) as Ry(y) Rx(x) applied to Z.
    candidates = np.column_stack(
        [np.arctan2(np.sin(tilt) * np.cos(azimuth), np.cos(tilt)), -np.arcsin(np.sin(tilt) * np.sin(azimuth))]
    )
    if joint:
        last = [rows[0] - 3, rows[1] - 3]
        candidates = np.concatenate([candidates, (x - design)[None, last]])
    candidates = candidates + design[rows]
    inside = ((candidates >= low - 1e-12) & (candidates <= high + 1e-12)).all(axis=1)
    return np.asarray(np.unique(candidates[inside].round(9), axis=0))


def bend_rotations(bends: Array, twist: float = 0.0) -> Array:
    """Return Rz(twist) Ry(y) Rx(x) [D][3][3] of angles (y, x) [D][2]."""
    cy, sy, cx, sx = np.cos(bends[:, 0]), np.sin(bends[:, 0]), np.cos(bends[:, 1]), np.sin(bends[:, 1])
    zero = np.zeros(len(bends))
    turns = np.stack([cy, sy * sx, sy * cx, zero, cx, -sx, -sy, cy * sx, cy * cx], axis=1).reshape(-1, 3, 3)
    cz, sz = np.cos(twist), np.sin(twist)
    return np.asarray(np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]]) @ turns)
