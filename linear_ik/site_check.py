"""Check: what a scan shows of a model, before anything is fitted.

Points count for the member whose surface they are nearest to, within 50 mm: what the
placement may be off by. A member is covered when half of its segments have ten of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.coordinates import coarse_step_m
from linear_ik.design_model import DesignModel
from linear_ik.errors import DesignError
from linear_ik.scan import Scan
from linear_ik.scan_sample import ScanSample
from linear_ik.site_frames import CLEARLY, FrameFinding, Hits, compare_frames, sure_change
from linear_ik.site_samples import SurfaceSamples, sample_surfaces

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

NEAR_M = 0.05
POINTS_A_SEGMENT = 10
COVERED = 0.5  # of the segments
SAMPLE = 20_000
CELL_M = 0.25
MOST_CELLS = 50_000_000


@dataclass(frozen=True, eq=False)
class ScanCheck:
    """One scan against a model.

    Attributes:
        name: of the scan, for messages.
        points: finite ones.
        low_m: [3] of the bounding box, in the coordinates that the scan came in.
        high_m: [3].
        stations: scanner positions, None where the scan names none.
        finding: whether the two are in the same coordinates.
        near: [N] points near each segment of the model, all members' segments counted through.
        left_out: points that are none, see `no_points`.
    """

    name: str
    points: int
    low_m: Array
    high_m: Array
    stations: int | None
    finding: FrameFinding
    near: Counts
    left_out: int = 0


@dataclass(frozen=True)
class Coverage:
    """What the scans show of one member.

    Attributes:
        points: near its surface.
        points_per_m: along its length.
        points_per_m2: of its outer surface.
        seen: share of its segments that have ten points.
    """

    points: int
    points_per_m: float
    points_per_m2: float
    seen: float

    @property
    def covered(self) -> bool:
        """Whether half of the segments are seen."""
        return self.seen >= COVERED


class SiteCheck:
    """Compares scans with one model.

    Args:
        model: with at least one member.

    Raises:
        DesignError: said of the model: it has no members.
    """

    def __init__(self, model: DesignModel) -> None:
        """Sample the members' surfaces."""
        if not model.members:
            raise DesignError(model.source, "has no element that could be fitted", "at least one that is linear")
        self.model = model
        self.samples: SurfaceSamples = sample_surfaces(model)
        points = self.samples.points_m
        self.box_m = np.array([points.min(axis=0), points.max(axis=0)])

    def scan(
        self,
        name: str,
        read: Callable[[], Iterable[Scan]],
        on_progress: Callable[[int], None] | None = None,
    ) -> ScanCheck:
        """Check a scan, read twice piece by piece: once for where it is, once for what it shows.

        Args:
            name: for messages.
            read: returns the scan's pieces.
            on_progress: called with how many points have been compared.

        Raises:
            ScanError: what ``read`` raises.
        """
        count, left_out, low, high = 0, 0, np.full(3, np.inf), np.full(3, -np.inf)
        stations: set[tuple[float, ...]] = set()
        some = ScanSample()
        for piece in some.of(read()):
            count, left_out = count + len(piece), left_out + piece.left_out
            low, high = np.minimum(low, piece.points.min(axis=0)), np.maximum(high, piece.points.max(axis=0))
            if piece.stations is not None:
                stations.update(map(tuple, piece.stations.tolist()))
        sample = some.points
        sample = sample[:: max(1, len(sample) // SAMPLE)]
        finding = compare_frames(self.model, sample, self.box_m, self._hits)
        if (step := coarse_step_m(sample)) is not None:
            text = f"its coordinates were stored in single precision: steps of {1000 * step:.3g} mm"
            finding = FrameFinding(finding.place, (*finding.sentences, text), finding.share)
        near = self._near(read, finding.place, on_progress)
        return ScanCheck(name, count, low, high, len(stations) or None, finding, near, left_out)

    def sure_change(self, sample: Array, near: float) -> str:
        """Return what a scan's coordinates have to be changed by, as a sentence; empty unless that is beyond doubt.

        Args:
            sample: [P][3] some points of the whole scan, in what should be the model's coordinates.
            near: share of the scan's points that are near an element as it is, in a fit's wider sense.
        """
        sentence, share = sure_change(self.model, sample[:: max(1, len(sample) // SAMPLE)], self._hits)
        return sentence if share > CLEARLY * near else ""

    def coverage(self, checks: Iterable[ScanCheck]) -> list[Coverage]:
        """Return what scans show together of each member, in the model's order."""
        zero = np.zeros(len(self.samples.member_of_segment), dtype=np.int64)
        near = sum((check.near for check in checks), zero)
        members = len(self.model.members)
        owner = self.samples.member_of_segment
        points = np.bincount(owner, near, members)
        seen = np.bincount(owner, near >= POINTS_A_SEGMENT, members) / np.bincount(owner, minlength=members)
        return [
            Coverage(int(n), float(n / m.element.length_m), float(n / area), float(share))
            for n, m, area, share in zip(points, self.model.members, self.samples.area_m2, seen, strict=True)
        ]

    def _near(
        self, read: Callable[[], Iterable[Scan]], place: str, on_progress: Callable[[int], None] | None
    ) -> Counts:
        near = np.zeros(len(self.samples.member_of_segment), dtype=np.int64)
        if place == "elsewhere":
            return near
        done = 0
        for piece in read():
            points = piece.points
            if place == "map" and self.model.map_conversion is not None:
                points = self.model.map_conversion.to_model(points)
            near += np.bincount(self.samples.segment[self._nearest(points)], minlength=len(near))
            done += len(points)
            if on_progress is not None:
                on_progress(done)
        return near

    def _hits(self, points: Array) -> Hits:
        """Count which of some points [P][3] are near a member, and near how many segments."""
        rows = self._nearest(points)
        return Hits(len(rows) / max(len(points), 1), len(np.unique(self.samples.segment[rows])))

    def _nearest(self, points: Array) -> npt.NDArray[np.int64]:
        """Return the samples next to those of the points [P][3] that are near one."""
        points = points[self._grid.near(points)]
        if not len(points):
            return np.empty(0, dtype=np.int64)
        # A point on the surface is up to 0.71 spacings from the next sample.
        reach = float(np.hypot(NEAR_M, 0.71 * self.samples.spacing_m))
        distances, rows = self._tree.query(points - self.box_m[0], distance_upper_bound=reach)
        return np.asarray(rows[np.isfinite(distances)], dtype=np.int64)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points_m - self.box_m[0])

    @cached_property
    def _grid(self) -> _Grid:
        return _Grid(self.samples.points_m, self.box_m)


class _Grid:
    """Cells that hold a sample, or are next to one that does: most points of a scan are in none."""

    def __init__(self, samples: Array, box_m: Array) -> None:
        size = box_m[1] - box_m[0]
        self.cell_m = max(CELL_M, float(np.prod(size + 1.0) / MOST_CELLS) ** (1 / 3))
        self.low = box_m[0] - 1.5 * self.cell_m
        self.shape = np.ceil((size + 3 * self.cell_m) / self.cell_m).astype(np.int64)
        full = np.zeros(self.shape, dtype=bool)
        full[tuple(((samples - self.low) / self.cell_m).astype(np.int64).T)] = True
        for axis in range(3):
            shifted = full.copy()
            shifted |= np.roll(full, 1, axis=axis) | np.roll(full, -1, axis=axis)
            full = shifted
        self.full = full

    def near(self, points: Array) -> npt.NDArray[np.bool_]:
        """Return which of the points [P][3] may be near a sample."""
        with np.errstate(invalid="ignore", over="ignore"):
            at = np.floor((points - self.low) / self.cell_m)
        inside = ((at >= 0) & (at < self.shape)).all(axis=1)
        found = np.zeros(len(points), dtype=bool)
        rows = at[inside].astype(np.int64)
        found[inside] = self.full[rows[:, 0], rows[:, 1], rows[:, 2]]
        return found
