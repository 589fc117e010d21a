"""Hypotheses: which of several ways to lay a scan on a design is the best, and what else there is.

They are refined on few points, judged on many. Beside the best ones others are looked for, since
a search by coarse cells cannot tell the two sides of a slab apart, and a refinement from there
stays with the side that it met first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.quality import Cloud, Quality, quality, share_within
from linear_ik.alignment.refine import LEAST_SCALE_M, noise_m, refine
from linear_ik.alignment.slides import FLANGES, SLABS, Reach, slid
from linear_ik.alignment.target import Target

Array = npt.NDArray[np.float64]
OnStep = Callable[[float], None]

FEW_POINTS = 1_000  # what all hypotheses are refined with, down to a rough scale
SOME_POINTS = 3_000  # what the best of them are refined with
MOST_REFINED = 6
ROUGH_SCALE_M = 0.06
MIDDLE_SCALE_M = 0.02
MOST_SETTLED = 100_000  # points of the last refinement: their noise is then micrometres of the motion
MOST_SLID = 4
SLID_OF_BEST = 2
OTHER_TURN_RAD = np.radians(2.0)
ROUGHLY_OTHER_M = 0.1
THINNEST_M = 0.008  # plate whose two sides are told apart: members that deviate move the best place by less
NEARLY_THE_SAME = 0.95  # of the best score
OTHER_PLACE_M = 0.04


class Judged(NamedTuple):
    """A hypothesis, and how well the scan lies there.

    Attributes:
        quality: of the hypothesis.
        T: T_target_scan [4][4].
    """

    quality: Quality
    T: Array


def best_rough(
    target: Target, few: Array, candidates: list[Array], near_m: float, about_z: bool, on_step: OnStep
) -> list[tuple[float, Array]]:
    """Return the hypotheses, refined on few points to a rough scale, with the share that each explains; best first."""
    rough = []
    for i, T in enumerate(candidates):
        refined = refine(target, few, T, near_m, ROUGH_SCALE_M, about_z)
        rough.append((share_within(target, few, refined, ROUGH_SCALE_M), refined))
        on_step((i + 1) / len(candidates))
    return sorted(rough, key=lambda r: -r[0])


def best_judged(
    target: Target,
    cloud: Cloud,
    mixed: Array,
    rough: list[tuple[float, Array]],
    reach: Reach,
    about_z: bool,
    on_step: OnStep,
) -> list[Judged]:
    """Return the best hypotheses and those beside them, refined and judged, all different, the best first.

    Args:
        target: the design.
        cloud: what they are judged by.
        mixed: [P][3] points of the scan in random order.
        rough: hypotheses as `best_rough` gives them.
        reach: how far beside them to look.
        about_z: turn about z only.
        on_step: called with the share that is done.
    """
    few, some = mixed[:FEW_POINTS], mixed[:SOME_POINTS]
    starts = [T for i, (_, T) in enumerate(rough) if all(differs(T, U, ROUGHLY_OTHER_M) for _, U in rough[:i])]
    found: list[Judged] = []

    def judge(start: Array) -> None:
        T = refine(target, some, start, ROUGH_SCALE_M, MIDDLE_SCALE_M, about_z)
        if all(differs(T, one.T) for one in found):
            found.append(Judged(quality(target, cloud, T), T))

    for i, start in enumerate(starts[:MOST_REFINED]):
        judge(start)
        on_step(0.5 * (i + 1) / len(starts[:MOST_REFINED]))
    slid_from: list[Array] = []
    while len(slid_from) < MOST_SLID:
        found.sort(key=lambda one: -one.quality.score)
        left = [one.T for one in found[:SLID_OF_BEST] if not any(one.T is T for T in slid_from)]
        if not left:
            break
        slid_from.append(left[0])
        for beside in (reach, SLABS):
            for T in slid(target, few, left[0], beside):
                judge(T)
        on_step(0.5 + 0.5 * len(slid_from) / MOST_SLID)
    return sorted(found, key=lambda one: -one.quality.score)


def settled(target: Target, cloud: Cloud, mixed: Array, T_target_scan: Array) -> tuple[Array, list[Judged]]:  # noqa: N803
    """Return a good hypothesis made exact, and others a plate's thickness beside it, the best first.

    The two sides of a flange are nearer to each other than what a point within 20 mm tells apart, so these are
    judged by the noise of the scan. Another one has to be clearly better. The first that is returned is the one that
    was made exact, as it is judged so.

    Args:
        target: the design.
        cloud: what they are judged by.
        mixed: [P][3] points of the scan in random order.
        T_target_scan: [4][4].
    """
    T = refine(target, cloud.points, T_target_scan, MIDDLE_SCALE_M, MIDDLE_SCALE_M / 2, False)
    scale_m = max(2.0 * noise_m(target, cloud.points, T), LEAST_SCALE_M)
    some = mixed[:SOME_POINTS]
    T = refine(target, some, T, scale_m, scale_m, False)
    found = [Judged(quality(target, cloud, T, scale_m), T)]
    for start in slid(target, mixed[:FEW_POINTS], T, FLANGES):
        beside = refine(target, some, start, scale_m, scale_m, False)
        if all(differs(beside, one.T, max(scale_m, THINNEST_M)) for one in found):
            found.append(Judged(quality(target, cloud, beside, scale_m), beside))
    first = found[0]
    found.sort(key=lambda one: -one.quality.score)
    if first.quality.score >= NEARLY_THE_SAME * found[0].quality.score:
        found = [first, *(one for one in found if one is not first)]
    exact = refine(target, mixed[:MOST_SETTLED], found[0].T, scale_m, scale_m, False)
    return exact, found


def differs(a: Array, b: Array, other_place_m: float = OTHER_PLACE_M) -> bool:
    """Say whether two motions [4][4] are two hypotheses."""
    turn = float(np.arccos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    return turn > OTHER_TURN_RAD or float(np.linalg.norm(a[:3, 3] - b[:3, 3])) > other_place_m
