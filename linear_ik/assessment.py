"""Assessment: what the scan says of each segment, and whether the fit can be believed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Pose
from linear_ik.problem import Problem
from linear_ik.reason import Reason
from linear_ik.result import SegmentResult, SegmentStatus
from linear_ik.tally import BESIDE, COVERAGE_RADIUS, MATCHED, Tally
from linear_ik.uncertainty import LARGEST_NOISE_M

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LEAST_POINTS = 6
LEAST_COVERAGE = 0.05
LEAST_SCANNED = 0.2
FLAT_BY_CHANCE = BESIDE / MATCHED - 1.0
ALONE = 4.0  # times as crowded as chance: points that scatter as far as clutter does, and are none
MOST_SPREAD_M = 0.010
# Across the axis; more than a node may be unsure by where a fit claims to be right, unless points scatter more.
MOST_ACROSS_M = 0.002


def assess_segments(problem: Problem, counted: Tally, foreign: Mask, noise_m: float) -> tuple[SegmentResult, ...]:
    """Return status, points, coverage and residual of each segment.

    A segment is measured where points crowd on its surface: a cloud without it has three
    times as many points between 4 and 16 deviations from the surface as within 4, and about a
    thin wire more. Where they scatter 10 mm, which is no surface a scanner saw, hardly any may
    lie beside it: a coarse grid through a pole that stands by itself.

    Args:
        problem: what was fitted.
        counted: sums over all points.
        foreign: [N] segments whose points were ignored; neighbours and priors fix them.
        noise_m: standard deviation of the matched points.
    """
    count = counted.matched
    covered = coverage(problem, counted)
    times = ALONE if noise_m >= LARGEST_NOISE_M else 1.0
    crowded = count * by_chance(problem.surface.radius_m, noise_m) >= times * FLAT_BY_CHANCE * counted.beside
    seen = (count >= LEAST_POINTS) & (covered >= LEAST_COVERAGE) & crowded
    seen &= ~foreign
    between = _between(problem, seen | foreign)
    out = []
    for k in range(len(count)):
        status: SegmentStatus = "measured" if seen[k] else ("inferred" if between[k] else "not_scanned")
        rmse = float(np.sqrt(counted.squares_m2[k] / count[k])) if count[k] else float("nan")
        out.append(SegmentResult(status, int(count[k]), float(covered[k]), rmse))
    return tuple(out)


def by_chance(radius_m: float | None, noise_m: float) -> float:
    """Return how many times as many points of an even cloud lie beside a surface as on it, by the areas of both rings.

    Args:
        radius_m: of a round section; None for flat faces, of which as much lies beside as is farther away.
        noise_m: standard deviation of a point.
    """
    if radius_m is None:
        return FLAT_BY_CHANCE

    def disc_m2(distance_m: float) -> float:
        """Area within a distance of the circle, without pi."""
        return (radius_m + distance_m) ** 2 - max(radius_m - distance_m, 0.0) ** 2

    return disc_m2(BESIDE * noise_m) / disc_m2(MATCHED * noise_m) - 1.0


def _between(problem: Problem, known: Mask) -> Mask:
    """Return which segments [N] have something known, a seen segment or a support, on both sides."""
    element = problem.element
    below = np.logical_or.accumulate(known) | (element.start != "free")
    above = np.logical_or.accumulate(known[::-1])[::-1] | (element.end in ("pinned", "fixed"))
    return np.asarray(below & above)


def coverage(problem: Problem, counted: Tally) -> Array:
    """Return the share [N] of each segment's surface within 2 % of the element's length of a matched point."""
    n, around, along = counted.touched.shape
    surface, cell_m = problem.surface, problem.element.segment_length_m / along
    radius_m = COVERAGE_RADIUS * problem.element.length_m
    xy = surface.at((np.arange(around) + 0.5) / around * surface.perimeter_m)
    apart = xy[:, None] - xy[None]
    apart_m2 = np.einsum("ijk,ijk->ij", apart, apart)
    touched = counted.touched.transpose(1, 0, 2).reshape(around, n * along).astype(np.float32)
    covered = counted.touched.copy()
    # Cells within the radius: for each distance along the axis, those near enough around it.
    for steps in range(min(int(radius_m / cell_m), along - 1) + 1):
        near = (apart_m2 < radius_m**2 - (steps * cell_m) ** 2).astype(np.float32)
        reached = (near @ touched > 0).reshape(around, n, along).transpose(1, 0, 2)
        covered[:, :, steps:] |= reached[:, :, : along - steps]
        covered[:, :, : along - steps] |= reached[:, :, steps:]
    return np.asarray(covered.mean(axis=(1, 2)))


def cloud_rmse(problem: Problem, pose: Pose, counted: Tally, points: Array, seed: int) -> float:
    """Return the paper's RMSE: scan points to the nearest of a cloud sampled on the model.

    The model's cloud has as many points as were matched (at most 10,000), so the figure
    is mostly their spacing, as in the paper.

    Args:
        problem: for the section.
        pose: of the model.
        counted: for the number of matched points.
        points: [P][3] matched scan points, element's frame.
        seed: of the model's cloud, and of the choice of 1,000 points.
    """
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    if not len(points):
        return float("nan")
    n = pose.n_segments
    each = max(min(int(counted.matched.sum()), 10_000) // n, 1)
    model = problem.surface.sample(each, problem.chain.segment_length_m, rng)
    model = (model @ pose.rotations.transpose(0, 2, 1) + pose.nodes_m[:n, None]).reshape(-1, 3)
    if len(points) > 1000:
        points = points[rng.choice(len(points), 1000, replace=False)]
    distance, _ = cKDTree(model, balanced_tree=False, compact_nodes=False).query(points)
    return float(np.sqrt(np.mean(distance**2)))


def judge(
    problem: Problem,
    pressed: Mask,
    segments: tuple[SegmentResult, ...],
    sd_m: tuple[Array, Array],
    noise_m: float,
    converged: bool,
) -> tuple[Reason, ...]:
    """Return why the fit may be wrong; `linear_ik.result.status_of` makes a status of it.

    Args:
        problem: what was fitted.
        pressed: [6 + 3N] variables that the points push against their limit.
        segments: their assessment.
        sd_m: [N+1] largest standard deviation of each node across the axis, and along it.
        noise_m: standard deviation of the matched points.
        converged: whether the last stage stopped by itself.
    """
    n = len(segments)
    measured = [s.status == "measured" for s in segments]
    if sum(measured) < max(1.0, LEAST_SCANNED * n):
        near = int(sum(s.points for s in segments))
        return (
            Reason(
                "absent", f"the element is not in the scan: {near} points near it make up no surface of its section"
            ),
        )
    reasons = []
    if not converged:
        reasons.append(Reason("not_at_rest", "it did not come to rest: nodes still moved when its iterations ended"))
    unseen, inferred = ([k + 1 for k, s in enumerate(segments) if s.status == x] for x in ("not_scanned", "inferred"))
    if unseen:
        reasons.append(Reason("segments_not_scanned", f"{_segments(unseen)} not scanned"))
    if inferred:
        reasons.append(Reason("segments_inferred", f"{_segments(inferred)} inferred from the neighbours only"))
    smallest = float(np.ptp(problem.surface.corners, axis=0).min())
    if noise_m > max(0.006, 0.02 * smallest):
        scatter = f"matched points scatter {noise_m * 1e3:.1f} mm about the surface"
        reasons.append(Reason("scatter", f"{scatter}: another section, or clutter, is likely"))
    joints = sorted({int((i - BASE) // 3) + 1 for i in np.flatnonzero(pressed) if i >= BASE})
    if joints:
        where = f"joint limits active at {_segments(joints)}"
        reasons.append(Reason("joint_limits", f"{where}: the element bends more than it may"))
    if pressed[:BASE].any():
        reasons.append(Reason("placement_limits", "the start has moved as far as placement_tolerance allows"))
    across_m, along_m = sd_m
    if across_m.max() > max(MOST_ACROSS_M, noise_m):
        worst = int(across_m.argmax())
        known = f"node {worst} is known to {across_m[worst] * 2e3:.0f} mm only (95 %)"
        reasons.append(Reason("bending_not_shown", f"the visible faces do not show all bending: {known}"))
    if along_m.max() > MOST_SPREAD_M:
        known = f"as designed, to {along_m.max() * 2e3:.0f} mm (95 %)"
        where = "the scan does not show where the element lies along its axis"
        reasons.append(Reason("place_not_shown", f"{where}: {known}"))
    return tuple(reasons)


def spread(pose: Pose, node_covariance_m2: Array) -> tuple[Array, Array]:
    """Return the largest standard deviation [N+1] of each node across the axis, and the one along it."""
    axis = np.concatenate([pose.rotations[:, :, 2], pose.rotations[-1:, :, 2]])
    along = np.einsum("ki,kij,kj->k", axis, node_covariance_m2, axis)
    P = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    across = np.linalg.eigvalsh(P @ node_covariance_m2 @ P)[:, -1]
    return np.sqrt(np.maximum(across, 0.0)), np.sqrt(np.maximum(along, 0.0))


def unobservable(problem: Problem, pose: Pose, node_covariance_m2: Array) -> tuple[str, ...]:
    """Return what the scan does not show, in words.

    A direction is not shown where a node's standard deviation along it is above 10 mm.

    Args:
        problem: what was fitted.
        pose: the fitted chain.
        node_covariance_m2: [N+1][3][3] element's frame.
    """
    out = ["torsion: the section is round"] if problem.surface.radius_m is not None else []
    R = np.concatenate([pose.rotations, pose.rotations[-1:]])
    sd_m = np.sqrt(np.maximum(np.einsum("kia,kij,kja->ka", R, node_covariance_m2, R), 0.0))
    hidden = sd_m > MOST_SPREAD_M
    for axis, name in enumerate("xy"):
        nodes = np.flatnonzero(hidden[:, axis])
        if len(nodes):
            out.append(f"bending along local {name}: node{'s' if len(nodes) > 1 else ''} {runs(nodes)}")
    if hidden[:, 2].any():
        out.append("the place along the axis")
    return tuple(out)


def listed(which: Mask) -> str:
    """Return "segments 2, 4 to 6" of a mask [N]."""
    return _segments([int(k) + 1 for k in np.flatnonzero(which)])


def _segments(which: list[int]) -> str:
    return f"segment{'' if len(which) == 1 else 's'} {runs(which)}"


def runs(which: Iterable[int]) -> str:
    """Return "2, 4 to 6" of ascending numbers."""
    return ", ".join(str(r[0]) if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in grouped(which))


def grouped(which: Iterable[int]) -> list[list[int]]:
    """Return ascending numbers in runs of consecutive ones."""
    found: list[list[int]] = []
    for k in which:
        if found and k == found[-1][-1] + 1:
            found[-1].append(k)
        else:
            found.append([k])
    return found
