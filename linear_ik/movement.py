"""Movement: what became of one element between two scans, and how sure that is.

Two fits of one design are compared node by node, at equal shares of the length. The epochs are
independent, so a node's displacement d has the covariance C = C_before + C_after, and under "not
moved" d' C^-1 d has a chi-square distribution with three degrees of freedom. The nodes of an
element vary together, in a way that their own covariances don't say. Sidak's correction over the
nodes, p = 1 - (1 - min p_k)^M, needs no more: for centred normal distributions the probability
that all of several ellipsoids hold is at least the product of each one's, however they correlate
(Royen's Gaussian correlation inequality), so that p is never too small. Nodes that no measured
segment touches, in either epoch, are shown and not tested.

"Not moved" is a statement with limits: how far an element may have slid along its axis, which
surfaces hardly show, and how many of its nodes nobody looked at. Where either matters the verdict
is "not moved where seen".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from linear_ik.deviation_bands import BAND_95, band_along
from linear_ik.element import Element
from linear_ik.result import FitResult

Array = npt.NDArray[np.float64]
Verdict = Literal["moved", "not moved", "not moved where seen", "inconclusive", "absent in both"]

# Held nodes have no variance of their own; no scan tells a hundredth of a millimetre.
LEAST_SIGMA_M = 1e-5
# Designs that differ by more are two designs.
SAME_DESIGN_M = 1e-3
# Of less than this share of an element nobody says that it did not move.
LEAST_SEEN = 0.5


@dataclass(frozen=True, eq=False)
class Movement:
    """An element in two epochs. Metres, the scans' coordinates; M nodes, start to end.

    Attributes:
        key: what the two results have in common: the GlobalId, or the element's name.
        name: of the element.
        verdict: moved | not moved | not moved where seen (some nodes were not tested, or the band along
            the axis is wider than what is relevant) | inconclusive | absent in both (neither scan shows it).
        reasons: plain sentences: why it is inconclusive, and what else the reader should know.
        statuses: of the two fits; "absent" where an epoch has none.
        doubtful: whether a fit may be wrong in a way that its covariance does not carry.
        seen: [M] whether a measured segment touches the node in both epochs; only those are tested.
        nodes_m: [M][3] before.
        displacement_m: [M][3] after less before.
        covariance_m2: [M][3][3] of the displacement, 1 sigma.
        along_m: [M] part of the displacement along the member, towards its end positive.
        across_m: [M] length of the part across it.
        p_nodes: [M] chi-square, each node by itself.
        p_value: of the element, Sidak over its nodes; NaN where it was not tested.
        p_adjusted: corrected for the number of elements too.
        tag: the mark that drawings use; may be empty.
        ifc_class: such as IfcBeam; may be empty.
    """

    key: str
    name: str
    verdict: Verdict
    reasons: tuple[str, ...]
    statuses: tuple[str, str]
    doubtful: bool
    seen: npt.NDArray[np.bool_]
    nodes_m: Array
    displacement_m: Array
    covariance_m2: Array
    along_m: Array
    across_m: Array
    p_nodes: Array
    p_value: float
    p_adjusted: float
    tag: str = ""
    ifc_class: str = ""

    @property
    def tested(self) -> bool:
        """Whether both epochs have the element."""
        return len(self.nodes_m) > 0

    @property
    def largest(self) -> int:
        """The node that moved farthest, of those that were seen; counted from 0."""
        return int(np.where(self.seen, np.linalg.norm(self.displacement_m, axis=1), -1.0).argmax())

    @property
    def largest_m(self) -> float:
        """How far it moved; NaN where the element was not tested."""
        return float(np.linalg.norm(self.displacement_m[self.largest])) if self.tested else float("nan")

    @property
    def largest_band_m(self) -> float:
        """Half-width of its 95 % band, along its displacement."""
        if not self.tested:
            return float("nan")
        k = [self.largest]
        return float(band_along(self.displacement_m[k], self.covariance_m2[k])[0])

    @property
    def across_band_m(self) -> float:
        """Half-width of the widest 95 % band across the member, over the nodes seen: what would stay unseen."""
        if not self.tested:
            return float("nan")
        across = np.eye(3) - np.einsum("ki,kj->kij", *[_directions(self.nodes_m)] * 2)
        return BAND_95 * float(
            np.sqrt(np.linalg.norm(across @ self.covariance_m2 @ across, 2, axis=(1, 2))[self.seen].max())
        )

    @property
    def along_band_m(self) -> float:
        """Half-width of the widest 95 % band along the member, over the nodes seen: what would stay unseen."""
        if not self.tested:
            return float("nan")
        along = _directions(self.nodes_m)
        variance = np.einsum("ki,kij,kj->k", along, self.covariance_m2, along)
        return BAND_95 * float(np.sqrt(np.maximum(variance[self.seen].max(), 0.0)))

    @property
    def not_tested(self) -> int:
        """How many of its nodes no measured segment touches in both epochs; 0 where the element was not tested."""
        return int((~self.seen).sum()) if self.tested else 0

    @property
    def limits(self) -> tuple[str, ...]:
        """Sentences on what would not be seen; none for elements that moved or were not tested."""
        if not self.verdict.startswith("not moved"):
            return ()
        said = [f"Along the axis a movement below {1000 * self.along_band_m:.1f} mm would not be seen."]
        if self.not_tested:
            said.append(f"{self.not_tested} of {len(self.seen)} nodes not tested.")
        return tuple(said)


def movement(key: str, before: FitResult | None, after: FitResult | None) -> Movement:
    """Return what became of an element; `judge` gives the verdict.

    Args:
        key: of the element.
        before: its result in the first epoch, None where there is none.
        after: the same in the second.
    """
    known = next(r for r in (before, after) if r is not None)
    statuses = tuple("absent" if r is None else str(r.status) for r in (before, after))
    doubtful = any(_may_be_wrong(r) for r in (before, after))
    nothing = np.empty(0)
    empty = Movement(
        key=key,
        name=known.element.name,
        verdict="inconclusive",
        reasons=(),
        statuses=(statuses[0], statuses[1]),
        doubtful=doubtful,
        seen=np.empty(0, dtype=bool),
        nodes_m=np.empty((0, 3)),
        displacement_m=np.empty((0, 3)),
        covariance_m2=np.empty((0, 3, 3)),
        along_m=nothing,
        across_m=nothing,
        p_nodes=nothing,
        p_value=float("nan"),
        p_adjusted=float("nan"),
    )
    unseen = [f"The {epoch} epoch has no result." for epoch, r in _epochs(before, after) if r is None]
    unseen += [
        f"Not in the scan of the {epoch} epoch."
        for epoch, r in _epochs(before, after)
        if r is not None and r.status == "not_scanned"
    ]
    if unseen or before is None or after is None:
        nowhere = all(status in ("absent", "not_scanned") for status in statuses)
        return replace(empty, reasons=tuple(unseen), verdict="absent in both" if nowhere else "inconclusive")
    count = max(before.element.segments, after.element.segments)
    way, about_the_design = _designs(before.element, after.element)
    seen = _seen(before, count) & _seen(after, count)[way]
    if not seen.any():
        return replace(empty, reasons=("No part of it was measured in both epochs.",))
    (start, own_before), (end, own_after) = (_at_shares(r, count) for r in (before, after))
    end, own_after = end[way], own_after[way]
    reasons = [
        f"The fit of the {epoch} epoch says {r.status.replace('_', ' ')}: {' '.join(r.reasons)}".strip()
        for epoch, r in (("first", before), ("second", after))
        if r.status != "converged"
    ]
    reasons += about_the_design
    covariance = own_before + own_after
    if not np.isfinite(covariance).all():
        return replace(empty, reasons=(*reasons, "A fit does not know its covariance."))
    return with_displacement(replace(empty, reasons=tuple(reasons), seen=seen, nodes_m=start), end - start, covariance)


def with_displacement(of: Movement, displacement_m: Array, covariance_m2: Array) -> Movement:
    """Return a movement with its figures and tests, of these displacements [M][3] and covariances [M][3][3]."""
    directions = _directions(of.nodes_m)
    along = np.einsum("ki,ki->k", displacement_m, directions)
    across = np.linalg.norm(displacement_m - along[:, None] * directions, axis=1)
    C = covariance_m2 + LEAST_SIGMA_M**2 * np.eye(3)
    squared = np.einsum("ki,ki->k", displacement_m, np.linalg.solve(C, displacement_m[:, :, None])[:, :, 0])
    p_nodes = chi2.sf(np.maximum(squared, 0.0), 3)
    # 1 - (1 - p)^M without losing the digits of a small p.
    tested = p_nodes[of.seen]
    p_value = float(-np.expm1(len(tested) * np.log1p(-min(float(tested.min()), 1.0 - 1e-16))))
    return replace(
        of,
        displacement_m=displacement_m,
        covariance_m2=covariance_m2,
        along_m=along,
        across_m=across,
        p_nodes=p_nodes,
        p_value=p_value,
    )


def judge(of: Movement, p_adjusted: float, level: float, relevant_m: float) -> Movement:
    """Return a tested movement with its verdict.

    Args:
        of: the movement.
        p_adjusted: its p-value, corrected for the number of elements.
        level: of significance.
        relevant_m: a movement that must not stay unseen where it says "not moved"; "not moved where seen"
            promises it only across the member, at the nodes that were tested.
    """
    if not of.tested:
        return of
    reasons = list(of.reasons)
    if of.doubtful:
        verdict: Verdict = "inconclusive"
    elif p_adjusted <= level:
        verdict = "moved"
    elif of.seen.mean() < LEAST_SEEN:
        verdict = "inconclusive"
        reasons.append(f"Only {100 * of.seen.mean():.0f} % of it was measured in both epochs.")
    elif of.across_band_m > relevant_m:
        verdict = "inconclusive"
        reasons.append(f"Its band reaches {1000 * of.across_band_m:.1f} mm: more than {1000 * relevant_m:g} mm.")
    elif of.not_tested or of.along_band_m > relevant_m:
        verdict = "not moved where seen"
    else:
        verdict = "not moved"
    return replace(of, verdict=verdict, reasons=tuple(reasons), p_adjusted=p_adjusted)


def _designs(before: Element, after: Element) -> tuple[slice, list[str]]:
    """Return the order of the second design's nodes that makes them the first's, and how the two designs differ."""
    first, second = _designed_ends(before), _designed_ends(after)
    apart, crossed = (np.linalg.norm(first - ends, axis=1) for ends in (second, second[::-1]))
    said = []
    way = slice(None)
    # An element that was designed elsewhere along its own line is as far either way.
    if apart.sum() - crossed.sum() > SAME_DESIGN_M:
        way, apart = slice(None, None, -1), crossed
        said.append("Its design runs the other way in the second epoch.")
    longer_m = abs(before.length_m - after.length_m)
    if longer_m > SAME_DESIGN_M:
        said.append(f"Designed {before.length_m:.3f} m long, then {after.length_m:.3f} m.")
    if apart.max() > longer_m + SAME_DESIGN_M:
        said.append(f"Its design was moved, by up to {1000 * apart.max():.0f} mm at its ends.")
    return way, said


def _designed_ends(element: Element) -> Array:
    T = element.placement.T_world_element
    return np.asarray(element.design.nodes_m[[0, -1]] @ T[:3, :3].T + T[:3, 3])


def _seen(result: FitResult, count: int) -> npt.NDArray[np.bool_]:
    """Return which of the points at equal shares [count + 1] a measured segment touches."""
    n = result.element.segments
    measured = np.array([segment.status == "measured" for segment in result.segments])
    place = np.linspace(0.0, n, count + 1)
    before, after = (np.clip(np.floor(place + side).astype(int), 0, n - 1) for side in (-1e-9, 1e-9))
    return np.asarray(measured[before] | measured[after])


def _may_be_wrong(result: FitResult | None) -> bool:
    """Say whether a fit may be wrong in a way that its covariance does not carry."""
    return result is None or not (result.status == "converged" or result.doubts_are_carried)


def _epochs(before: FitResult | None, after: FitResult | None) -> tuple[tuple[str, FitResult | None], ...]:
    return ("first", before), ("second", after)


def _at_shares(result: FitResult, count: int) -> tuple[Array, Array]:
    """Return a chain's points [count + 1][3] at equal shares of its length, and their covariances.

    Between nodes a and b a point's covariance is taken as (1 - w) C_a + w C_b, the most that it can be
    however the two correlate.
    """
    n = result.element.segments
    place = np.linspace(0.0, n, count + 1)
    k = np.minimum(place.astype(int), n - 1)
    w = place - k
    nodes, C = result.nodes_m, result.nodes_covariance_m2
    points = (1.0 - w)[:, None] * nodes[k] + w[:, None] * nodes[k + 1]
    return np.asarray(points), np.asarray((1.0 - w)[:, None, None] * C[k] + w[:, None, None] * C[k + 1])


def _directions(nodes: Array) -> Array:
    """Return the member's direction [M][3] at each of its nodes."""
    steps = np.diff(nodes, axis=0)
    both = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    return np.asarray(both / np.maximum(np.linalg.norm(both, axis=1), 1e-12)[:, None])
