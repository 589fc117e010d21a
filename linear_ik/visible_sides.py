"""Visible sides: which way the thin plates of a section were seen from, told by how the points scatter about them.

The nearest side is the wrong one for points that noise takes past the middle of a plate. Where only one side was
seen these look like points of the other: the plate settles half its thickness off, and the scatter looks smaller than
it is. Stations would tell (`sights`). Without them the scatter does: one side gives one bell, both give two, a
plate's thickness apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.correspondence import Correspondences
from linear_ik.descent import Descended
from linear_ik.problem import Problem
from linear_ik.surface import Surface
from linear_ik.tapered_surface import TaperedSurface
from linear_ik.uncertainty import noise_of

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]

THIN = 8.0  # deviations, as they look before the sides are told apart: half of what they are
REACH = 6.0  # deviations beyond either side
OPPOSITE = -0.999  # cosine of two normals
LEAST_LIKELIER, SURE = 3.0, 20.0  # log likelihood; from where on the choice is no doubt
TWICE = 2.0  # as wide as thick, at least: less is an edge
END, MOST_END = 3.0, 0.15  # deviations, and share of a plate's width, that its ends are left out by
LEAST_POINTS = 100  # on the plates: fewer do not tell one bell from two
FARTHEST = 3.0  # deviations: other points count no further off
NEXT_TO_NONE = np.finfo(float).tiny  # of likelihood: a point far from all sides is shared as the points near them are
ROUNDS = 40  # of expectation maximisation: proportions settle within a hundredth
CORNER, LEAST_INSIDE = 2.5, 3.0  # deviations that noise takes points around a corner; of a face, so many times that
EXPECTED = 8.0  # points of each segment that are on its faces as all of the member's are
SPARSEST = 1e-3  # of the densest face: a point 3.7 deviations nearer to another is still that one's


class Plate(NamedTuple):
    """Two faces of a section with its material between them.

    Attributes:
        front: edge of the outline.
        back: edge on the other side.
        thickness_m: between them.
        between_m: where the two overlap, along the front.
    """

    front: int
    back: int
    thickness_m: float
    between_m: tuple[float, float]


def thin_plates(surface: Surface, most_m: float) -> list[Plate]:
    """Return the plates of a section up to ``most_m`` thick, and twice as wide; each once."""
    out = []
    for e in range(len(surface.corners)):
        for f in np.flatnonzero(surface.normals @ surface.normals[e] < OPPOSITE):
            thickness_m = float((surface.corners[e] - surface.corners[f]) @ surface.normals[e])
            ends = (surface.corners[[f, (f + 1) % len(surface.corners)]] - surface.corners[e]) @ surface.tangents[e]
            low, high = max(0.0, float(ends.min())), min(float(surface.widths_m[e]), float(ends.max()))
            if e < f and 0.0 < thickness_m <= most_m and high - low > TWICE * thickness_m:
                out.append(Plate(e, int(f), thickness_m, (low, high)))
    return out


def has_thin_plates(surface: Surface, noise_m: float) -> bool:
    """Whether noise may take points of one side of a plate for those of the other; never of a round section."""
    return surface.radius_m is None and bool(thin_plates(surface, THIN * noise_m))


def may_be_told(problem: Problem) -> bool:
    """Whether a section has faces to be told apart."""
    return problem.surface.radius_m is None and not isinstance(problem.surface, TaperedSurface)


def told_apart(
    problem: Problem,
    found: Descended,
    noise_m: float,
    down: Callable[[Problem, Array], Descended],
) -> tuple[Problem, Descended, Mask]:
    """Return the problem that knows which faces were seen, its fit, and the faces [E] that were surely not.

    Args:
        problem: whose points were matched to the nearest face.
        found: its fit.
        noise_m: standard deviation of a point, as it looks.
        down: descends from variables [6 + 3N] in a problem.
    """
    hidden, surely = (np.zeros(len(problem.surface.corners), dtype=bool) for _ in range(2))
    if problem.matcher.sights is None:
        for plates in across(problem.surface, thin_plates(problem.surface, THIN * noise_m)):
            problem, found, unseen, margin = seen_from(problem, found, plates, hidden, noise_m, down)
            if margin > SURE:
                surely |= unseen & ~hidden
            hidden = unseen
    noise_m = max(noise_m, noise_of(found.pairs, found.weights))
    problem = problem.favouring(handicaps(problem.surface, found, hidden, noise_m))
    return problem, down(problem, found.x), surely


def across(surface: Surface, plates: list[Plate]) -> Iterator[list[Plate]]:
    """Yield the plates of each direction together: a station sees all of them from one side."""
    while plates:
        normals = surface.normals[[p.front for p in plates]]
        one = np.abs(normals @ normals[0]) > -OPPOSITE
        yield [p for p, with_it in zip(plates, one, strict=True) if with_it]
        plates = [p for p, with_it in zip(plates, one, strict=True) if not with_it]


def seen_from(
    problem: Problem,
    found: Descended,
    plates: list[Plate],
    hidden: Mask,
    noise_m: float,
    down: Callable[[Problem, Array], Descended],
) -> tuple[Problem, Descended, Mask, float]:
    """Return the problem, its fit and the hidden faces [E]: of some plates one side too, where only the other was seen.

    And by how much, in log likelihood, the choice is the best.

    Three hypotheses compete, both sides or one alone. Each is fitted; the likelihood of the points on the plates is
    that of one normal distribution about the side that is seen, or of two, in proportions and with a deviation of
    their own; other points and the joints add their squares.

    Args:
        problem: both sides seen.
        found: its fit.
        plates: across one direction.
        hidden: [E] faces that are known not to be seen.
        noise_m: standard deviation of a point, as it looks.
        down: descends from variables [6 + 3N] in a problem.
    """
    surface, sample = problem.surface, len(found.pairs.order)
    rows = [_on_plate(found.pairs, surface, p, noise_m) for p in plates]
    if sum(map(len, rows)) < LEAST_POINTS:
        return problem, found, hidden, 0.0
    beside, beyond = np.ones(sample, dtype=bool), np.ones(sample, dtype=bool)
    beside[np.concatenate(rows)] = False
    for p in plates:
        beyond[_on_plate(found.pairs, surface, p, noise_m, wholly=False)] = False
    both = _unlikelihood(_outside(problem, found, plates, rows, None))[1] + _others(problem, found, beyond, noise_m)
    trials = []
    for sign in (1.0, -1.0):
        facing = [sign * (surface.normals[p.front] @ surface.normals[plates[0].front]) > 0 for p in plates]
        away = [p.front if there else p.back for p, there in zip(plates, facing, strict=True)]
        unseen = hidden.copy()
        unseen[away] = True
        there = problem.favouring(np.where(unseen, np.inf, 0.0))
        at = down(there, found.x)
        trials.append((there, at, unseen, *_unlikelihood(_outside(there, at, plates, rows, away))))
    # Where the plates end tells the one side from the other, but is nothing to compare both with.
    scatter_m = min(trial[3] for trial in trials)
    mirrored = [unlikely + _others(there, at, beside, scatter_m) for there, at, _, _, unlikely in trials]
    there, at, unseen, _, unlikely = trials[int(np.argmin(mirrored))]
    margin = min(both - unlikely - _others(there, at, beyond, noise_m), max(mirrored) - min(mirrored))
    return (there, at, unseen, margin) if margin > LEAST_LIKELIER else (problem, found, hidden, 0.0)


def handicaps(surface: Surface, found: Descended, hidden: Mask, noise_m: float) -> Array:
    """Return the handicap [N][E] of each segment's faces, m^2: ``-2 s^2 ln rho_f``, inf for faces that nobody saw.

    rho_f is the points on a face for each metre of its width, over those of the densest; a thousandth at least. A
    segment's are expected as those of all segments together, which count as a few points of its own: what a station
    sees of a member may change along it.

    By expectation maximisation: a point is on a face with a probability that falls with its distance from it, as the
    normal distribution does, and rises with the density of points there. A point near a corner so belongs to the face
    that was seen, and a face that explains no point which another does not ends as the sparsest.

    Args:
        surface: of the section.
        found: its fit.
        hidden: [E] faces that nobody saw.
        noise_m: s, standard deviation of a point.
    """
    rows = found.weights > 0
    local, segment, n = found.pairs.local[rows, :2], found.pairs.segment[rows], len(found.pairs.starts) - 1
    if not len(local):
        return np.tile(np.where(hidden, np.inf, 0.0), (n, 1))
    likely = np.exp(-0.5 * np.stack(list(surface.squares(local)), axis=1) / noise_m**2)
    likely += NEXT_TO_NONE
    inside, counted_m = _away_from_corners(surface, local, noise_m)
    everywhere = _densities(likely, inside, counted_m, np.where(hidden, 0.0, 1.0 / surface.widths_m))
    starts = np.searchsorted(segment, np.arange(n + 1))
    each = [_densities(likely[a:b], inside[a:b], counted_m, everywhere, EXPECTED) for a, b in pairwise(starts)]
    density = np.stack(each)
    relative = np.maximum(density / density.max(axis=1, keepdims=True), SPARSEST)
    return np.where(hidden, np.inf, -2.0 * noise_m**2 * np.log(relative))


def _away_from_corners(surface: Surface, local: Array, noise_m: float) -> tuple[Mask, Array]:
    """Return which points [P][E] are beside which faces away from the corners, and how wide [E] those parts are.

    A scanner's last column of points before an edge would be a face around the corner as well. Only that has no
    points farther from the corner.
    """
    margin_m = np.where(surface.widths_m > LEAST_INSIDE * CORNER * noise_m, CORNER * noise_m, 0.0)
    inside = np.empty((len(local), len(margin_m)), dtype=bool)
    for e, (corner, tangent) in enumerate(zip(surface.corners, surface.tangents, strict=True)):
        along = (local - corner) @ tangent
        inside[:, e] = (along >= margin_m[e]) & (along <= surface.widths_m[e] - margin_m[e])
    inside[:, margin_m == 0.0] = True
    return inside, surface.widths_m - 2.0 * margin_m


def _densities(likely: Array, inside: Mask, counted_m: Array, density: Array, expected: float = 0.0) -> Array:
    """Return the points [E] for each metre of the faces' widths.

    Args:
        likely: [P][E] likelihood of each point, were it on the face.
        inside: [P][E] whether it is where the face's points are counted.
        counted_m: [E] how wide that is.
        density: [E] to begin with.
        expected: so many points more are spread as that says.
    """
    before = density * counted_m
    before *= expected / before.sum()
    for _ in range(ROUNDS):
        belongs = likely * density
        belongs /= belongs.sum(axis=1, keepdims=True)
        density = ((belongs * inside).sum(axis=0) + before) / counted_m
    return density


def _on_plate(pairs: Correspondences, surface: Surface, plate: Plate, noise_m: float, wholly: bool = True) -> Index:
    """Return the rows of the points on a plate and near either side of it: away from its ends, or beyond them too."""
    offset = pairs.section - surface.corners[plate.front]
    along, outside = offset @ surface.tangents[plate.front], offset @ surface.normals[plate.front]
    (low, high), reach_m = plate.between_m, REACH * noise_m
    margin_m = min(END * noise_m, MOST_END * (high - low)) if wholly else -reach_m
    on = (along > low + margin_m) & (along < high - margin_m)
    on &= (outside < reach_m) & (outside > -plate.thickness_m - reach_m)
    return np.asarray(pairs.order[on])


def _outside(
    problem: Problem, at: Descended, plates: list[Plate], rows: list[Index], hidden: list[int] | None
) -> list[Array]:
    """Return how far outside the sides that may be seen [P][1 or 2] points of each plate are.

    Args:
        problem: for the section.
        at: a fit.
        plates: of the section.
        rows: of the sample, the points [P] on each plate.
        hidden: of each plate the side that is not seen; None where both are.
    """
    surface, order, out = problem.surface, at.pairs.order, []
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    for i, plate in enumerate(plates):
        outside = (at.pairs.section[place[rows[i]]] - surface.corners[plate.front]) @ surface.normals[plate.front]
        # Of the back by its own normal.
        sides = np.column_stack([outside, -plate.thickness_m - outside])
        out.append(sides if hidden is None else sides[:, [int(hidden[i] == plate.front)]])
    return out


def _others(problem: Problem, at: Descended, which: Mask, noise_m: float) -> float:
    """Return minus the log likelihood of other points [S] of the sample, robustly, and of the joints."""
    squares = np.minimum((at.pairs.distance_m[which[at.pairs.order]] / noise_m) ** 2, FARTHEST**2)
    off = ((at.x - problem.prior_mean) / problem.prior_sd)[problem.variables]
    return 0.5 * float(squares.sum()) + 0.5 * float(off @ off)


def _unlikelihood(each: list[Array]) -> tuple[float, float]:
    """Return the deviation of distances [P][1 or 2] from the sides of each plate, and minus their log likelihood.

    By expectation maximisation. One deviation for all, and of each plate its own proportion of points on either side.
    """
    pairs = [d for d in each if len(d)]
    variance = float(np.mean(np.concatenate([(d**2).min(axis=1) for d in pairs])))
    shares = [np.full(d.shape[1], 1.0 / d.shape[1]) for d in pairs]
    for _ in range(ROUNDS):
        squares, count, value = 0.0, 0, 0.0
        for i, d in enumerate(pairs):
            density = shares[i] * np.exp(-0.5 * d**2 / variance) + NEXT_TO_NONE
            sum_ = density.sum(axis=1)
            value -= float(np.log(sum_).sum()) - 0.5 * len(d) * np.log(2.0 * np.pi * variance)
            belongs = density / sum_[:, None]
            shares[i] = belongs.mean(axis=0)
            squares, count = squares + float((belongs * d**2).sum()), count + len(d)
        variance = squares / count
    return float(np.sqrt(variance)), value
