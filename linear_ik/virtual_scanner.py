"""Virtual scanner: what a laser scanner would measure of a bent element among other things.

Rays of a spherical grid from each station, the first surface each one meets, noise along
the ray, and mixed pixels: returns at the edge of an object that lie between it and what
is behind. Open3D's ray casting is single precision, so all of it happens in the
element's own frame; the scan's coordinates come back in double precision at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bending import Bend, BentElement, bend_element, check_array, check_setting, check_whole
from linear_ik.element import Element
from linear_ik.errors import SettingsError
from linear_ik.scene import Mesh, as_mesh, is_inside, segment_meshes
from linear_ik.simulate import MIXED_PIXEL, MOST_POINTS, OTHER_OBJECT, SimulatedScan

Array = npt.NDArray[np.float64]

MOST_RAYS = 50_000_000
RAYS_AT_ONCE = 1_000_000
RAYS_TO_COUNT = 40_000  # of a first, coarse pass that finds the step for a wanted number of points
EDGE_M = 0.02  # a jump in range between neighbouring rays that a scanner's footprint would mix


@dataclass(frozen=True, eq=False)
class _Window:
    """The part of a station's sphere that holds the element.

    Attributes:
        station: [3] in the base's frame, as everything here.
        axes: [3][3] rows: towards the element, along it, across it.
        low, high: [2] azimuth and elevation about those axes, radians.
    """

    station: Array
    axes: Array
    low: Array
    high: Array

    def grid(self, step: float, phase: Array) -> tuple[Array, Array]:
        """Return azimuths [A] and elevations [E] ``step`` radians apart."""
        counts = np.maximum(1, np.ceil((self.high - self.low) / step - phase)).astype(int)
        azimuth, elevation = (lo + (np.arange(n) + p) * step for lo, n, p in zip(self.low, counts, phase, strict=True))
        return azimuth, elevation

    def rays(self, azimuth: Array, elevation: Array) -> Array:
        """Return the unit rays [...][3] at azimuths and elevations that broadcast."""
        flat = np.cos(azimuth)[..., None] * self.axes[0] + np.sin(azimuth)[..., None] * self.axes[1]
        return np.asarray(np.cos(elevation)[..., None] * flat + np.sin(elevation)[..., None] * self.axes[2])


def scan_virtually(
    element: Element,
    *,
    stations: npt.ArrayLike,
    bends: Sequence[Bend | str] = (),
    joint_angles_rad: npt.ArrayLike | None = None,
    displacement: npt.ArrayLike | None = None,
    points: int | None = None,
    angular_step_deg: float | None = None,
    range_noise_m: float = 0.0015,
    mixed_pixels: float = 0.01,
    background_m: float = 1.0,
    margin_m: float = 0.3,
    others: Sequence[object] = (),
    seed: int = 1,
) -> SimulatedScan:
    """Return the scan that a terrestrial laser scanner would take of a bent element.

    The element is a closed body here, end caps and the insides of open hollow sections
    included, mitred at its joints (see `scene.segment_meshes`).

    Args:
        element: the design.
        stations: [S][3] scanner positions in the scan's coordinates.
        bends: rotations of single joints, see `bend_element`; so for the next two.
        joint_angles_rad: [N][3] about x, y, z, in place of ``bends``.
        displacement: [4][4] T_element_base.
        points: how many points on the element to aim at (within a few per cent), all
            stations together; 10,000 when no ``angular_step_deg`` is given.
        angular_step_deg: between rays, in place of ``points``.
        range_noise_m: standard deviation along the ray.
        mixed_pixels: share of the returns that are mixed pixels. They replace returns
            of rays that have a neighbour farther away, and lie anywhere between the two
            ranges; where edges are too few there are fewer of them.
        background_m: how far behind an edge with nothing behind it the unseen background
            is taken to be, for mixed pixels only; 0 leaves those edges sharp.
        margin_m: how far around the element the scanner looks for other objects.
        others: what else is there, in the scan's coordinates: (vertices [V][3],
            triangles [T][3]) or trimesh objects; see `scene` for walls and neighbours.
        seed: of the random numbers, the grid's phase included.

    Raises:
        SettingsError: an argument out of its range, a grid of more than 50 million rays,
            or stations that see nothing.
    """
    places = check_array("stations", stations, (-1, 3))
    if not 1 <= len(places) <= 1000:
        raise SettingsError("stations", f"{len(places)} stations", "1 to 1000")
    if points is not None and angular_step_deg is not None:
        raise SettingsError("points", "given together with angular_step_deg", "one of the two")
    wanted = check_whole("points", 10_000 if points is None else points, 1, MOST_POINTS)
    range_noise_m = check_setting("range_noise_m", range_noise_m, 0.0, 10.0)
    mixed_pixels = check_setting("mixed_pixels", mixed_pixels, 0.0, 1.0)
    background_m = check_setting("background_m", background_m, 0.0, 1000.0)
    margin_m = check_setting("margin_m", margin_m, 0.0, 1000.0)
    rng = np.random.default_rng(check_whole("seed", seed, 0, 2**63))
    bent = bend_element(element, bends, joint_angles_rad, displacement)
    R, t = bent.base_pose[:3, :3], bent.base_pose[:3, 3]
    body = segment_meshes(bent)
    clutter = [as_mesh(f"others[{i}]", mesh) for i, mesh in enumerate(others)]
    local_places = (places - t) @ R
    for place, station in zip(places, local_places, strict=True):
        if is_inside(bent, station):
            raise SettingsError("stations", f"{place.tolist()} is inside the element", "positions outside its body")
    scene = _Scene(body, [Mesh((mesh.vertices - t) @ R, mesh.triangles) for mesh in clutter])
    windows = [_window(station, bent, body, margin_m) for station in local_places]
    if angular_step_deg is not None:
        step = np.radians(check_setting("angular_step_deg", angular_step_deg, 1e-4, 10.0))
    else:
        step = _step_for(wanted, scene, windows)
    rays = sum(np.prod((w.high - w.low) / step + 1) for w in windows)
    if rays > MOST_RAYS:
        raise SettingsError(
            "stations", f"a grid of {rays:.2g} rays", f"at most {MOST_RAYS:.0e}: fewer points, less margin"
        )

    parts = []
    for index, window in enumerate(windows):
        azimuth, elevation = window.grid(step, rng.random(2))
        distance, label, normals = scene.cast(window, azimuth, elevation)
        hit = np.isfinite(distance)
        returns = int(hit.sum())
        edge, behind = edges(distance, background_m)
        chosen = rng.choice(edge, min(len(edge), round(mixed_pixels * returns)), replace=False)
        front = distance.flat[chosen]
        distance.flat[chosen] = front + rng.random(len(chosen)) * (behind.flat[chosen] - front)
        label.flat[chosen] = MIXED_PIXEL
        row, column = np.nonzero(hit)
        measured = distance[hit] + range_noise_m * rng.standard_normal(returns)
        local = window.station + measured[:, None] * window.rays(azimuth[column], elevation[row])
        parts.append((local, label[hit], normals[hit], np.full(returns, index, dtype=np.int32)))
    local, segment, normals, station_index = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not len(local):
        raise SettingsError("stations", "nothing is seen from them", "positions with a view of the element")
    return SimulatedScan(
        points=local @ R.T + t,
        stations=places,
        station_index=station_index,
        segment=segment,
        surface_normals=normals @ R.T,
        joint_angles_rad=bent.joint_angles_rad,
        q=bent.q,
        nodes_m=bent.nodes_m,
        base_pose=bent.base_pose,
    )


class _Scene:
    """The element's segments and the other objects, ready for rays."""

    def __init__(self, body: list[Mesh], others: list[Mesh]) -> None:
        import open3d as o3d

        self._tensor = o3d.core.Tensor.from_numpy
        self._scene: Any = o3d.t.geometry.RaycastingScene()
        self._segments = len(body)
        for mesh in (*body, *others):
            self._scene.add_triangles(
                self._tensor(mesh.vertices.astype(np.float32)), self._tensor(mesh.triangles.astype(np.uint32))
            )

    def cast(self, window: _Window, azimuth: Array, elevation: Array) -> tuple[Array, npt.NDArray[np.int16], Array]:
        """Return ranges [E][A] (inf where nothing is hit), labels [E][A] and normals [E][A][3].

        Labels are those of `SimulatedScan.segment`.
        """
        shape = len(elevation), len(azimuth)
        distance, label, normals = np.empty(shape), np.empty(shape, dtype=np.int16), np.empty((*shape, 3))
        rows = max(1, RAYS_AT_ONCE // len(azimuth))
        for first in range(0, len(elevation), rows):
            part = slice(first, first + rows)
            directions = window.rays(azimuth[None, :], elevation[part, None])
            rays = np.concatenate([np.broadcast_to(window.station, directions.shape), directions], axis=-1)
            hit = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
            geometry, normal = hit["geometry_ids"].numpy(), hit["primitive_normals"].numpy()
            on_element = geometry < self._segments
            away = np.einsum("...i,...i->...", normal, directions) > 0
            distance[part] = hit["t_hit"].numpy()
            label[part] = np.where(on_element, geometry + 1, OTHER_OBJECT)
            # Of another object nobody says which side of its triangles is out.
            normals[part] = np.where(away[..., None], -normal, normal)
        return distance, label, normals


def _window(station: Array, bent: BentElement, body: list[Mesh], margin_m: float) -> _Window:
    """Return the part of the sphere about ``station`` [3] that holds the body and the margin."""
    corners = np.concatenate([mesh.vertices for mesh in body])
    # A straight edge bulges beyond its ends in elevation: look at its inner points too.
    inner = [mesh.vertices.reshape(2, -1, 3) for mesh in body]
    between = [a + f * (b - a) for a, b in inner for f in np.linspace(0, 1, 9)[1:-1]]
    offsets = np.concatenate([corners, *between]) - station
    reach = np.maximum(np.linalg.norm(offsets, axis=1), 1e-9)
    towards = (offsets / reach[:, None]).mean(axis=0)
    length = np.linalg.norm(towards)
    x = towards / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    chord = bent.T_base_segment[-1, :3, 3] + bent.T_base_segment[-1, :3, 2]
    across = np.cross(x, chord)
    if np.linalg.norm(across) < 1e-6 * np.linalg.norm(chord):
        across = np.cross(x, np.eye(3)[np.abs(x).argmin()])
    z = across / np.linalg.norm(across)
    axes = np.stack([x, np.cross(z, x), z])
    seen = offsets @ axes.T
    elevation = np.arcsin(np.clip(seen[:, 2] / reach, -1, 1))
    azimuth = np.arctan2(seen[:, 1], seen[:, 0])
    slack = np.arcsin(np.minimum(1, margin_m / reach))
    wide = np.arcsin(np.minimum(1, np.sin(slack) / np.maximum(np.cos(elevation), 1e-9)))
    low = np.array([(azimuth - wide).min(), (elevation - slack).min()])
    high = np.array([(azimuth + wide).max(), (elevation + slack).max()])
    whole = np.array([np.pi, np.pi / 2])
    return _Window(station, axes, np.clip(low, -whole, whole), np.clip(high, -whole, whole))


def _step_for(points: int, scene: _Scene, windows: list[_Window]) -> float:
    """Return the step of the rays, in radians, that puts about ``points`` on the element."""
    solid = 0.0
    for window in windows:
        step = float(np.sqrt(np.prod(window.high - window.low) / RAYS_TO_COUNT))
        distance, label, _ = scene.cast(window, *window.grid(step, np.array([0.5, 0.5])))
        solid += step**2 * np.count_nonzero((label > 0) & np.isfinite(distance))
    if not solid > 0:
        raise SettingsError("stations", "none of them sees the element", "positions with a view of the element")
    return float(np.sqrt(solid / points))


def edges(distance: Array, background_m: float) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the flat indices of rays at the edge of something, and what is behind each ray.

    Args:
        distance: [E][A] ranges, inf where nothing was hit.
        background_m: what lies behind an edge with nothing behind it; 0 for nothing.

    Returns:
        Indices of rays with a neighbour farther away, and the ranges [E][A] there.
    """
    padded = np.pad(distance, 2, mode="edge")
    rows, columns = distance.shape
    behind = np.full_like(distance, -np.inf)
    silhouette = np.zeros(distance.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            opposite, near, next_to_it = (
                padded[2 + n * down : 2 + n * down + rows, 2 + n * right : 2 + n * right + columns] for n in (-1, 1, 2)
            )
            # A face seen at a grazing angle falls away as steeply before or after: no edge.
            slopes = np.abs([distance - opposite, next_to_it - near])
            slope = np.where(np.isfinite(slopes), slopes, 0.0).max(axis=0)
            jump = np.isfinite(near) & (near - distance > EDGE_M + 2 * slope)
            behind = np.where(jump, np.maximum(behind, near), behind)
            silhouette |= np.isinf(near)
    if background_m:
        behind = np.where(silhouette & np.isinf(behind), distance + background_m, behind)
    return np.flatnonzero(np.isfinite(behind) & np.isfinite(distance)), behind
