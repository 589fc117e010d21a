"""Scenes of the success maps: one element, bent by chance, scanned with what the map is about."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.cases import BEAM, HEB_300, LENGTH_M
from linear_ik import Element, RectangleHollow, SimulatedScan, simulate

Array = npt.NDArray[np.float64]

PROFILES = {"beam": BEAM, "box": RectangleHollow(0.2, 0.2, 0.01), "h": HEB_300}
HOLE_M = 0.15
CLUTTER_GAP_M = 0.050
MARGIN_M = 0.3
TOTALS_DEG = (0.0, 22.5, 45.0, 90.0, 135.0, 180.0)
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
MAP_POINTS = 4_000
FACES = {
    "none": (),
    "1 of 4": ("+x",),
    "2 adjacent": ("+x", "+y"),
    "2 opposite": ("+x", "-x"),
    "3 of 4": ("+x", "+y", "-x"),
}


@dataclass(frozen=True)
class Scene:
    """What is scanned, but for the seed.

    Attributes:
        total_deg: bends of all joints added up, all in one plane of random azimuth.
        joints: how many joints share it, chosen at random from joint 2 on; all when 0.
        profile: "beam", 0.1 x 0.3 m, "box", 0.2 x 0.2 m, or "h", the H-section.
        segments: of the element and of the truth.
        points: on the whole element, before any go missing.
        noise_m: standard deviation.
        faces_missing: by their outward direction.
        holes: share of the points that random holes of 150 mm radius take away.
        outliers: share of the scan that lies anywhere around the element.
        clutter: share of the scan that lies on a wall beside the element, 50 mm off.
    """

    total_deg: float
    joints: int = 0
    profile: str = "beam"
    segments: int = 10
    points: int = 6_000
    noise_m: float = 0.001
    faces_missing: tuple[str, ...] = ()
    holes: float = 0.0
    outliers: float = 0.0
    clutter: float = 0.0

    @property
    def element(self) -> Element:
        """The design."""
        return Element("member", PROFILES[self.profile], LENGTH_M, self.segments)

    @property
    def possible(self) -> bool:
        """Whether the bends stay within the joint limits."""
        return self.total_deg / (self.joints or self.segments - 1) <= 45.0

    def as_mapping(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return asdict(self)

    def scan(self, seed: int) -> SimulatedScan:
        """Return the scene's cloud; the seed chooses the bends too."""
        rng = np.random.default_rng([seed, 1])
        azimuth = rng.uniform(0.0, 2.0 * np.pi)
        count = self.joints or self.segments - 1
        bent = rng.choice(np.arange(1, self.segments), count, replace=False)
        angles = np.zeros((self.segments, 3))
        angles[bent] = bend_angles(np.radians(self.total_deg / count), azimuth)
        scan = simulate(
            self.element,
            joint_angles_rad=angles,
            points=self.points,
            noise_m=self.noise_m,
            seed=seed,
            missing=self.faces_missing,
        )
        scan = with_holes(scan, self.holes, rng)
        if self.outliers:
            scan = among_outliers(scan, self.outliers, rng)
        if self.clutter:
            across = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            scan = beside_wall(scan, self.clutter, across, self.noise_m, rng)
        return scan


@dataclass(frozen=True)
class MapPlan:
    """A map: one row and one column of scenes crossed.

    Attributes:
        title: of the map.
        y_label, y: what the rows are, and each row's label with its scene.
        totals_deg: of the columns.
    """

    title: str
    y_label: str
    y: tuple[tuple[str, Scene], ...]
    totals_deg: tuple[float, ...] = TOTALS_DEG

    def scene(self, row: int, column: int) -> Scene:
        """Return the scene of a cell."""
        return replace(self.y[row][1], total_deg=self.totals_deg[column])

    def thinned(self, step: int) -> MapPlan:
        """Return the map with every ``step``-th row and column."""
        return replace(self, y=self.y[::step], totals_deg=self.totals_deg[::step])


