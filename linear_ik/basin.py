"""Basin: where a fit may start, so that every segment lies on its own face and not on the next best one.

A plain descent is enough for most complete scans; its outcome is believed only where it
can be nothing else. What stays in doubt is searched.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.descent import Descended, Log, descend
from linear_ik.doubts import seen_around, stepped_aside
from linear_ik.ik_step import Solver
from linear_ik.problem import Problem, thinned
from linear_ik.repair import plate_shifts
from linear_ik.scan import Scan
from linear_ik.seen_through import refuter
from linear_ik.settings import FitSettings
from linear_ik.settlement import ROBUST_SCALE
from linear_ik.side_noise import MAD_TO_SD
from linear_ik.stage import Stage
from linear_ik.startup import Startup
from linear_ik.uncertainty import noise_of, point_noise

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

PLAIN_ITERATIONS = 12
PLAIN_NOISE_M = 0.0025  # beyond, another section may scatter the points
NEAR, NEARLY_ALL = 4.5, 0.95  # deviations within which, and the share of points for which, a segment is explained
LEAST_POINTS = 12  # of a segment
THICK = 30.0  # deviations; a segment between two sides so far apart has two points in three on neither
SEARCH_POINTS_A_SEGMENT = 300
GENTLE_RAD = np.radians(3.0)  # bends of a joint that are searched where sharper ones led astray


def plain(problem: Problem, points: Array, settings: FitSettings, solver: Solver, log: Log) -> tuple[Descended, bool]:
    """Descend from the design; where a segment is then in doubt, turn it and what follows to its points, and go on.

    Turns go on as long as each brings the doubts farther along.

    Returns:
        Where it ended, and whether that can only be right.
    """

    def down(x: Array) -> tuple[Descended, Mask]:
        stage = Stage("coarse", points, (np.inf,), settings.range_noise_m or 1e-3, PLAIN_ITERATIONS, 1e-3)
        found = descend(problem, x, stage, settings, solver, log)
        known = explained(problem, found)
        if known.all():
            return found, known
        # Without weights, what goes wrong anywhere pulls everywhere.
        noise_m = settings.range_noise_m or noise_of(found.pairs)
        stage = Stage("coarse", points, (ROBUST_SCALE * noise_m,), noise_m, 3, 1e-4)
        found = descend(problem, found.x, stage, settings, solver, log)
        return found, explained(problem, found)

    found, known = down(problem.designed)
    # With the first segment in doubt nothing says where to turn.
    while settings.search == "auto" and known[0] and not known.all():
        startup = Startup(problem, points, noise_of(found.pairs), settings, solver, log)
        # What is wrong at a segment pulls at the joint before as well.
        other, then = down(startup.turned(found.x, max(int(known.argmin()) - 1, 1)))
        if not then.all() and then.argmin() <= known.argmin():
            break
        found, known = other, then
    if not known.all() or seen_around(problem.surface, found.pairs):
        return found, bool(known.all())
    # From a base that is held, no segment gets to the wrong side of something thick without one
    # between that is off both; a base that floats may have started there.
    noise_m = noise_of(found.pairs)
    startup = Startup(problem, points, noise_m, settings, solver, log)
    apart_m = np.linalg.norm(plate_shifts(problem.surface), axis=1).min(initial=np.inf)
    told_apart = not startup.floating and apart_m > THICK * noise_m
    return found, bool(told_apart) and startup.repaired(found.x) is found.x


def explained(problem: Problem, found: Descended) -> Mask:
    """Return the segments [N] on whose surface nearly every point around them lies, in a plain fit."""
    n = problem.element.segments
    pairs = found.pairs
    count = np.diff(pairs.starts)
    # The noise of the better segments: what went wrong elsewhere is none.
    parts = np.split(np.abs(pairs.residual_m), pairs.starts[1:-1])
    noise_m = MAD_TO_SD * float(np.quantile([np.median(p) for p in parts if len(p) >= LEAST_POINTS] or [np.inf], 0.25))
    if noise_m > PLAIN_NOISE_M:
        return np.zeros(n, dtype=bool)
    near = np.bincount(pairs.segment[pairs.distance_m < NEAR * noise_m], minlength=n)
    return np.asarray((count >= LEAST_POINTS) & (near >= NEARLY_ALL * count))


def forced(problem: Problem, x: Array) -> bool:
    """Whether a chain [6 + 3N] is where only a neighbour would take it: stepped aside, or at its limits."""
    chain = problem.chain
    return bool(chain.at_limits(x).any()) or stepped_aside(chain.pose(x)) is not None


def searched(
    problem: Problem,
    scan: Scan,
    found: Descended,
    settings: FitSettings,
    solver: Solver,
    log: Log,
    rng: np.random.Generator,
) -> Descended:
    """Search from the base outwards, and keep the better of its outcome and the plain one.

    Of hypotheses that explain points those give way that stand where the scanner saw through.
    """
    area = problem.surface.perimeter_m * problem.element.segment_length_m
    cloud = thinned(problem.points, float(np.sqrt(area / SEARCH_POINTS_A_SEGMENT)), settings.seed)
    noise_m = settings.range_noise_m or point_noise(cloud, problem.points, rng)
    refuted = refuter(problem, scan, noise_m, settings.seed)
    startup = Startup(problem, cloud, noise_m, settings, solver, log, refuted)
    best = startup.better([startup.run(), startup.finish(found.x)])
    if forced(problem, best):
        gentle = problem.bending(GENTLE_RAD)
        other = Startup(gentle, cloud, noise_m, settings, solver, log, refuted).run()
        # A neighbour may show more points; that does not make it the element. Nor is a member that rests on its limits
        # another one, that does not reach as far.
        if not forced(gentle, other) and startup.supported(other) >= startup.supported(best):
            best = other
    cloud = startup.around(best)
    return descend(problem, best, Stage("search", cloud, (startup.tau_m,), noise_m, 6, 5e-5), settings, solver, log)
