"""Repair: segments that settled on the wrong side of a plate are moved across it.

An open section shows both sides of thin plates; a segment whose points were taken for
the other side of one fits them well, a plate's thickness off. Moving it there and back
by the distances between parallel faces shows whether its points are better explained.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain, Pose
from linear_ik.distance_field import DistanceField
from linear_ik.problem import Problem
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

LEAST_GAIN = 0.04  # of a segment's points
LEAST_SHIFT_M = 0.002
SMALL_SHIFT_M = 0.05
MOST_REPAIRS = 8


def repair(
    problem: Problem,
    x: Array,
    points: Array,
    field: DistanceField,
    tau_m: float,
    finish: Callable[[Array], Array],
    score: Callable[[Array], float],
) -> Array:
    """Return the variables [6 + 3N], or better ones.

    Args:
        problem: what is fitted.
        x: [6 + 3N] a finished hypothesis.
        points: [P][3] the cloud, element's frame.
        field: distance to the section's outline.
        tau_m: distance at which a point is no longer explained.
        finish: refines a hypothesis.
        score: points explained by a hypothesis, less what its bends cost.
    """
    shifts = plate_shifts(problem.surface)
    best = score(x)
    tried: set[tuple[int, int, int]] = set()
    for _ in range(MOST_REPAIRS):
        pose = problem.chain.pose(x)
        gains = shift_gains(problem, pose, points, field, shifts, tau_m)
        run = next((r for r in runs(gains) if r not in tried), None)
        if run is None:
            break
        tried.add(run)
        first, last, which = run
        moved = finish(shifted(problem.chain, x, pose, first, last, shifts[which]))
        if (value := score(moved)) > best:
            x, best = moved, value
            tried.clear()
    return x


def plate_shifts(surface: Surface) -> Array:
    """Return the moves [D][2] across the section that put one face on a parallel other."""
    if surface.radius_m is not None:
        return np.zeros((0, 2))
    wide = surface.widths_m > 0.2 * surface.widths_m.max()
    wide |= surface.widths_m > 0.02
    normals, corners = surface.normals[wide], surface.corners[wide]
    parallel = np.abs(normals @ normals.T) > 0.99
    apart = np.einsum("ek,efk->ef", normals, corners[:, None] - corners[None])
    e, f = np.nonzero(parallel & (np.abs(apart) > LEAST_SHIFT_M))
    single = np.unique((apart[e, f][:, None] * normals[e]).round(4), axis=0)
    single = np.unique(np.concatenate([single, -single]).round(4) + 0.0, axis=0)
    small = single[np.linalg.norm(single, axis=1) < SMALL_SHIFT_M]
    pairs = (small[:, None] + small[None]).reshape(-1, 2)
    across = np.abs(np.repeat(small, len(small), axis=0) @ [1, 0]) * np.abs(np.tile(small, (len(small), 1)) @ [0, 1])
    return np.unique(np.concatenate([single, pairs[across > 0]]).round(4), axis=0)


def shift_gains(
    problem: Problem, pose: Pose, points: Array, field: DistanceField, shifts: Array, tau_m: float
) -> Array:
    """Return how many more points, as a share, each segment would explain after each shift [N][D]."""
    n = pose.n_segments
    gains = np.zeros((n, len(shifts)))
    reach = problem.surface.reach_m + 0.06
    for k in range(n):
        local = points - pose.nodes_m[k]
        length = float(problem.chain.segment_length_m[k])
        local = local[np.einsum("ij,ij->i", local, local) < (length + reach) ** 2] @ pose.rotations[k]
        local = local[(local[:, 2] > 0) & (local[:, 2] < length)]
        now = field.explained(local[:, :2], tau_m)
        if now < 12:
            continue
        for d, shift in enumerate(shifts):
            gains[k, d] = (field.explained(local[:, :2] - shift, tau_m) - now) / now
    return gains


def runs(gains: Array) -> list[tuple[int, int, int]]:
    """Return runs of segments that gain from the same shift, (first, last, shift), best first."""
    found: list[tuple[float, tuple[int, int, int]]] = []
    for d in range(gains.shape[1]):
        good = np.concatenate([[False], gains[:, d] > LEAST_GAIN, [False]])
        edges = np.flatnonzero(np.diff(good.astype(int)))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            found.append((float(gains[first:end, d].sum()), (int(first), int(end) - 1, d)))
    return [run for _, run in sorted(found, reverse=True)]


def shifted(chain: Chain, x: Array, pose: Pose, first: int, last: int, shift: Array) -> Array:
    """Return the variables with the nodes of segments ``first`` to ``last`` moved by a shift [2] of their section."""
    nodes = pose.nodes_m.copy()
    offset = pose.rotations[first][:, :2] @ shift
    nodes[first : last + 2] += offset
    out = x.copy()
    if first == 0:
        out[:3] = np.clip(x[:3] + offset, chain.lower[:3], chain.upper[:3])
        nodes[0] = pose.nodes_m[0] + out[:3] - x[:3]
    R = pose.rotations[0] @ _local_rotation(x[BASE : BASE + 3]).T
    for k in range(pose.n_segments):
        row = BASE + 3 * k
        Rz = R @ _local_rotation(np.array([x[row], 0.0, 0.0]))
        direction = Rz.T @ (nodes[k + 1] - nodes[k])
        direction /= np.linalg.norm(direction)
        out[row + 1 : row + 3] = np.arctan2(direction[0], direction[2]), -np.arcsin(np.clip(direction[1], -1.0, 1.0))
        R = R @ _local_rotation(out[row : row + 3])
    return chain.clip(out)


def _local_rotation(zyx: Array) -> Array:
    """Return Rz Ry Rx [3][3] of angles (z, y, x)."""
    (cz, cy, cx), (sz, sy, sx) = np.cos(zyx), np.sin(zyx)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )
