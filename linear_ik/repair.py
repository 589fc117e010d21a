"""Repair: nodes that settled on the wrong side of a plate are moved across it.

An open section shows both sides of thin plates; where points were taken for the other
side of one they fit well, a plate's thickness off. Moving runs of nodes by the distances
between parallel faces shows whether the points around them are better explained.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain, Pose
from linear_ik.distance_field import NEAR_M, DistanceField
from linear_ik.problem import Problem
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

LEAST_GAIN = 4.0  # points explained
LEAST_SHIFT_M = 0.002
SMALL_SHIFT_M = 0.05
MOST_REPAIRS = 8
STICKS_OUT_M, STICKS_OUT = 0.005, 3.0  # and times as far as half of the nodes
MOST_STRAIGHTENED = 6


def repair(
    problem: Problem,
    x: Array,
    points: Array,
    fields: Callable[[int], DistanceField],
    tau_m: float,
    finish: Callable[[Array], Array],
    score: Callable[[Array], float],
) -> Array:
    """Return the variables [6 + 3N], or better ones.

    Args:
        problem: what is fitted.
        x: [6 + 3N] a finished hypothesis.
        points: [P][3] the cloud, element's frame.
        fields: distance to the outline of a segment's section.
        tau_m: distance at which a point is no longer explained.
        finish: refines a hypothesis.
        score: points explained by a hypothesis, less what its bends cost.
    """
    shifts = plate_shifts(problem.surface)
    best = score(x)
    refused: set[tuple[int, int, int]] = set()
    for _ in range(MOST_REPAIRS):
        pose = problem.chain.pose(x)
        run = promising(problem, shift_gains(problem, pose, points, fields, shifts, tau_m), refused)
        if run is None:
            break
        first, last, which = run
        moved = finish(shifted(problem.chain, x, pose, first, last, shifts[which]))
        if (value := score(moved)) > best:
            x, best = moved, value
            refused.clear()
        else:
            refused.add(run)
    for _ in range(MOST_STRAIGHTENED):
        pose = problem.chain.pose(x)
        for nodes in straighter(pose):
            moved = finish(drawn_back(problem.chain, through(problem.chain, x, nodes), pose, nodes))
            if (value := score(moved)) > best:
                x, best = moved, value
                break
        else:
            break
    return x


def straighter(pose: Pose) -> list[Array]:
    """Return the nodes [N+1][3] with one or two put back between their neighbours, for those that stick out most.

    Where few points tell, a joint may have followed something else, and the next one come
    back. In an arc no node sticks out more than the others.
    """
    nodes, n, found = pose.nodes_m, pose.n_segments, []
    for i in range(1, n + 1):
        for j in range(max(i, 2), min(i + 1, n) + 1):
            share = np.arange(1, j - i + 2)[:, None]
            if j < n:
                between = nodes[i - 1] + share / (j - i + 2) * (nodes[j + 1] - nodes[i - 1])
            elif i > 1:
                between = nodes[i - 1] + share * (nodes[i - 1] - nodes[i - 2])
            else:
                continue
            put_back = nodes.copy()
            put_back[i : j + 1] = between
            found.append((float(np.abs(put_back - nodes).max()), put_back))
    if not found:
        return []
    least = max(STICKS_OUT_M, STICKS_OUT * float(np.median([out for out, _ in found])))
    found.sort(key=lambda one: -one[0])
    return [put_back for out, put_back in found[:MOST_STRAIGHTENED] if out > least]


def drawn_back(chain: Chain, x: Array, pose: Pose, nodes: Array) -> Array:
    """Return the variables with the base moved, where it may, so that the nodes past those put back stay in place.

    A straighter chain is a longer one: from a base that stays, all that follows would be pushed along.

    Args:
        chain: of the element.
        x: [6 + 3N] with the nodes put back.
        pose: before that.
        nodes: [N+1][3] wanted: those of ``pose`` but for the nodes put back.
    """
    changed = np.flatnonzero((nodes != pose.nodes_m).any(axis=1))
    rest = slice(changed[-1] + 1, None)
    if changed[-1] == pose.n_segments or not (chain.upper[:3] > 0).any():
        return x
    back_m = (pose.nodes_m[rest] - chain.pose(x).nodes_m[rest]).mean(axis=0)
    x = x.copy()
    x[:3] += back_m
    return chain.clip(x)


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
    problem: Problem, pose: Pose, points: Array, fields: Callable[[int], DistanceField], shifts: Array, tau_m: float
) -> Array:
    """Return how many more points each segment would explain after each shift [3][N][D].

    First of its end alone, then of the whole segment, then of its start alone.
    """
    n = pose.n_segments
    gains = np.zeros((3, n, len(shifts)))
    reach = problem.surface.reach_m + NEAR_M
    for k in range(n):
        local = points - pose.nodes_m[k]
        length = float(problem.chain.segment_length_m[k])
        local = local[np.einsum("ij,ij->i", local, local) < (length + reach) ** 2] @ pose.rotations[k]
        local = local[(local[:, 2] > 0) & (local[:, 2] < length)]
        along = local[:, 2] / length
        field = fields(k)
        now = field.explained(local[:, :2], tau_m)
        for kind, share in enumerate((along, np.ones(len(along)), 1.0 - along)):
            for d, shift in enumerate(shifts):
                gains[kind, k, d] = field.explained(local[:, :2] - share[:, None] * shift, tau_m) - now
    return gains


def promising(problem: Problem, gains: Array, refused: set[tuple[int, int, int]]) -> tuple[int, int, int] | None:
    """Return the run of nodes that gains most from one shift, (first, last, shift), or None.

    Moving nodes i to j moves the segments between them whole, segment i - 1 at its end
    and segment j at its start.
    """
    n = gains.shape[1]
    whole = np.concatenate([np.zeros((1, gains.shape[2])), np.cumsum(gains[1], axis=0)])
    start = 0 if problem.chain.upper[0] > 0 else 1
    best, most = None, LEAST_GAIN
    for i in range(start, n + 1):
        for j in range(i, n + 1):
            gain = whole[j] - whole[i]
            gain = gain + gains[0, i - 1] if i else gain
            gain = gain + gains[2, j] if j < n else gain
            for d in np.flatnonzero(gain > most):
                if (i, j, int(d)) not in refused and gain[d] > most:
                    best, most = (i, j, int(d)), float(gain[d])
    return best


def shifted(chain: Chain, x: Array, pose: Pose, first: int, last: int, shift: Array) -> Array:
    """Return the variables with nodes ``first`` to ``last`` moved by a shift [2] of the section's plane."""
    nodes = pose.nodes_m.copy()
    offset = pose.rotations[min(first, pose.n_segments - 1)][:, :2] @ shift
    nodes[first : last + 1] += offset
    out = x.copy()
    if first == 0:
        out[:3] = np.clip(x[:3] + offset, chain.lower[:3], chain.upper[:3])
        nodes[0] = pose.nodes_m[0] + out[:3] - x[:3]
    return through(chain, out, nodes)


def through(chain: Chain, x: Array, nodes: Array) -> Array:
    """Return the variables with every segment turned towards its next node of ``nodes`` [N+1][3]; the base stays."""
    out = x.copy()
    pose = chain.pose(x)
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
