"""E57: every scan of the file in global coordinates, with its station.

pye57's own read_scan refuses scans without an invalid-state field or with fields of an
extension, and holds a scan several times over; its low-level reader fills buffers of our size.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array, Chunk, posed

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = {CARTESIAN: "cartesianInvalidState", SPHERICAL: "sphericalInvalidState"}
MAGIC = b"ASTM-E57"
WHOLE = "a complete E57 file"


def read(path: Path, chunk_points: int) -> Iterator[Chunk]:
    """Yield the points of every scan, posed, with the station that saw them.

    A scan has a station when it has a pose or a grid of rows and columns; a cloud with neither
    was put together from several stations, and its origin is nobody's place.

    Raises:
        ScanError: no E57, damaged data, scans without coordinates, or pye57 isn't installed.
    """
    pye57 = _pye57(path)
    with path.open("rb") as begun:
        if begun.read(len(MAGIC)) != MAGIC:
            raise ScanError(path, f"is no E57 file: it does not begin with {MAGIC.decode()}", WHOLE)
    try:
        with pye57.E57(str(path)) as file:
            if not file.root.isDefined("data3D") or not file.scan_count:
                raise ScanError(path, "holds no scans", "at least one")
            for index in range(file.scan_count):
                yield from _scan(path, file, index, chunk_points)
    except ScanError:
        raise
    except Exception as error:
        # libe57 appends where in its source it noticed.
        reason = str(error).split("\n")[0].split(" (Error")[0]
        raise ScanError(path, f"cannot be read: {reason}", WHOLE) from error


def _scan(path: Path, file: Any, index: int, chunk_points: int) -> Iterator[Chunk]:
    """Yield one scan's points."""
    header = file.get_header(index)
    names = next((n for n in (CARTESIAN, SPHERICAL) if set(n) <= set(header.point_fields)), None)
    if names is None:
        raise ScanError(path, f"scan {index + 1} has no coordinates", "cartesian or spherical ones")
    R, t = _pose(path, header, index)
    has_station = header.has_pose() or {"rowIndex", "columnIndex"} <= set(header.point_fields)
    capacity = min(chunk_points, header.point_count)
    if not capacity:
        return
    wanted = [*names, *({INVALID[names]} & set(header.point_fields))]
    count = 0
    for values in _blocks(file, header, wanted, capacity):
        count += len(values[0])
        local = np.column_stack(values[:3])
        if len(values) == 4:
            local = local[values[3] == 0]
        if names is SPHERICAL:
            local = _cartesian(local)
        yield Chunk(posed(local, R, t), station=t if has_station else None)
    if count != header.point_count:
        raise ScanError(path, f"scan {index + 1} ends after {count} of {header.point_count} points", WHOLE)


def _blocks(file: Any, header: Any, names: list[str], capacity: int) -> Iterator[list[Array]]:
    """Yield the named fields of a scan's points, ``capacity`` rows at a time, scaled, in double precision."""
    from pye57 import libe57

    arrays = [np.empty(capacity) for _ in names]
    buffers = libe57.VectorSourceDestBuffer()
    for name, array in zip(names, arrays, strict=True):
        buffers.append(libe57.SourceDestBuffer(file.image_file, name, array, capacity, True, True))
    reader = header.points.reader(buffers)
    try:
        while count := reader.read():
            yield [array[:count] for array in arrays]
    finally:
        reader.close()


def _pose(path: Path, header: Any, index: int) -> tuple[Array, Array]:
    """Return rotation [3][3] and translation [3] of a scan; none means none (E57 8.4.3.2)."""
    if not header.has_pose():
        return np.eye(3), np.zeros(3)
    q, t = np.asarray(header.rotation, dtype=np.float64), np.asarray(header.translation, dtype=np.float64)
    # E57 asks for unit quaternions; anything near can only be one written with few digits.
    if not abs(np.linalg.norm(q) - 1) < 1e-2 or not np.isfinite(t).all():
        raise ScanError(path, f"the pose of scan {index + 1} is no pose: rotation {q}, translation {t}", WHOLE)
    w, x, y, z = q / np.linalg.norm(q)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return R, t


def _cartesian(spherical: Array) -> Array:
    """Return x, y, z of range, azimuth and elevation above the xy plane [P][3]."""
    distance, azimuth, elevation = spherical.T
    with np.errstate(over="ignore", invalid="ignore"):
        across = distance * np.cos(elevation)
        return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)])


def _pye57(path: Path) -> Any:
    try:
        import pye57
    except ImportError:
        if (platform.system(), platform.machine()) == ("Linux", "aarch64"):
            raise ScanError(path, "reading it needs pye57, which Linux on ARM lacks", "LAZ, PLY or PTX") from None
        raise ScanError(path, "reading it needs pye57", 'pip install "linear_ik[scan]"') from None
    return pye57
