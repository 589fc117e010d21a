"""Segment count: how many segments a scan can tell apart, by its evidence.

More segments follow a shape more closely and know each joint less well. Counts are tried from coarse
to fine; the points' cost falls with each, and the Bayesian information criterion says whether by more
than the added joints are worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Chain
from linear_ik.correspondence import Matcher
from linear_ik.element import Element
from linear_ik.errors import ElementError
from linear_ik.result import FitResult, SegmentCount
from linear_ik.scan import Scan
from linear_ik.side_noise import sides
from linear_ik.surface import Surface
from linear_ik.tapered_surface import surface_of

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

COUNTS = (5, 10, 20, 40, 80)
LEAST_POINTS_A_SEGMENT = 60
MOST_POINTS = 20_000  # that are judged by
NEAR_M = 0.05
FAR = 5.0  # deviations from where on a point costs no more
WORSE = 2  # finer counts in a row after which no finer one is tried
PATCHES, LEAST_OF_PATCH = 40, 20  # along the member, on each of its sides
CHI2_MEDIAN = 0.4549  # of one degree of freedom


def choose_segments(
    element: Element, scan: Scan, fit_once: Callable[[Element], FitResult]
) -> tuple[FitResult, tuple[SegmentCount, ...]]:
    """Return the fit with the count of segments that the scan makes most probable, and what was tried.

    With the noise s and the number P of points, a fit with p joint angles has
    ``BIC = sum min(d^2, (5 s)^2) / (b s^2) + p ln P``, the points all the same ones. Errors that points
    share would ask for joints of their own: b is the Birge ratio of patches of the surface, and s and b are
    those of the fit in which they are the least.

    Args:
        element: the design; its own count does not matter.
        scan: points in the placement's coordinates.
        fit_once: fits an element with its own count.
    """
    fits: list[FitResult] = []
    off: list[tuple[Array, Index]] = []
    absent: list[FitResult] = []
    rows: Array | None = None
    best = np.inf
    scores: Array = np.empty(0)
    for counted in candidates(element):
        if fits and sum(s.points for s in fits[0].segments) < LEAST_POINTS_A_SEGMENT * counted.segments:
            break
        result = fit_once(counted)
        if result.status == "not_scanned":
            absent.append(result)
            # What too few segments miss, twice as many may find.
            if len(absent) > WORSE and not fits:
                break
            continue
        if rows is None:
            rows = _near(counted, result, scan)
        fits.append(result)
        off.append(_distances(counted, result, rows))
        scores = criterion(fits, off)
        best = float(scores.min())
        if (scores[-WORSE:] > best).all() and len(scores) > WORSE:
            break
    if not fits:
        return absent[0], ()
    chosen = int(scores.argmin())
    tried = tuple(
        SegmentCount(fit.element.segments, float(score - best), fit.surface_rmse_m)
        for fit, score in zip(fits, scores, strict=True)
    )
    return fits[chosen], tried


def candidates(element: Element) -> list[Element]:
    """Return the element with each count of segments that makes sense, coarse ones first.

    A segment is at least as long as the section is wide or deep: a shorter one is no beam.

    Raises:
        ElementError: a curved design axis that none of the counts can follow.
    """
    size_m = max(float(Surface.of(element.profile_at(share)).size_m.max()) for share in (0.0, 1.0))
    most = max(1, int(element.length_m / size_m + 1e-9))
    counts = [count for count in COUNTS if count <= most] or [most]
    out, failed = [], None
    for count in counts:
        try:
            counted = replace(element, segments=count, auto_segments=False)
            Chain.of(counted)
        except ElementError as error:
            failed = error
            continue
        out.append(counted)
    if not out and failed is not None:
        raise failed
    return out


def criterion(fits: list[FitResult], off: list[tuple[Array, Index]]) -> Array:
    """Return the BIC of each fit, see `choose_segments`.

    Args:
        fits: of the same scan.
        off: of each the distance [P] of the same points to its surface, with their sign, and their patch [P].
    """
    noise_m = min(fit.range_noise_m for fit in fits)
    birge = min(_birge(distance, patch, noise_m) for distance, patch in off)
    out = []
    for fit, (distance, _) in zip(fits, off, strict=True):
        cost = float(np.minimum((distance / noise_m) ** 2, FAR**2).sum())
        turns = 2 if fit.element.profile.radius_m is not None else 3
        out.append(cost / birge + turns * fit.element.segments * np.log(len(distance)))
    return np.array(out)


def _near(element: Element, result: FitResult, scan: Scan) -> Array:
    """Return points [P][3] near a coarse fit, in the scan's coordinates, evenly at random."""
    reach_m = surface_of(element, result.section_scale).reach_m + NEAR_M + 0.1 * element.length_m
    low, high = result.nodes_m.min(axis=0) - reach_m, result.nodes_m.max(axis=0) + reach_m
    rows = np.flatnonzero(((scan.points >= low) & (scan.points <= high)).all(axis=1))
    rng = np.random.default_rng(0)
    if len(rows) > 10 * MOST_POINTS:
        rows = rng.choice(rows, 10 * MOST_POINTS, replace=False)
    # A coarse chain leaves the member by its sagitta: what is near to some longer segment's middle is taken too.
    distance, _ = _distances(element, result, scan.points[rows])
    sagitta_m = 0.25 * element.segment_length_m
    rows = rows[np.abs(distance) < NEAR_M + sagitta_m]
    if len(rows) > MOST_POINTS:
        rows = rng.choice(rows, MOST_POINTS, replace=False)
    return np.asarray(scan.points[rows])


def _distances(element: Element, result: FitResult, points: Array) -> tuple[Array, Index]:
    """Return the distance of points [P][3] to a fitted surface, with the residual's sign, and their patch [P] of it."""
    chain, T = Chain.of(element), result.base_pose
    surface = surface_of(element, result.section_scale)
    local = np.ascontiguousarray((points - T[:3, 3]) @ T[:3, :3])
    pairs = Matcher(surface, chain.segment_length_m).match(chain.pose(chain.with_q(result.q)), local)
    distance, patch = np.empty(len(points)), np.empty(len(points), dtype=np.intp)
    share = (pairs.segment + pairs.local[:, 2] / element.segment_length_m) / element.segments
    along = np.clip((share * PATCHES).astype(np.intp), 0, PATCHES - 1)
    distance[pairs.order] = np.where(pairs.residual_m < 0, -pairs.distance_m, pairs.distance_m)
    patch[pairs.order] = 8 * along + sides(pairs.gradient)
    return distance, patch


def _birge(distance: Array, patch: Index, noise_m: float) -> float:
    """Return by how much the squares of the patches' mean distances exceed those of points that err independently."""
    on = np.abs(distance) < FAR * noise_m
    count = np.bincount(patch[on], minlength=8 * PATCHES)
    pull = np.bincount(patch[on], distance[on] / noise_m, minlength=8 * PATCHES)
    full = count >= LEAST_OF_PATCH
    if not full.any():
        return 1.0
    return max(1.0, float(np.median(pull[full] ** 2 / count[full])) / CHI2_MEDIAN)
