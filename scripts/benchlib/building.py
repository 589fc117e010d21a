"""Building: a steel frame with a pipe run, bent at random, as design and as built."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from linear_ik.bending import BentElement, bend_element, rigid_motion
from linear_ik.design_model import DesignModel, Member, Obstacle
from linear_ik.element import Element, Placement
from linear_ik.profile import CircleHollow, IShape, Profile
from linear_ik.scene import Mesh, box_mesh, floor, wall

Array = npt.NDArray[np.float64]

BAY_X_M, BAY_Y_M, STOREY_M = 6.0, 5.0, 3.6
PLATE_M = 0.02
COLUMN = IShape(0.24, 0.24, 0.010, 0.017)  # HEB 240
BEAM_X = IShape(0.15, 0.30, 0.0071, 0.0107)  # IPE 300
BEAM_Y = IShape(0.135, 0.27, 0.0066, 0.0102)  # IPE 270
PIPE = CircleHollow(0.0841, 0.0045)  # DN 150
PIPE_PITCH_M = 0.24
PIPE_BELOW_M = 0.75
NAMES: dict[Profile, str] = {COLUMN: "HEB240", BEAM_X: "IPE300", BEAM_Y: "IPE270", PIPE: "DN150"}
SHIFT_SD_M = 0.006
BOW_SHARE = (1 / 600, 1 / 120)  # of the length
KINKED_SHARE = 0.1
KINK_DEG = (1.5, 4.0)
FLOOR_BELOW_M = 0.3


@dataclass(frozen=True, eq=False)
class Building:
    """A design, and what stands there in its place.

    Attributes:
        design: members, plates and slabs as designed.
        built: by GlobalId, each member as it really is.
        others: meshes that are there too: plates, slabs, floor, walls.
        size_m: [3] of the frame.
        start_m: [3] where it starts.
    """

    design: DesignModel
    built: dict[str, BentElement]
    others: tuple[Mesh, ...]
    size_m: Array
    start_m: Array = field(default_factory=lambda: np.zeros(3))


def building(bays_x: int = 2, bays_y: int = 1, storeys: int = 2, pipes: int = 4, seed: int = 1) -> Building:
    """Return a frame of bays of 6 x 5 m and storeys of 3.6 m, ``pipes`` pipes along x below each storey's beams.

    Beams end at end plates before the columns' flanges, or run between them to the web
    (the coped kind); every other bay of a storey carries a slab on its beams.
    """
    rng = np.random.default_rng(seed)
    members, plates = [], []
    for storey in range(storeys):
        base = storey * STOREY_M
        for i, j in np.ndindex(bays_x + 1, bays_y + 1):
            foot = np.array([i * BAY_X_M, j * BAY_Y_M, base])
            plates.append(("IfcPlate", box_mesh(foot + [0, 0, PLATE_M / 2], (0.35, 0.35, PLATE_M))))
            members.append(("IfcColumn", COLUMN, foot + [0, 0, PLATE_M], foot + [0, 0, STOREY_M], (0, 1, 0)))
        for kind, profile, start, end in _beams(bays_x, bays_y, base):
            members.append((kind, profile, start, end, None))
            if profile is BEAM_X:
                for at, inwards in ((start, -1), (end, 1)):
                    centre = at + np.array([inwards * PLATE_M / 2, 0, 0])
                    plates.append(("IfcPlate", box_mesh(centre, (PLATE_M, 0.17, 0.34))))
        level = base + STOREY_M - 0.1
        for i, j in np.ndindex(bays_x, bays_y):
            if (i + j) % 2 == 0:
                centre = np.array([(i + 0.5) * BAY_X_M, (j + 0.5) * BAY_Y_M, level + 0.08])
                plates.append(("IfcSlab", box_mesh(centre, (BAY_X_M - 0.3, BAY_Y_M - 0.3, 0.16))))
        for i, p in np.ndindex(bays_x, pipes):
            y, z = 1.2 + p * PIPE_PITCH_M, base + STOREY_M - PIPE_BELOW_M
            start, end = np.array([i * BAY_X_M + 0.01, y, z]), np.array([(i + 1) * BAY_X_M - 0.01, y, z])
            members.append(("IfcPipeSegment", PIPE, start, end, None))
    return _finished(members, plates, np.array([bays_x * BAY_X_M, bays_y * BAY_Y_M, storeys * STOREY_M]), rng)


def bays_for(elements: int) -> tuple[int, int, int]:
    """Return bays in x and y and storeys of a building of at least so many elements, with four pipes a bay."""
    n, storeys = 1, 2
    while count(bays := (n, max(1, n // 2), storeys)) < elements:
        n += 1
    return bays


def count(bays: tuple[int, int, int], pipes: int = 4) -> int:
    """Return how many members a building has."""
    x, y, storeys = bays
    return storeys * ((x + 1) * (y + 1) + x * (y + 1) + y * (x + 1) + pipes * x)


def stations(plan: Building, wanted: int = 4) -> Array:
    """Return scanner positions [S][3]: spread over the plan, in turn on each storey."""
    width, depth, height = plan.size_m
    across = max(1, round(np.sqrt(wanted * width / max(depth, 1e-9) / 1.0)))
    across = min(across, wanted)
    rows = -(-wanted // across)
    out = []
    for s in range(wanted):
        x = (s % across + 0.5) / across * width + 0.7
        y = (s // across + 0.5) / rows * depth + 0.45
        out.append((x, y, 1.7 + STOREY_M * (s % max(1, round(height / STOREY_M)))))
    return plan.start_m + np.array(out)


def built_from(model: DesignModel, seed: int = 1) -> Building:
    """Return a building that stands to a design as `building` does: its members bent, the rest 4 mm off, a floor.

    Raises:
        SettingsError: a member that cannot bend so within its joint limits.
    """
    rng = np.random.default_rng(seed)
    built = {member.guid: bent_at_random(member.element, rng) for member in model.members}
    others = [Mesh(o.vertices_m + 0.004 * rng.standard_normal(3), o.triangles) for o in model.obstacles]
    nodes = np.concatenate([bent.nodes_m for bent in built.values()])
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    middle, reach = (low + high) / 2, float((high - low)[:2].max()) + 12.0
    others.append(floor((middle[0], middle[1], low[2] - FLOOR_BELOW_M), reach))
    return Building(model, built, tuple(others), high - low, low)


def _beams(bays_x: int, bays_y: int, base: float) -> Iterator[tuple[str, Profile, Array, Array]]:
    top = base + STOREY_M - 0.1
    flange = COLUMN.overall_depth / 2 + PLATE_M
    for i, j in np.ndindex(bays_x, bays_y + 1):
        z = top - BEAM_X.overall_depth / 2
        start = np.array([i * BAY_X_M + flange, j * BAY_Y_M, z])
        yield "IfcBeam", BEAM_X, start, start + [BAY_X_M - 2 * flange, 0, 0]
    for i, j in np.ndindex(bays_x + 1, bays_y):
        z, gap = top - BEAM_Y.overall_depth / 2, 0.03
        start = np.array([i * BAY_X_M, j * BAY_Y_M + gap, z])
        yield "IfcBeam", BEAM_Y, start, start + [0, BAY_Y_M - 2 * gap, 0]


def _finished(members: Sequence[tuple], plates: Sequence[tuple], size_m: Array, rng: np.random.Generator) -> Building:
    designed, built, obstacles, others = [], {}, [], []
    for number, (kind, profile, start, end, ref) in enumerate(members):
        axis = np.subtract(end, start)
        # Beams and pipes stand upright: local X is horizontal, so that the depth is vertical.
        ref = ref or tuple(np.cross((0.0, 0.0, 1.0), axis))
        element = Element(
            f"{kind} {number}",
            profile,
            float(np.linalg.norm(axis)),
            placement=Placement(tuple(start), tuple(axis), tuple(ref)),
            start="free",
        )
        guid = global_id(f"member {number}")
        designed.append(Member(guid, kind, element.name, f"{kind[3]}{number}", NAMES[profile], element))
        built[guid] = bent_at_random(element, rng)
    for number, (kind, mesh) in enumerate(plates):
        obstacles.append(Obstacle(global_id(f"plate {number}"), kind, mesh.vertices, mesh.triangles))
        others.append(Mesh(mesh.vertices + 0.004 * rng.standard_normal(3), mesh.triangles))
    middle = size_m / 2
    reach = float(size_m[:2].max()) + 12.0
    others += [floor((middle[0], middle[1], 0.0), reach), wall((middle[0], size_m[1] + 0.6, 0.0), (0, -1, 0), reach)]
    design = DesignModel("frame", "IFC4", 1.0, tuple(designed), (), tuple(obstacles))
    return Building(design, built, tuple(others), size_m)


def bent_at_random(element: Element, rng: np.random.Generator) -> BentElement:
    """Return a member shifted at both ends, bowed in both planes, now and then with a kink."""
    n, length = element.segments, element.length_m
    ends = SHIFT_SD_M * rng.standard_normal((2, 3))
    bow = length * rng.uniform(*BOW_SHARE, 2) * rng.choice((-1, 1), 2) * (0.3, 1.0)
    middle = (np.arange(n) + 0.5) / n
    # Slopes of a line from end to end with a half wave of sine on it.
    slope = (ends[1, :2] - ends[0, :2]) / length + np.pi / length * np.cos(np.pi * middle)[:, None] * bow
    if rng.random() < KINKED_SHARE and n > 3:
        at, angle = rng.integers(2, n - 1), np.radians(rng.uniform(*KINK_DEG)) * rng.choice((-1, 1))
        along = (np.arange(n) >= at) - (n - at) / n
        slope[:, rng.integers(2)] += np.tan(angle) * along
    tilt = np.arctan(slope)
    turn = np.diff(tilt, axis=0, prepend=np.zeros((1, 2)))
    angles = np.column_stack([-turn[:, 1], turn[:, 0], np.zeros(n)])
    return bend_element(
        element, joint_angles_rad=element.design.angles_rad + angles, displacement=rigid_motion(tuple(ends[0]))
    )


def global_id(text: str) -> str:
    """Return a GlobalId of IFC's alphabet, 22 characters, the same for the same text."""
    alphabet = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$"
    number = int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big")
    digits = [alphabet[(number >> (6 * k)) & 63] for k in range(22)]
    return "".join(reversed(digits))
