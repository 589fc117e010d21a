"""One fit, measured against the truth at its end and after every iteration."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik import Chain, Element, FitResult, FitSettings, SimulatedScan, fit
from linear_ik.cloud_pairs import ModelCloud
from linear_ik.correspondence import Matcher
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

MOST_QUERIES = 5_000
# Not one of the fits': a method must not be measured by the very cloud it was fitted with.
YARDSTICK_SEED = 10_007


@dataclass(frozen=True)
class Run:
    """A fit and its errors.

    Attributes:
        status: the fit's own verdict.
        iterations: over all phases.
        phases: iterations of each phase.
        time_s: wall time, the median of the repeats.
        node_mm: [N+1] distance of each node from the truth.
        cloud_rmse_mm: the paper's RMSE, see `Yardstick`.
        surface_rmse_mm: all scan points to the model's surface.
        cloud_curve_mm: [iterations + 1] the former, from the design on.
        surface_curve_mm: [iterations + 1] the latter.
        q: [3N] where it ended.
        base_pose: [4][4].
    """

    status: str
    iterations: int
    phases: dict[str, int]
    time_s: float
    node_mm: list[float]
    cloud_rmse_mm: float
    surface_rmse_mm: float
    cloud_curve_mm: list[float] = field(default_factory=list)
    surface_curve_mm: list[float] = field(default_factory=list)
    q: list[float] = field(default_factory=list)
    base_pose: list[list[float]] = field(default_factory=list)

    @property
    def tip_mm(self) -> float:
        """Error of the last node."""
        return self.node_mm[-1]

    @property
    def max_mm(self) -> float:
        """Error of the worst node."""
        return max(self.node_mm)

    @property
    def rms_mm(self) -> float:
        """Root mean square over the nodes but the first."""
        return float(np.sqrt(np.mean(np.square(self.node_mm[1:]))))

    def as_mapping(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return asdict(self)


class Yardstick:
    """Measures poses of one element against one scan, all methods alike.

    It shares with the methods: the chain, the cloud on the model (`cloud_pairs.ModelCloud`,
    drawn with a seed that no fit has), and the closest-point query (`correspondence.Matcher`,
    whose distances tests/test_correspondence.py compares with plain geometry). The errors of
    the nodes, which decide, need none of them but the chain.
    """

    def __init__(
        self, element: Element, scan: SimulatedScan, seed: int = YARDSTICK_SEED, cloud: SimulatedScan | None = None
    ) -> None:
        """Sample a cloud on the model, as dense as the scan is, or take that of a scan of the design.

        The paper's RMSE is the rms distance from the scan's points (5,000 of them at
        most) to the nearest point of that cloud.
        """
        self.element, self.scan = element, scan
        self.chain = Chain.of(element)
        surface = Surface.of(element.profile)
        self._matcher = Matcher(surface, self.chain.segment_length_m)
        self._cloud = ModelCloud(surface, self.chain.segment_length_m, len(scan.points), seed)
        if cloud is not None:
            self._cloud.segment, self._cloud.local = in_segments(element, cloud)
        few = np.random.default_rng(seed).permutation(len(scan.points))[:MOST_QUERIES]
        self._queries = scan.points[few]

    def measure(self, q: npt.ArrayLike, base_pose: Array) -> tuple[float, float]:
        """Return the paper's RMSE and the rms distance to the surface, in mm, of Pinocchio's q on a base."""
        from scipy.spatial import cKDTree

        pose = self.chain.pose(self.chain.with_q(q))
        R, t = base_pose[:3, :3], base_pose[:3, 3]
        points = (self._queries - t) @ R
        between, _ = cKDTree(self._cloud.at(pose), balanced_tree=False, compact_nodes=False).query(points)
        to_surface = self._matcher.match(pose, points).distance_m
        return 1e3 * float(np.sqrt(np.mean(between**2))), 1e3 * float(np.sqrt(np.mean(to_surface**2)))

    def at_truth(self) -> tuple[float, float]:
        """Return both figures of the truth: what a perfect fit would score."""
        return self.measure(self.scan.q, self.scan.base_pose)


def in_segments(element: Element, cloud: SimulatedScan) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the segment [P] (from 0) of each point of a scan of the design, and the point in its frame [P][3]."""
    segment = cloud.segment.astype(np.intp) - 1
    T = element.placement.T_world_element
    local = (cloud.points - T[:3, 3]) @ T[:3, :3]
    local[:, 2] -= segment * element.segment_length_m
    return segment, local


@contextmanager
def model_cloud(element: Element, cloud: SimulatedScan) -> Iterator[None]:
    """Have the paper's method use a scan of the design as its model's cloud."""
    import linear_ik.icpik as icpik

    class Given(icpik.ModelCloud):
        def __init__(self, *_: object) -> None:
            self.segment, self.local = in_segments(element, cloud)

    with patched((icpik, "ModelCloud", Given)):
        yield


@contextmanager
def patched(*changes: tuple[Any, str, Any]) -> Iterator[None]:
    """Give names of modules or classes other values for a while; each as (where, name, value).

    Raises:
        AttributeError: there is nothing of that name to replace.
    """
    before = [(where, name, getattr(where, name)) for where, name, _ in changes]
    for where, name, value in changes:
        setattr(where, name, value)
    try:
        yield
    finally:
        for where, name, value in before:
            setattr(where, name, value)


def run(
    element: Element,
    scan: SimulatedScan,
    settings: FitSettings,
    *,
    yardstick: Yardstick | None = None,
    repeats: int = 1,
) -> Run:
    """Fit a scan whose truth is known, and measure it.

    Args:
        element: the design.
        scan: its truth is used to judge, not to fit.
        settings: of the fit.
        yardstick: records the curves too, one point an iteration, when given.
        repeats: fits to take the median time of.
    """
    given = scan.without_truth()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        result = fit(element, given, settings)
        times.append(time.perf_counter() - started)
    cloud, surface = [], []
    end = (float("nan"), float("nan"))
    if yardstick is not None:
        design = np.zeros(3 * element.segments), element.placement.T_world_element
        for q, base_pose in (design, *((r.q, r.base_pose) for r in result.history)):
            measured = yardstick.measure(q, base_pose)
            cloud.append(measured[0])
            surface.append(measured[1])
        end = yardstick.measure(result.q, result.base_pose)
    phases: dict[str, int] = {}
    for record in result.history:
        phases[record.phase] = phases.get(record.phase, 0) + 1
    return Run(
        result.status,
        result.iterations,
        phases,
        float(np.median(times)),
        node_errors_mm(result, scan),
        *end,
        cloud,
        surface,
        result.q.tolist(),
        result.base_pose.tolist(),
    )


def node_errors_mm(result: FitResult, scan: SimulatedScan) -> list[float]:
    """Return the distance of each node from the truth [N+1]."""
    return [float(e) for e in 1e3 * np.linalg.norm(result.nodes_m - scan.nodes_m, axis=1)]


def warm_up(element: Element, scan: SimulatedScan, settings: FitSettings | None = None) -> None:
    """Fit once and forget it, so that no import is timed."""
    fit(element, scan.without_truth(), settings or FitSettings())
