"""Cloud end: where along a member the points on its surface stop.

Every side of a member that is cut square stops at the same place, and nothing goes on
beyond. A shadow's edge, or a neighbour that is built against it, does not do that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

WINDOW_M, MOST_POINTS = 0.15, 800  # inside the end: far enough to know the density, near enough for it to be even
LEAST_POINTS, LEAST_OF_PATCH = 30, 25
BLURS = (0.03, 0.5, 1.0, 2.0)  # of the noise: along the axis it may be any part of that across
STRAYS = (1e-4, 0.01, 0.1)  # shares of the points
GRID, ROUNDS = 25, 3
CONTINUED = 0.2  # density beyond the end, of that before it
AGREEMENT_M = 0.012
ROWS = 3.0  # a gap so many times as wide as the widest of random points is one between rows
LEAST_SD_M = 0.0002
PATCHES = 8


@dataclass(frozen=True)
class CloudEnd:
    """Where points stop.

    Attributes:
        at_m: along the axis, in the direction that leads out of the member.
        sd_m: its standard deviation.
    """

    at_m: float
    sd_m: float


def cloud_end(u: Array, patch: Index, noise_m: float, low_m: float, high_m: float) -> CloudEnd | str:
    """Return where points on a member's surface stop, or in words why that is not known.

    Args:
        u: [P] places of the points along the axis, outwards.
        patch: [P] which part of the outline (0 to 7) each lies on.
        noise_m: standard deviation of a point.
        low_m: the end is looked for from here on.
        high_m: up to here; what goes on beyond is looked at too.
    """
    margin_m = max(0.02, 10.0 * noise_m)
    rows = np.flatnonzero((u > low_m - WINDOW_M) & (u < high_m + margin_m))
    if len(rows) < LEAST_POINTS:
        return "hardly any points lie there"
    rough_m = _rough_end(u[rows], noise_m)
    # The same on all sides, so that the sides can be told apart.
    near = rows[(u[rows] > rough_m - WINDOW_M) & (u[rows] < rough_m + margin_m)]
    whole = _edge(u[near], noise_m)
    if whole is None:
        return "hardly any points lie there"
    if rough_m > high_m + 0.5 * margin_m:
        return "points go on beyond it"
    beyond = int(np.count_nonzero((u > whole.at_m + 6.0 * noise_m) & (u < whole.at_m + 6.0 * noise_m + margin_m)))
    before = int(np.count_nonzero((u > whole.at_m - 2.0 * margin_m) & (u < whole.at_m - margin_m)))
    if beyond > CONTINUED * max(before, LEAST_OF_PATCH):
        return "points go on beyond it"
    sides = [
        edge
        for edge in (_edge(u[near[patch[near] == p]], noise_m, LEAST_OF_PATCH) for p in range(PATCHES))
        if edge is not None and edge.sd_m < AGREEMENT_M
    ]
    birge = 1.0
    if len(sides) > 1:
        at, sd = np.array([edge.at_m for edge in sides]), np.array([max(edge.sd_m, LEAST_SD_M) for edge in sides])
        mean = float(at @ sd**-2 / (sd**-2).sum())
        apart = np.abs(at - mean)
        if (apart > AGREEMENT_M + 3.0 * sd).any():
            return "its sides do not stop at one place"
        ratio = float(((at - mean) / sd) @ ((at - mean) / sd)) / (len(at) - 1)
        birge = max(ratio, 1.0)
    return CloudEnd(whole.at_m, float(np.hypot(whole.sd_m * np.sqrt(birge), LEAST_SD_M)))


def _rough_end(u: Array, noise_m: float) -> float:
    """Return the outermost place with as many points around it as there are elsewhere, nearly."""
    cell_m = max(0.004, 3.0 * noise_m)
    cells = np.floor((u - u.min()) / cell_m).astype(np.int64)
    counts = np.bincount(cells)
    usual = float(np.median(counts[counts > 0]))
    full = np.flatnonzero(counts >= max(0.3 * usual, 1.0))
    return float(u.min() + (full[-1] + 1) * cell_m)


def _edge(u: Array, noise_m: float, least: int = LEAST_POINTS) -> CloudEnd | None:
    """Return the posterior mean and deviation of the place where evenly spread points stop.

    Points are even up to the end e, blurred along the axis by a part b of the noise, and a share f
    of them are strays: ``p(u) ~ (1 - f) Phi((e - u) / b) / Z + f / width``. Flat priors on e and
    on tables of b and f.
    """
    from scipy.special import log_ndtr

    if len(u) < least:
        return None
    u = np.sort(u)[-MOST_POINTS:]
    low, high = float(u[0]), float(u[-1]) + 3.0 * noise_m
    width = high - low
    if width <= 0:
        return None
    spacing = width / len(u)
    at, sd = float(u[-1]), max(10.0 * noise_m, 0.02)
    for _ in range(ROUNDS):
        e = np.linspace(max(at - 3.0 * sd, low + 0.1 * width), min(at + 3.0 * sd, high + 4.0 * spacing), GRID)
        score = np.empty((len(BLURS), len(STRAYS), GRID))
        for i, blur in enumerate(BLURS):
            b = blur * noise_m
            step = np.exp(log_ndtr((e[:, None] - u) / b))  # [GRID][P]
            # Integral of the blurred step over the window; outside of it there are no points by choice.
            Z = np.maximum(_integral(e, b, low, high), 1e-12)
            for j, f in enumerate(STRAYS):
                score[i, j] = np.log((1.0 - f) * step / Z[:, None] + f / width).sum(axis=1)
        weight = np.exp(score - score.max()).sum(axis=(0, 1))
        weight /= weight.sum()
        at = float(weight @ e)
        sd = float(np.sqrt(weight @ (e - at) ** 2)) + float(e[1] - e[0]) / 3
    sd -= float(e[1] - e[0]) / 3
    inside = u[u < at - 2.0 * noise_m]
    if len(inside) > 2:
        gap = float(np.diff(inside).max())
        if gap > ROWS * np.log(len(inside)) * float(np.ptp(inside)) / len(inside):
            at, sd = at + gap / 2, float(np.hypot(sd, gap / np.sqrt(12.0)))
    return CloudEnd(at, sd)


def _integral(e: Array, b: float, low: float, high: float) -> Array:
    """Return the integral of Phi((e - u) / b) over u from low to high."""
    from scipy.special import ndtr

    def primitive(t: Array) -> Array:
        return np.asarray(t * ndtr(t) + np.exp(-0.5 * t * t) / np.sqrt(2.0 * np.pi))

    return np.asarray(b * (primitive((e - low) / b) - primitive((e - high) / b)))
