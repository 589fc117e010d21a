"""ICPIK: the paper's algorithm, term for term, in the loop that every fit runs in.

What differs from the default is here at a glance: where the pairs come from, how they
are weighed, which terms are on, and when it stops. Constants the paper does not give are
named below.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.cloud_pairs import CloudMatcher, CloudPairs, ModelCloud
from linear_ik.descent import Descended, Log, descend
from linear_ik.ik_step import Solver
from linear_ik.problem import Problem
from linear_ik.settings import FitSettings
from linear_ik.stage import Paired, Stage
from linear_ik.terms.point_to_point import point_to_point

Array = npt.NDArray[np.float64]

OPENING_THRESHOLD_M = 0.3  # paper 3.2
STOP_M = 0.001  # paper 3.2: largest distance between corresponding points
MOST_ITERATIONS = 100  # paper 3.2
THRESHOLD_DECAY = 0.97  # ours: "gradually decreases with iteration count"
LEAST_THRESHOLD_M = 0.02  # ours: below the spacing of two clouds nothing is left to match
QUARTER_WEIGHT_M = 0.02  # ours: distance at which the inverse-distance weight is a quarter
WEIGHT_EXPONENT = 2.0  # ours: "non-linear scaling"
SUPPORT_NOISE_M = 0.001  # ours: what a held end's tolerance is weighed against
MODEL_POINTS = 10_000  # ours: as many as the simulated scans have


def icpik(problem: Problem, settings: FitSettings, solver: Solver, log: Log) -> Descended:
    """Run ICPIK from the design (paper 3.1 to 3.3).

    Between two independently sampled clouds the largest nearest-neighbour distance is
    20 mm and more at perfect registration, so expect the cap on the iterations, not the
    1 mm stop.
    """
    cloud = ModelCloud(problem.surface, problem.chain.segment_length_m, MODEL_POINTS, settings.seed)
    matcher = CloudMatcher(cloud, problem.points)

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        threshold_m = max(OPENING_THRESHOLD_M * THRESHOLD_DECAY**i, LEAST_THRESHOLD_M)
        pairs = matcher.match(pose, threshold_m)
        return Paired(pairs, inverse_distance(pairs) * segment_weights(pairs), threshold_m)

    stage = Stage(
        "icpik",
        problem.points,
        noise_m=settings.range_noise_m or SUPPORT_NOISE_M,
        iterations=MOST_ITERATIONS,
        stop_m=0.0,
        pair=pair,
        term=point_to_point,
        close_m=STOP_M,
    )
    # Eq. 4 knows no prior.
    free = problem.expecting(np.full(problem.chain.nv, np.inf))
    return descend(free, problem.designed, stage, settings, solver, log)


def inverse_distance(pairs: CloudPairs) -> Array:
    """Return weights [P] that emphasise closer points, non-linearly: ``(h / (h + d))^2``, a quarter at h."""
    return np.asarray((QUARTER_WEIGHT_M / (QUARTER_WEIGHT_M + pairs.distance_m)) ** WEIGHT_EXPONENT)


def segment_weights(pairs: CloudPairs) -> Array:
    """Return weights [P] in proportion to the pairs of the point's segment, 1 for the richest."""
    share = pairs.counts / max(int(pairs.counts.max(initial=0)), 1)
    return np.repeat(share, pairs.counts)
