"""Foreign segments: those that were fitted to something else than the member, a flange, a bracket, a notch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE
from linear_ik.descent import Descended
from linear_ik.problem import Problem
from linear_ik.side_noise import MAD_TO_SD
from linear_ik.uncertainty import point_noise

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

FOREIGN_RATIO, FOREIGN_RATIO_KINKED = 2.0, 1.5  # of the scatter of the other segments
KINK_RATIO, LEAST_KINK_RAD = 5.0, np.radians(0.05)
# A scan of a tenth of a millimetre has segments that scatter twice as much and are the member.
FOREIGN_EXCESS_M = 0.0004
LEAST_POINTS, LEAST_JUDGED = 20, 3  # of a segment, and segments, to tell what is usual
ROUGHNESS_RATIO = 1.5  # scatter about the surface over scatter among neighbours: as much is noise


def at_limits(problem: Problem, x: Array) -> Mask:
    """Return the segments [N] with a joint at its limit at either end: that keeps them from their points."""
    at_start = np.asarray(problem.chain.at_limits(x)[BASE:].reshape(-1, 3).any(axis=1))
    return np.asarray(at_start | np.append(at_start[1:], False))


def foreign_segments(problem: Problem, found: Descended, ignored: Mask) -> Mask:
    """Return which segments [N] lie on points of something else.

    Their points scatter twice as much as the other segments' points and 0.4 mm more, or half as much
    again while the segment kinks far more than the rest of the element. A member that
    really kinks keeps its scatter, and so does one that would kink further than its
    joints may (`at_limits`). So does one whose points scatter as much among their neighbours as about
    the designed surface: that is noise, which a scanner has more of where it looks
    straight at a face than along it.
    """
    used = found.weights > 0
    segment = found.pairs.segment[used]
    residual = np.abs(found.pairs.residual_m[used])
    parts = np.split(residual, np.searchsorted(segment, np.arange(1, len(ignored))))
    judged = np.array([len(part) >= LEAST_POINTS for part in parts]) & ~ignored
    if judged.sum() < LEAST_JUDGED:
        return np.zeros(len(ignored), dtype=bool)
    noise_m = np.array([MAD_TO_SD * float(np.median(part)) if len(part) else 0.0 for part in parts])
    usual_m = float(np.median(noise_m[judged]))
    bends = np.linalg.norm((found.x[BASE:] - problem.prior_mean[BASE:]).reshape(-1, 3)[:, 1:], axis=1)
    if problem.chain.upper[3] > 0:
        bends[0] = 0.0  # the first joint shares the base's rotation
    worst = bends.copy()
    worst[:-1] = np.maximum(worst[:-1], bends[1:])
    rest = np.array(
        [np.sqrt(np.mean(np.delete(bends, [k, min(k + 1, len(bends) - 1)]) ** 2)) for k in range(len(bends))]
    )
    kinked = worst > KINK_RATIO * np.maximum(rest, LEAST_KINK_RAD)
    ratio = np.where(kinked, FOREIGN_RATIO_KINKED, FOREIGN_RATIO)
    suspect = (
        judged & ~at_limits(problem, found.x) & (noise_m > ratio * usual_m) & (noise_m > usual_m + FOREIGN_EXCESS_M)
    )
    R, nodes, rng = found.pose.rotations, found.pose.nodes_m, np.random.default_rng(0)
    middle = (nodes[1:] + nodes[:-1]) / 2
    reach_m = problem.surface.reach_m + problem.element.segment_length_m / 2
    for k in np.flatnonzero(suspect):
        # Of all its points: a sample's neighbours are too far apart to lie on one face.
        near = problem.points[np.linalg.norm(problem.points - middle[k], axis=1) < reach_m]
        roughness_m = point_noise(found.pairs.local[used][segment == k] @ R[k].T + nodes[k], near, rng)
        suspect[k] = noise_m[k] > ROUGHNESS_RATIO * roughness_m
    return np.asarray(suspect)
