"""Sampling: some of a scan's points, equal lengths of the element having an equal say.

A scan thins out with the square of the distance, so a plain random sample is taken from
the near end: medians, start-up and checks would know that end only.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

MOST_STRATA = 32  # along the element; density does not change much within one
RULER = 4096
POINTS_A_PIECE = 100_000


def stratified(points: Array, nodes_m: Array, count: int, rng: np.random.Generator) -> Index:
    """Return the rows, ascending, of ``count`` points chosen at random, or of all where there are no more.

    Every stretch of the chain gives the same number, or what it has where that is less;
    the others then give more.

    Args:
        points: [P][3], frame of the nodes.
        nodes_m: [N+1][3] where the chain is, as far as is known.
        count: how many are wanted.
        rng: chooses within a stretch.
    """
    if len(points) <= count:
        return np.arange(len(points))
    stretch = nearest_stretch(points, nodes_m)
    order = np.argsort(stretch, kind="stable")
    counts = np.bincount(stretch, minlength=1)
    parts = np.split(order, np.cumsum(counts)[:-1])
    chosen = [
        part if share == len(part) else rng.choice(part, share, replace=False, shuffle=False)
        for part, share in zip(parts, equal_shares(counts, count), strict=True)
    ]
    return np.sort(np.concatenate(chosen))


def nearest_stretch(points: Array, nodes_m: Array) -> npt.NDArray[np.uint8]:
    """Return which stretch of the chain, one segment or several, each point [P] is beside.

    A chain that never turns back is cut across its chord, one projection for all
    stretches; else a point belongs to the stretch whose middle is nearest.
    """
    n = len(nodes_m) - 1
    nodes = nodes_m[np.unique(np.linspace(0, n, min(n, MOST_STRATA) + 1).round().astype(int))].astype(points.dtype)
    chord = nodes[-1] - nodes[0]
    along = (nodes - nodes[0]) @ chord
    onwards = bool((np.diff(along) > 0).all())
    middle = (nodes[:-1] + nodes[1:]) / 2
    half = 0.5 * np.einsum("ij,ij->i", middle, middle)
    if onwards:
        # The cut below each place of a fine ruler: a look-up is ten times as fast as a search.
        ruler = np.searchsorted(along[1:-1], (np.arange(RULER) + 0.5) * (along[-1] / RULER)).astype(np.uint8)
    out = np.empty(len(points), dtype=np.uint8)
    for start in range(0, len(points), POINTS_A_PIECE):
        piece = slice(start, start + POINTS_A_PIECE)
        if onwards:
            place = (points[piece] @ chord - nodes[0] @ chord) * (RULER / along[-1])
            out[piece] = ruler[np.clip(place, 0, RULER - 1).astype(np.intp)]
        else:
            # The squared distance, less what all middles have in common.
            out[piece] = (half - points[piece] @ middle.T).argmin(axis=1)
    return out


def equal_shares(counts: Index, total: int) -> list[int]:
    """Return how many of each stratum's ``counts`` [S] to take: as equal as they allow, ``total`` in all.

    Args:
        counts: [S] points there are.
        total: at most their sum.
    """
    shares, left = np.zeros(len(counts), dtype=np.intp), total
    # From the poorest on, each takes its part of what is left, or all it has.
    for done, k in enumerate(np.argsort(counts, kind="stable")):
        shares[k] = min(int(counts[k]), left // (len(counts) - done))
        left -= int(shares[k])
    return [int(share) for share in shares]
