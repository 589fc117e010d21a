"""Simulator: point clouds of an element bent by known angles (paper 4.1).

Points lie on the outer lateral faces of the segments, as the paper's do: no end caps,
no insides, nothing hidden but the faces left out. `virtual_scanner` is the one that
knows what a scanner sees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.bending import Bend, bend_element, check_setting, check_whole
from linear_ik.element import Element
from linear_ik.errors import SettingsError
from linear_ik.scan import Scan
from linear_ik.surface import Surface
from linear_ik.tapered_surface import TaperedSurface, surface_of

Array = npt.NDArray[np.float64]
Layout = Literal["random", "grid"]

DIRECTIONS: dict[str, tuple[float, float]] = {"+x": (1.0, 0.0), "-x": (-1.0, 0.0), "+y": (0.0, 1.0), "-y": (0.0, -1.0)}
MOST_POINTS = 20_000_000
MIXED_PIXEL, OTHER_OBJECT = -1, 0


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedScan(Scan):
    """A scan that knows what was scanned.

    Attributes:
        segment: [P] segment each point was measured on, counted from 1; 0 on another
            object, -1 for a mixed pixel, which lies on nothing.
        surface_normals: [P][3] outward unit normal of the surface behind each point.
        joint_angles_rad: [N][3] in x, y, z order.
        q: [3N] the same as Pinocchio's configuration, (z, y, x) a segment.
        nodes_m: [N+1][3] in the scan's coordinates.
        base_pose: [4][4] T_world_base.
    """

    segment: npt.NDArray[np.int16]
    surface_normals: Array
    joint_angles_rad: Array
    q: Array
    nodes_m: Array
    base_pose: Array

    @property
    def on_element(self) -> npt.NDArray[np.bool_]:
        """[P] whether the point was measured on the element, and on it alone."""
        return self.segment > 0

    def without_truth(self) -> Scan:
        """Return what a scanner would hand over."""
        return Scan(self.points, self.normals, self.stations, self.station_index)


def simulate(
    element: Element,
    *,
    bends: Sequence[Bend | str] = (),
    points: int = 10_000,
    noise_m: float = 0.001,
    seed: int = 1,
    missing: Sequence[str] = (),
    layout: Layout = "random",
    perturbation: float = 0.1,
    joint_angles_rad: npt.ArrayLike | None = None,
    displacement: npt.ArrayLike | None = None,
) -> SimulatedScan:
    """Return a point cloud of the bent element's outer lateral faces (paper 4.1).

    Every segment gets the same number of points, the remainder spread along the element;
    of a tapered element, as many as are its share of the surface.
    A round section is sampled on its circle. The same seed gives the same bits.

    Args:
        element: the design.
        bends: rotations of single joints, see `bend_element`.
        points: number of points on the whole element, all faces present.
        noise_m: standard deviation of the Gaussian noise in each of x, y and z.
        seed: of the random numbers.
        missing: faces left out, by their outward direction in the section's own axes:
            "+x", "-x", "+y", "-y". A direction takes every edge of the outline whose
            normal is within 45 degrees of it (the flange tips and the web's side of an
            I as well as its outermost edge), of a circle the quarter around it. Their
            points are dropped, the others are the same as without ``missing``.
        layout: "random" is uniform by area; "grid" is the paper's, regular along the
            outline and the length.
        perturbation: of the grid, along the surface: the largest shift each way in
            steps of the grid, 0 to 0.5.
        joint_angles_rad: [N][3] about x, y, z, in place of ``bends``.
        displacement: [4][4] T_element_base, see `bend_element`.

    Raises:
        SettingsError: an argument out of its range, or no face left.
    """
    points = check_whole("points", points, 1, MOST_POINTS)
    noise_m = check_setting("noise_m", noise_m, 0.0, 10.0)
    perturbation = check_setting("perturbation", perturbation, 0.0, 0.5)
    if layout not in get_args(Layout):
        raise SettingsError("layout", f"{layout!r}", "one of " + ", ".join(get_args(Layout)))
    rng = np.random.default_rng(check_whole("seed", seed, 0, 2**63))
    missing = [missing] if isinstance(missing, str) else missing
    bent = bend_element(element, bends, joint_angles_rad, displacement)
    surface = surface_of(element)
    n, length = element.segments, element.segment_length_m

    stops = points * np.arange(n + 1) // n
    if isinstance(surface, TaperedSurface):
        areas = np.cumsum([0.0, *(surface.section(k).perimeter_m for k in range(n))])
        stops = np.round(points * areas / areas[-1]).astype(np.int64)
    if layout == "grid":
        s, z = _grid(surface.perimeter_m, length, np.diff(stops), perturbation, rng)
    else:
        s, z = surface.perimeter_m * rng.random(points), length * rng.random(points)
    local, facing = _on_surface(surface, s, z, stops, length)
    noise = noise_m * rng.standard_normal((points, 3))

    out, normals = np.empty_like(local), np.empty_like(local)
    for k, T in enumerate(bent.T_base_segment):
        part = slice(stops[k], stops[k + 1])
        out[part] = local[part] @ T[:3, :3].T + T[:3, 3]
        normals[part] = facing[part] @ T[:3, :3].T
    out += noise
    segment = np.repeat(np.arange(1, n + 1, dtype=np.int16), np.diff(stops))
    hidden = _facing(facing[:, :2], missing)
    if hidden is not None:
        out, normals, segment = out[~hidden], normals[~hidden], segment[~hidden]
    if not len(out):
        raise SettingsError("missing", f"{', '.join(missing)} leave no point", "at least one face that is scanned")
    R, t = bent.base_pose[:3, :3], bent.base_pose[:3, 3]
    return SimulatedScan(
        points=out @ R.T + t,
        segment=segment,
        surface_normals=normals @ R.T,
        joint_angles_rad=bent.joint_angles_rad,
        q=bent.q,
        nodes_m=bent.nodes_m,
        base_pose=bent.base_pose,
    )


def _on_surface(
    surface: Surface, s: Array, z: Array, stops: npt.NDArray[np.int64], length_m: float
) -> tuple[Array, Array]:
    """Return points [P][3] at ``s`` along the outline and ``z`` along their segment, and their normals [P][3]."""
    if isinstance(surface, TaperedSurface):
        around, along = s / surface.perimeter_m, z / length_m
        parts = [slice(*stops[k : k + 2]) for k in range(len(stops) - 1)]
        pieces = [surface.on_segment(k, around[part], along[part]) for k, part in enumerate(parts)]
        local, normals = (np.concatenate(column) for column in zip(*pieces, strict=True))
        return local, normals
    xy, across = _on_outline(surface, s)
    return np.column_stack([xy, z]), np.column_stack([across, np.zeros(len(s))])


def _on_outline(surface: Surface, s: Array) -> tuple[Array, Array]:
    """Return points [P][2] at ``s`` [P] metres along the outline, and their normals [P][2]."""
    if surface.radius_m is not None:
        angle = s / surface.radius_m
        normals = np.column_stack([np.cos(angle), np.sin(angle)])
        return surface.radius_m * normals, normals
    stops = np.cumsum(surface.widths_m)
    edge = np.minimum(np.searchsorted(stops, s, side="right"), len(stops) - 1)
    along = s - (stops - surface.widths_m)[edge]
    return surface.corners[edge] + along[:, None] * surface.tangents[edge], surface.normals[edge]


def _grid(
    perimeter: float, length: float, counts: npt.NDArray[np.int64], perturbation: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return a perturbed grid on each segment, unrolled: along the outline and the length.

    Rows of equal spacing, and in each as many points as make ``counts`` exactly: the
    rows of a count without divisors differ by one point.
    """
    s, z = [], []
    for count in counts:
        if not count:
            continue
        rows = min(int(count), max(1, round(math.sqrt(count * length / perimeter))))
        stops = count * np.arange(rows + 1) // rows
        row = np.repeat(np.arange(rows), np.diff(stops))
        in_row = np.diff(stops)[row]
        shift = perturbation * rng.uniform(-1.0, 1.0, (2, count))
        s.append(perimeter * ((np.arange(count) - stops[row] + 0.5 + shift[0]) / in_row))
        z.append(length * ((row + 0.5 + shift[1]) / rows))
    return np.concatenate(s), np.concatenate(z)


def _facing(normals: Array, missing: Sequence[str]) -> npt.NDArray[np.bool_] | None:
    """Return which of the normals [P][2] look in one of the directions ``missing``."""
    hidden = None
    for name in missing:
        if name not in DIRECTIONS:
            raise SettingsError("missing", f"{name!r}", "faces by outward direction: " + ", ".join(DIRECTIONS))
        faces = normals @ np.array(DIRECTIONS[name]) > math.cos(math.radians(45)) - 1e-9
        hidden = faces if hidden is None else hidden | faces
    return hidden
