"""Building scan: what a scanner measures of a whole building, written to a file as it is measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.building import Building
from linear_ik.scene import Mesh, segment_meshes
from linear_ik.virtual_scanner import edges

Array = npt.NDArray[np.float64]

RANGE_NOISE_M = 0.0015
MIXED_PIXELS = 0.01
FARTHEST_M = 80.0
RAYS_AT_ONCE = 500_000
SCALE_M = 1e-4


@dataclass(frozen=True, eq=False)
class Seen:
    """How often each segment of each member was hit.

    Attributes:
        hits: by GlobalId, [N] returns on each segment.
        points: of the whole scan.
    """

    hits: dict[str, npt.NDArray[np.int64]]
    points: int


def scan_building(plan: Building, places: Array, points: int, path: Path, seed: int = 1) -> Seen:
    """Scan a building from places [S][3] and write .las, .laz (no stations) or .e57 (stations).

    Rays of a spherical grid with noise along the ray; mixed pixels lie between a return
    and the one of a neighbouring ray behind it. About ``points`` returns in all.
    """
    scene, owners = _scene(plan)
    rng = np.random.default_rng(seed)
    # Not every ray of the sphere meets something: a coarse pass says how many do.
    share = np.mean([np.isfinite(r).mean() for p in places for _, r, _ in _sweep(scene, p, np.radians(2.0), rng)])
    step = float(np.sqrt(4 * np.pi * share * len(places) / points))
    hits = {member.guid: np.zeros(member.element.segments, dtype=np.int64) for member in plan.design.members}
    total = 0
    with _writer(path) as out:
        for place in places:
            out.station(place)
            for directions, distance, geometry in _sweep(scene, place, step, rng):
                found = np.isfinite(distance)
                for owner, number in zip(*np.unique(geometry[found], return_counts=True), strict=True):
                    if owner < len(owners):
                        guid, segment = owners[owner]
                        hits[guid][segment] += number
                measured = _measured(distance, found, rng)
                local = directions[found] * measured[:, None]
                total += len(local)
                out.write(local)
    return Seen(hits, total)


def _scene(plan: Building) -> tuple[Any, list[tuple[str, int]]]:
    import open3d as o3d

    scene, owners = o3d.t.geometry.RaycastingScene(), []
    tensor = o3d.core.Tensor.from_numpy

    def add(mesh: Mesh) -> None:
        scene.add_triangles(tensor(mesh.vertices.astype(np.float32)), tensor(mesh.triangles.astype(np.uint32)))

    for guid, bent in plan.built.items():
        R, t = bent.base_pose[:3, :3], bent.base_pose[:3, 3]
        for k, mesh in enumerate(segment_meshes(bent)):
            add(Mesh(mesh.vertices @ R.T + t, mesh.triangles))
            owners.append((guid, k))
    for mesh in plan.others:
        add(mesh)
    return scene, owners


def _sweep(scene: Any, place: Array, step: float, rng: np.random.Generator) -> Iterator[tuple[Array, Array, Array]]:
    """Yield directions [E][A][3], ranges [E][A] (inf: nothing hit) and geometries [E][A] of a whole sphere."""
    import open3d as o3d

    phase = rng.random(2)
    # Rows of equal steps; as many columns as keep the density on the sphere equal within a block of rows.
    rows = np.arange(int(np.pi / step))
    elevation = -np.pi / 2 + (rows + phase[0]) * step
    at = 0
    while at < len(rows):
        columns = max(8, int(2 * np.pi / step * np.cos(elevation[at : at + 8]).max()))
        count = max(2, min(len(rows) - at, RAYS_AT_ONCE // columns, 200))
        e = elevation[at : at + count, None]
        columns = max(8, int(2 * np.pi / step * np.cos(e).max()))
        azimuth = (np.arange(columns) + phase[1])[None, :] * (2 * np.pi / columns)
        shape = (len(e), columns)
        directions = np.stack(
            [np.cos(e) * np.cos(azimuth), np.cos(e) * np.sin(azimuth), np.broadcast_to(np.sin(e), shape)], axis=-1
        )
        rays = np.concatenate([np.broadcast_to(place, directions.shape), directions], axis=-1).astype(np.float32)
        hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))
        distance = hit["t_hit"].numpy().astype(np.float64)
        distance[distance > FARTHEST_M] = np.inf
        yield directions, distance, hit["geometry_ids"].numpy()
        at += count


def _measured(distance: Array, found: npt.NDArray[np.bool_], rng: np.random.Generator) -> Array:
    """Return the ranges of the returns, noisy, some of them mixed pixels."""
    edge, behind = edges(distance, 0.0)
    chosen = rng.choice(edge, min(len(edge), round(MIXED_PIXELS * found.sum())), replace=False)
    out = distance.copy()
    out.flat[chosen] += rng.random(len(chosen)) * (behind.flat[chosen] - distance.flat[chosen])
    return out[found] + RANGE_NOISE_M * rng.standard_normal(int(found.sum()))


class _writer:
    """A scan file that is appended to: LAS or LAZ by laspy, or E57 by pye57 with a scan a station."""

    def __init__(self, path: Path) -> None:
        self.path, self.e57 = path, path.suffix.lower() == ".e57"
        self.place, self.parts = np.zeros(3), []

    def __enter__(self) -> _writer:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.e57:
            import pye57

            self.path.unlink(missing_ok=True)
            self.file: Any = pye57.E57(str(self.path), mode="w")
        else:
            import laspy

            header = laspy.LasHeader(point_format=0, version="1.2")
            header.scales = np.full(3, SCALE_M)
            self.laspy, self.file = laspy, laspy.open(self.path, mode="w", header=header)
        return self

    def station(self, place: Array) -> None:
        self._finish()
        self.place = place

    def write(self, local: Array) -> None:
        if self.e57:
            self.parts.append(local)
            return
        record = self.laspy.ScaleAwarePointRecord.zeros(len(local), header=self.file.header)
        record.x, record.y, record.z = (local + self.place).T
        self.file.write_points(record)

    def _finish(self) -> None:
        if self.parts:
            columns = np.concatenate(self.parts).T
            data = {f"cartesian{axis}": np.ascontiguousarray(c) for axis, c in zip("XYZ", columns, strict=True)}
            self.file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=self.place)
            self.parts = []

    def __exit__(self, *_: object) -> None:
        self._finish()
        self.file.close()
