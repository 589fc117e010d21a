"""The clouds of `bench_peers` and `bench_scaling`."""

from __future__ import annotations

from dataclasses import dataclass

from benchlib.cases import BEAM, LENGTH_M, NOISE_M, SEGMENTS, named
from benchlib.methods.common import Task
from benchlib.scenes import Scene
from linear_ik import Element, simulate

MODERATE, HALF, WALL = "moderate", "half", "wall"
WALL_SHARE = 0.3


@dataclass(frozen=True)
class Cloud:
    """What is scanned.

    Attributes:
        name: for --clouds and the baseline.
        title: for people.
        searched: whether the default has to search there.
        about: what it is made of.
    """

    name: str
    title: str
    searched: bool
    about: str


CLOUDS = (
    Cloud(
        MODERATE,
        "22.5° at segment 8",
        False,
        "the paper's case 1b: rectangle 0.1 x 0.3 m, 2.5 m long, 10 segments, 22.5 degrees about x at segment 8",
    ),
    Cloud(HALF, "half the faces missing", True, "the paper's case 4c: the same bend, faces +x and +y not scanned"),
    Cloud(
        WALL,
        "90° arc beside a wall",
        True,
        f"the same beam bent by 90 degrees over nine joints, in a plane of random azimuth; {100 * WALL_SHARE:g} % of "
        "the points on a wall 50 mm beside it",
    ),
)


def task(points: int, seed: int, segments: int = SEGMENTS, length_m: float = LENGTH_M) -> Task:
    """Return the beam 0.1 x 0.3 m, bent about x by 22.5 degrees at its eighth segment of ten, or as far along."""
    element = Element("beam", BEAM, length_m, segments)
    bends = (f"{max(1, round(0.8 * segments))}:x:22.5",)
    return Task.of(element, simulate(element, bends=bends, points=points, noise_m=NOISE_M, seed=seed))


def task_of(cloud: str, points: int, seed: int) -> Task:
    """Return the task of a cloud by its name."""
    if cloud == HALF:
        case = named("4c")
        return Task.of(case.element, case.scan(seed, points))
    if cloud == WALL:
        scene = Scene(90.0, points=round((1.0 - WALL_SHARE) * points), clutter=WALL_SHARE)
        return Task.of(scene.element, scene.scan(seed))
    return task(points, seed)


def clouds_named(names: str | None) -> list[Cloud]:
    """Return the clouds of some names, by commas; all when None.

    Raises:
        ValueError: a name is unknown.
    """
    known = {c.name: c for c in CLOUDS}
    asked = list(known) if names is None else [name.strip() for name in names.split(",")]
    unknown = [name for name in asked if name not in known]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: expected some of {', '.join(known)}")
    return [known[name] for name in asked]