def map_plans() -> tuple[MapPlan, ...]:
    """Return the maps."""
    base = Scene(0.0, points=MAP_POINTS)
    wide = (0.0, 45.0, 90.0, 180.0)
    return (
        MapPlan(
            "joints that bend",
            "joints",
            tuple((str(n or "all 9"), replace(base, joints=n)) for n in (1, 2, 4, 0)),
            (0.0, 9.0, *TOTALS_DEG[1:]),
        ),
        MapPlan(
            "noise", "noise, mm", tuple((f"{mm:g}", replace(base, noise_m=1e-3 * mm)) for mm in (0, 0.5, 1, 2, 3, 5))
        ),
        MapPlan(
            "missing faces (square box)",
            "faces missing",
            tuple((name, replace(base, profile="box", faces_missing=faces)) for name, faces in FACES.items()),
        ),
        MapPlan(
            "missing patches",
            "missing, %",
            tuple((f"{100 * h:g}", replace(base, holes=h)) for h in (0.0, 0.25, 0.5, 0.75)),
        ),
        MapPlan("outliers", "outliers, %", tuple((f"{100 * s:g}", replace(base, outliers=s)) for s in SHARES), wide),
        MapPlan(
            "wall 50 mm beside it",
            "on the wall, %",
            tuple((f"{100 * s:g}", replace(base, clutter=s)) for s in SHARES),
            wide,
        ),
        MapPlan(
            "segments",
            "segments",
            tuple((str(n), replace(base, segments=n, points=100 * max(n, 40))) for n in (5, 10, 20, 40, 60)),
        ),
    )


def bend_angles(bend_rad: float, azimuth_rad: float) -> Array:
    """Return the angles [3] about x, y, z, as R = Rz Ry Rx, of a bend about an axis across the member.

    The axis is the same in every segment's frame, so such bends stay in one plane.
    """
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(bend_rad * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0]))
    limit = np.radians(45.0)
    return np.asarray(np.clip(turn.as_euler("ZYX")[::-1], -limit, limit))


def with_holes(scan: SimulatedScan, share: float, rng: np.random.Generator) -> SimulatedScan:
    """Return the scan without ``share`` of its points, all of them in round holes."""
    kept = np.ones(len(scan.points), dtype=bool)
    wanted = round((1.0 - share) * len(kept))
    while kept.sum() > wanted:
        centre = scan.points[rng.choice(np.flatnonzero(kept))]
        hole = np.flatnonzero(kept & (np.linalg.norm(scan.points - centre, axis=1) < HOLE_M))
        kept[hole[: kept.sum() - wanted]] = False
    return _chosen(scan, kept)


def among_outliers(scan: SimulatedScan, share: float, rng: np.random.Generator) -> SimulatedScan:
    """Return the scan with points anywhere within 0.3 m of its bounding box, ``share`` of the whole."""
    count = round(len(scan.points) * share / (1.0 - share))
    low, high = scan.points.min(axis=0) - MARGIN_M, scan.points.max(axis=0) + MARGIN_M
    return _joined(scan, rng.uniform(low, high, (count, 3)))


def beside_wall(
    scan: SimulatedScan, share: float, across: Array, noise_m: float, rng: np.random.Generator
) -> SimulatedScan:
    """Return the scan with a wall 50 mm beside the element, ``share`` of the whole.

    Args:
        scan: of the element alone.
        share: of the wall's points.
        across: [3] unit normal of the plane that the element bends in, and of the wall.
        noise_m: of the wall's points.
        rng: of its points.
    """
    count = round(len(scan.points) * share / (1.0 - share))
    axes = np.stack([np.cross([0.0, 0.0, 1.0], across), [0.0, 0.0, 1.0]])
    seen = scan.points @ axes.T
    within = rng.uniform(seen.min(axis=0) - MARGIN_M, seen.max(axis=0) + MARGIN_M, (count, 2))
    offset = (scan.points @ across).max() + CLUTTER_GAP_M + noise_m * rng.standard_normal(count)
    return _joined(scan, within @ axes + offset[:, None] * across)


def _chosen(scan: SimulatedScan, rows: npt.NDArray[np.bool_]) -> SimulatedScan:
    return replace(
        scan, points=scan.points[rows], segment=scan.segment[rows], surface_normals=scan.surface_normals[rows]
    )


def _joined(scan: SimulatedScan, others: Array) -> SimulatedScan:
    """Return the scan with points of other objects, for which the simulation has no normals."""
    return replace(
        scan,
        points=np.concatenate([scan.points, others]),
        segment=np.concatenate([scan.segment, np.zeros(len(others), dtype=scan.segment.dtype)]),
        surface_normals=np.concatenate([scan.surface_normals, np.zeros_like(others)]),
    )
