"""Named scenes: what a captured scan does to a fit, one thing at a time.

Stations, azimuths and sides are drawn by the seed; bends and profiles take turns with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from benchlib.drawn_profiles import OPEN, TYPES
from benchlib.random_scenes import CLEAN_MM, CLUTTER_MM, OPEN_MM, Staged, facing, stations
from benchlib.scenes import among_outliers, bend_angles
from benchlib.surroundings import around
from linear_ik import (
    Circle,
    CircleHollow,
    Element,
    IShape,
    LShape,
    Placement,
    Polygon,
    Profile,
    Rectangle,
    RectangleHollow,
    SimulatedScan,
    TShape,
    UShape,
    scan_virtually,
    simulate,
)
from linear_ik.bending import bend_element

Array = npt.NDArray[np.float64]

PROFILES: dict[str, Profile] = {
    "rectangle": Rectangle(0.1, 0.3),
    "rectangle_hollow": RectangleHollow(0.2, 0.2, 0.01),
    "circle": Circle(0.15),
    "circle_hollow": CircleHollow(0.08, 0.006),
    "i_shape": IShape(0.3, 0.3, 0.011, 0.019),
    "l_shape": LShape(0.15, 0.1, 0.012),
    "u_shape": UShape(0.3, 0.1, 0.01, 0.016),
    "t_shape": TShape(0.14, 0.14, 0.015, 0.015),
    "polygon": Polygon([[-0.1, -0.1], [0.1, -0.1], [0.14, 0.0], [0.05, 0.12], [-0.08, 0.1]]),
}
LENGTH_M, SEGMENTS, POINTS = 3.0, 10, 10_000
NOISES_M = (0.0015, 0.00175, 0.002)
TURNS_DEG = (0.0, 9.0, 22.5, 45.0)
GAP_MM = 12.0
SAG_M, SAG_LENGTH_M, SAG_SEGMENTS, FINER = 0.040, 5.0, 20, 10
CLUTTER = {
    "floor": ("floor",),
    "wall": ("wall",),
    "neighbour at 50 mm": ("neighbour",),
    "bracket": ("bracket",),
    "cable": ("cable",),
    "floor, wall, neighbour, bracket and cable": ("floor", "wall", "neighbour", "bracket", "cable"),
}


def named_scene(name: str, seed: int) -> Staged:
    """Return a scene by its name and seed.

    Raises:
        KeyError: there is none of that name.
    """
    return CASES[name](seed)


def scanned(
    name: str,
    profile: str,
    seed: int,
    count: int,
    bend_deg: float,
    kinds: tuple[str, ...] = (),
) -> Staged:
    """Return a member with one knee, scanned virtually from some stations among other things."""
    rng = np.random.default_rng([seed, 6])
    stands = seed % 2 == 1
    azimuth = rng.uniform(0, 2 * np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    # Turned at random: face-on is as likely as any other view.
    placement = Placement(
        (0.0, 0.0, 0.0 if stands else 2.5),
        (0.0, 0.0, 1.0) if stands else tuple(level.tolist()),
        tuple(level.tolist()) if stands else tuple((rng.standard_normal(3) + [0.0, 0.0, 0.5]).tolist()),
    )
    element = Element(name, PROFILES[profile], LENGTH_M, SEGMENTS, placement)
    angles = np.zeros((SEGMENTS, 3))
    angles[rng.integers(2, SEGMENTS)] = bend_angles(np.radians(bend_deg), rng.uniform(0, 2 * np.pi))
    bent = bend_element(element, (), angles)
    noise_m = NOISES_M[seed % len(NOISES_M)]
    normal = facing(bent, rng)
    places = stations(bent, count, normal, "wall" in kinds, 0.0, rng)
    scan = scan_virtually(
        element,
        stations=places,
        joint_angles_rad=angles,
        points=POINTS,
        range_noise_m=noise_m,
        mixed_pixels=0.01,
        others=around(bent, kinds, normal, 0.0, rng),
        seed=seed,
    )
    clean = OPEN_MM if isinstance(element.profile, OPEN) and count == 1 else CLEAN_MM
    labels = {"profile": profile, "bend": f"{bend_deg:g}", "stations": str(count)}
    return staged(element, scan, noise_m, CLUTTER_MM if kinds else clean, labels)


def from_stations(profile: str, count: int, seed: int) -> Staged:
    """Return a clean scan of one profile from one or two stations."""
    return scanned(profile, profile, seed, count, TURNS_DEG[seed % len(TURNS_DEG)])


def among(name: str, seed: int) -> Staged:
    """Return a scan among other things; profiles and bends take turns."""
    return scanned(name, TYPES[seed % len(TYPES)], seed, 1 + seed % 2, (9.0, 22.5, 45.0)[seed % 3], CLUTTER[name])


def half_hidden(bend_deg: float, seed: int) -> Staged:
    """Return a complete cloud less two adjacent sides, without normals."""
    profile = ("rectangle", "rectangle_hollow", "i_shape", "t_shape")[seed % 4]
    element = Element("half", PROFILES[profile], LENGTH_M, SEGMENTS)
    rng = np.random.default_rng([seed, 7])
    angles = np.zeros((SEGMENTS, 3))
    angles[rng.integers(2, SEGMENTS)] = bend_angles(np.radians(bend_deg), rng.uniform(0, 2 * np.pi))
    missing = (("+x", "+y"), ("+y", "-x"), ("-x", "-y"), ("-y", "+x"))[seed // 4 % 4]
    noise_m = NOISES_M[seed % len(NOISES_M)]
    scan = simulate(element, joint_angles_rad=angles, points=POINTS, noise_m=noise_m, seed=seed, missing=missing)
    return staged(element, scan, noise_m, CLEAN_MM, {"profile": profile, "bend": f"{bend_deg:g}"})


def one_face(seed: int) -> Staged:
    """Return one face alone; what moves along its normal is judged, and the rest must be doubted."""
    profile = ("rectangle", "rectangle_hollow")[seed % 2]
    element = Element("face", PROFILES[profile], LENGTH_M, SEGMENTS)
    rng = np.random.default_rng([seed, 8])
    angles = np.zeros((SEGMENTS, 3))
    angles[rng.integers(2, SEGMENTS), 0] = np.radians((3.0, 9.0, 22.5)[seed % 3])
    noise_m = NOISES_M[seed % len(NOISES_M)]
    scan = simulate(
        element, joint_angles_rad=angles, points=POINTS, noise_m=noise_m, seed=seed, missing=("+x", "+y", "-x")
    )
    return staged(element, scan, noise_m, CLEAN_MM, {"profile": profile}, judged=np.array([0.0, 1.0, 0.0]))


def gap(seed: int) -> Staged:
    """Return a bowed member, a fifth of its length hidden in the middle."""
    profile = TYPES[seed % len(TYPES)]
    element = Element("gap", PROFILES[profile], LENGTH_M, SEGMENTS)
    rng = np.random.default_rng([seed, 9])
    angles = np.zeros((SEGMENTS, 3))
    angles[1:] = bend_angles(np.radians(rng.uniform(3.0, 15.0)) / (SEGMENTS - 1), rng.uniform(0, 2 * np.pi))
    noise_m = NOISES_M[seed % len(NOISES_M)]
    scan = simulate(element, joint_angles_rad=angles, points=POINTS, noise_m=noise_m, seed=seed)
    kept = (scan.segment != 5) & (scan.segment != 6)
    scan = replace(
        scan, points=scan.points[kept], segment=scan.segment[kept], surface_normals=scan.surface_normals[kept]
    )
    limit = np.full(SEGMENTS + 1, CLEAN_MM)
    limit[5] = GAP_MM
    return replace(staged(element, scan, noise_m, CLEAN_MM, {"profile": profile}), limit_mm=limit)


def outliers(seed: int) -> Staged:
    """Return a complete cloud among as many points anywhere."""
    profile = TYPES[seed % len(TYPES)]
    element = Element("outliers", PROFILES[profile], LENGTH_M, SEGMENTS)
    rng = np.random.default_rng([seed, 10])
    angles = np.zeros((SEGMENTS, 3))
    angles[rng.integers(2, SEGMENTS)] = bend_angles(np.radians(22.5), rng.uniform(0, 2 * np.pi))
    noise_m = NOISES_M[seed % len(NOISES_M)]
    scan = simulate(element, joint_angles_rad=angles, points=POINTS, noise_m=noise_m, seed=seed)
    return staged(element, among_outliers(scan, 0.5, rng), noise_m, CLUTTER_MM, {"profile": profile})


def sagging(seed: int) -> Staged:
    """Return a beam clamped at both ends, which sags 40 mm over 5 m, as a smooth curve.

    The truth has ten times as many joints as the design that is fitted to it, and the
    design's nodes lie on the truth's.
    """
    rng = np.random.default_rng([seed, 11])
    profile = ("rectangle", "i_shape", "rectangle_hollow", "u_shape")[seed % 4]
    placement = Placement((0.0, 0.0, 2.5), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    element = Element("sag", PROFILES[profile], SAG_LENGTH_M, SAG_SEGMENTS, placement, end="fixed")
    fine = replace(element, segments=FINER * SAG_SEGMENTS)
    middle = (np.arange(fine.segments) + 0.5) / fine.segments
    slope = np.arctan(0.5 * SAG_M * 2 * np.pi / SAG_LENGTH_M * np.sin(2 * np.pi * middle))
    angles = np.zeros((fine.segments, 3))
    # The element's y is up or down here; a positive turn about x leans towards -y.
    angles[:, 0] = np.diff(slope, prepend=0.0)
    bent = bend_element(fine, (), angles)
    noise_m = NOISES_M[seed % len(NOISES_M)]
    scan = scan_virtually(
        fine,
        stations=stations(bent, 2, facing(bent, rng), False, 0.0, rng),
        joint_angles_rad=angles,
        points=POINTS,
        range_noise_m=noise_m,
        seed=seed,
    )
    coarse = coarser(scan, element, slope)
    return staged(element, coarse, noise_m, CLEAN_MM, {"profile": profile})


def coarser(scan: SimulatedScan, element: Element, slope: Array) -> SimulatedScan:
    """Return the scan with its truth told in the joints of the design."""
    nodes = scan.nodes_m[::FINER]
    chord = np.arcsin(np.sin(slope).reshape(-1, FINER).mean(axis=1))
    angles = np.zeros((element.segments, 3))
    angles[:, 0] = np.diff(chord, prepend=0.0)
    segment = np.where(scan.segment > 0, (scan.segment - 1) // FINER + 1, scan.segment).astype(np.int16)
    return replace(
        scan, segment=segment, joint_angles_rad=angles, q=angles[:, ::-1].ravel(), nodes_m=np.ascontiguousarray(nodes)
    )


def staged(
    element: Element,
    scan: SimulatedScan,
    noise_m: float,
    limit_mm: float,
    labels: dict[str, str],
    judged: Array | None = None,
) -> Staged:
    """Return a staged scene with one limit for every node."""
    return Staged(element, scan, noise_m, np.full(element.segments + 1, limit_mm), labels, judged)


CASES: dict[str, Callable[[int], Staged]] = {
    **{
        f"{profile}, {words}": partial(from_stations, profile, count)
        for profile in TYPES
        for count, words in ((1, "one station"), (2, "two stations"))
    },
    **{name: partial(among, name) for name in CLUTTER},
    "half the faces hidden, 22.5°": partial(half_hidden, 22.5),
    "half the faces hidden, 45°": partial(half_hidden, 45.0),
    "one face visible": one_face,
    "a fifth of the length hidden": gap,
    "sag of 40 mm over 5 m, both ends clamped": sagging,
    "half of the points outliers": outliers,
}
