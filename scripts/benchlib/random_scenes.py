"""Scenes drawn at random: member, bends, stations, noise and what stands around, all by one seed.

To see one again: ``from benchlib.random_scenes import scene``, then ``scene(17)`` says
what was drawn, and ``scene(17).stage()`` gives the design and the scan with its truth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchlib.drawn_profiles import OPEN, TYPES, drawn
from benchlib.scenes import bend_angles
from benchlib.surroundings import KINDS, around
from linear_ik import Element, Placement, PlacementTolerance, SimulatedScan, scan_virtually
from linear_ik.bending import BentElement, bend_element, rigid_motion

Array = npt.NDArray[np.float64]

BENDS = ("none", "arc", "knee", "two-axis", "small")
MAP_M = (691_603.25, 5_334_760.5, 519.75)
TOLERANCE = PlacementTolerance(0.05, 3.0)
STANDS_M = 1.6
LEAST_ANGLE = 0.9  # cosine between the view and the member: no scanner is set up to look along it
CLEAN_MM, OPEN_MM, CLUTTER_MM = 1.0, 1.5, 2.0


@dataclass(frozen=True, eq=False)
class Staged:
    """A scan ready to be fitted, and what its fit must reach.

    Attributes:
        element: the design.
        scan: with its truth.
        noise_m: of the scanner.
        limit_mm: [N+1] what each node may be off, unless the bound allows more.
        labels: what kind of scene it is, by column.
        judged: [3] the one direction that is judged, scan's coordinates, or None for all.
    """

    element: Element
    scan: SimulatedScan
    noise_m: float
    limit_mm: Array
    labels: dict[str, str]
    judged: Array | None = None


@dataclass(frozen=True)
class RandomScene:
    """What was drawn; arrays follow from the seed.

    Attributes:
        seed: of everything here, and of the scan.
        profile: its type.
        stands: "column", "beam" or "raking".
        bends: one of `BENDS`.
        stations: how many.
        noise_m: standard deviation of the ranges.
        clutter: "none" or one of `KINDS`.
        hidden: directions of the section whose faces are hidden.
        free: whether the start is displaced, by up to 50 mm and 3 degrees an axis.
        on_map: whether the member lies at map coordinates.
        points: on the member, wanted.
        told: whether the file names its stations; a fit must cope without.
    """

    seed: int
    profile: str
    stands: str
    bends: str
    stations: int
    noise_m: float
    clutter: str
    hidden: tuple[str, ...]
    free: bool
    on_map: bool
    points: int
    told: bool = True

    def stage(self) -> Staged:
        """Return the design and the scan."""
        rng = np.random.default_rng([self.seed, 5])
        element = self._element(rng)
        displacement = np.eye(4)
        if self.free:
            displacement = rigid_motion(rng.uniform(-0.048, 0.048, 3), rng.uniform(-2.9, 2.9, 3))
        angles = bent_angles(self.bends, element.segments, rng)
        bent = bend_element(element, (), angles, displacement)
        floor_m = element.placement.location[2] - (0.0 if self.stands == "column" else float(rng.uniform(1.5, 3.0)))
        normal = facing(bent, rng)
        places = stations(bent, self.stations, normal, self.clutter == "floor+wall", floor_m, rng)
        kinds = () if self.clutter == "none" else (self.clutter,)
        scan = scan_virtually(
            element,
            stations=places,
            joint_angles_rad=angles,
            displacement=displacement,
            points=self.points,
            range_noise_m=self.noise_m,
            mixed_pixels=0.01,
            others=around(bent, kinds, normal, floor_m, rng),
            seed=self.seed,
        )
        scan = without_faces(scan, bent, self.hidden)
        # An open section shows both sides of its plates to one station only by halves.
        clean = OPEN_MM if isinstance(element.profile, OPEN) and self.stations == 1 else CLEAN_MM
        limit = clean if self.clutter == "none" else CLUTTER_MM
        if not self.told:
            scan = replace(scan, stations=None, station_index=None)
        return Staged(element, scan, self.noise_m, np.full(element.segments + 1, limit), self.labels)

    @property
    def labels(self) -> dict[str, str]:
        """What kind it is, by column."""
        return {
            "profile": self.profile,
            "bends": self.bends,
            "stations": str(self.stations),
            "clutter": self.clutter,
            "faces": "half hidden" if self.hidden else "as seen",
            "start": "free" if self.free else "fixed",
            "stations named": "yes" if self.told else "no",
            "noise": "3 to 5 mm" if self.noise_m > 0.0025 else "1.5 to 2 mm",
            "stands": self.stands,
        }

    def _element(self, rng: np.random.Generator) -> Element:
        profile = drawn(self.profile, rng)
        size = float(np.ptp(profile.outline(), axis=0).max())
        length = float(np.clip(rng.uniform(10, 25) * size, 2.0, 6.0))
        segments = int(np.clip(round(length / rng.uniform(0.2, 0.4)), 6, 20))
        azimuth, slope = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(25, 65))
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        axis = {
            "column": np.array([0.0, 0.0, 1.0]),
            "beam": level,
            "raking": np.cos(slope) * level + np.array([0.0, 0.0, np.sin(slope)]),
        }[self.stands]
        turned = np.radians(rng.choice([0.0, 90.0, 180.0, 270.0]) + rng.uniform(-10, 10))
        across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        reference = np.cos(turned) * across + np.sin(turned) * np.cross(axis, across)
        location = np.array(MAP_M) if self.on_map else rng.uniform(-2.0, 2.0, 3)
        return Element(
            f"scene {self.seed}",
            profile,
            length,
            segments,
            Placement(tuple(location.tolist()), tuple(axis.tolist()), tuple(reference.tolist())),
            start="free" if self.free else "fixed",
            placement_tolerance=TOLERANCE,
        )


def scene(seed: int) -> RandomScene:
    """Return the scene of a seed."""
    rng = np.random.default_rng([seed, 4])
    count = int(rng.choice([1, 2, 3], p=[0.45, 0.45, 0.1]))
    noisy = rng.random() < 0.1
    out = RandomScene(
        seed,
        profile=str(rng.choice(TYPES)),
        stands=str(rng.choice(["column", "beam", "raking"], p=[0.45, 0.45, 0.1])),
        bends=str(rng.choice(BENDS)),
        stations=count,
        noise_m=round(float(rng.uniform(0.003, 0.005) if noisy else rng.uniform(0.0015, 0.002)), 5),
        clutter=str(rng.choice(["none", *KINDS], p=[0.4, 0.15, 0.15, 0.15, 0.15])),
        hidden=(),
        free=bool(rng.random() < 0.3),
        on_map=bool(rng.random() < 0.25),
        points=int(rng.integers(6_000, 10_001)),
    )
    # One station hides half of the faces by itself.
    if count > 1 and rng.random() < 0.3:
        pairs = [("+x", "+y"), ("+y", "-x"), ("-x", "-y"), ("-y", "+x")]
        out = replace(out, hidden=pairs[int(rng.integers(4))])
    return replace(out, told=bool(rng.random() < 0.5))


def bent_angles(kind: str, segments: int, rng: np.random.Generator, most_deg: float = 45.0) -> Array:
    """Return joint angles [N][3] about x, y, z of one of `BENDS`; the first joint stays straight."""
    angles = np.zeros((segments, 3))
    azimuth = rng.uniform(0, 2 * np.pi)
    if kind == "arc":
        total = np.radians(rng.uniform(5.0, 2.0 * most_deg))
        angles[1:] = bend_angles(total / (segments - 1), azimuth)
    elif kind == "knee":
        angles[rng.integers(1, segments)] = bend_angles(np.radians(rng.uniform(5.0, most_deg)), azimuth)
    elif kind == "two-axis":
        first, second = rng.choice(np.arange(1, segments), 2, replace=False)
        for joint, turn in ((first, 0.0), (second, np.pi / 2)):
            angles[joint] = bend_angles(np.radians(rng.uniform(3.0, 30.0)), azimuth + turn)
    elif kind == "small":
        sd = np.radians(rng.uniform(0.3, 1.5))
        angles[1:, :2] = np.clip(sd * rng.standard_normal((segments - 1, 2)), -0.2, 0.2)
    return angles


def facing(bent: BentElement, rng: np.random.Generator) -> Array:
    """Return a horizontal direction [3] across the member: from a wall behind it to the scanner."""
    chord = bent.nodes_m[-1] - bent.nodes_m[0]
    level = np.array([chord[0], chord[1], 0.0])
    if np.linalg.norm(level) < 0.3 * np.linalg.norm(chord):
        azimuth = rng.uniform(0, 2 * np.pi)
        return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    across = np.cross([0.0, 0.0, 1.0], level / np.linalg.norm(level))
    return np.asarray(across * rng.choice([-1.0, 1.0]))


def stations(
    bent: BentElement, count: int, normal: Array, before_wall: bool, floor_m: float, rng: np.random.Generator
) -> Array:
    """Return scanner positions [S][3], 3 to 12 m away, not along the member, all before a wall."""
    centre = bent.nodes_m.mean(axis=0)
    chord = bent.nodes_m[-1] - bent.nodes_m[0]
    chord = chord / np.linalg.norm(chord)
    ahead = float(np.arctan2(normal[1], normal[0]))
    spread = np.radians(60.0) if before_wall else np.pi
    out: list[Array] = []
    azimuths: list[float] = []
    while len(out) < count:
        azimuth = ahead + rng.uniform(-spread, spread)
        away = 3.0 * 4.0 ** rng.random()
        place = np.array(
            [centre[0] + away * np.cos(azimuth), centre[1] + away * np.sin(azimuth), floor_m + rng.uniform(1.3, 2.0)]
        )
        view = (place - centre) / np.linalg.norm(place - centre)
        apart = [abs((azimuth - a + np.pi) % (2 * np.pi) - np.pi) for a in azimuths]
        if abs(view @ chord) < LEAST_ANGLE and all(a > np.radians(40.0) for a in apart):
            out.append(place)
            azimuths.append(azimuth)
    return np.array(out)


def without_faces(scan: SimulatedScan, bent: BentElement, hidden: tuple[str, ...]) -> SimulatedScan:
    """Return the scan without what lies on faces of some directions of the section."""
    if not hidden:
        return scan
    axes = bent.base_pose[:3, :3] @ bent.T_base_segment[:, :3, :3]
    of = np.maximum(scan.segment - 1, 0)
    across = np.einsum("pji,pj->pi", axes[of], scan.surface_normals)
    gone = np.zeros(len(of), dtype=bool)
    for name in hidden:
        gone |= (1.0 if name[0] == "+" else -1.0) * across[:, "xyz".index(name[1])] > np.cos(np.pi / 4) - 1e-9
    kept = ~(gone & scan.on_element)
    assert scan.station_index is not None
    return replace(
        scan,
        points=scan.points[kept],
        station_index=scan.station_index[kept],
        segment=scan.segment[kept],
        surface_normals=scan.surface_normals[kept],
    )
