"""Scan files from independent writers, one function a format, and what reading them gives."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from linear_ik.readers import iter_scan, read_scan

pytestmark = pytest.mark.filterwarnings("error")

UTM = np.array([5e5, 5e6, 300.0])


def cloud(count=300, seed=0, offset=UTM):
    return np.random.default_rng(seed).uniform(0, 10, (count, 3)) + offset


def ply(path, points, kind="<f8", normals=None):
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[kind[0]]
    rows = points if normals is None else np.hstack([points, normals])
    names = ["x", "y", "z", "nx", "ny", "nz"][: rows.shape[1]]
    properties = "".join(f"property {'double' if kind[2] == '8' else 'float'} {n}\n" for n in names)
    header = f"ply\nformat {name} 1.0\ncomment by hand\nelement vertex {len(points)}\n{properties}end_header\n"
    path.write_bytes(header.encode() + rows.astype(kind).tobytes())


def ply_ascii(path, points):
    properties = "".join(f"property double {n}\n" for n in "xyz")
    rows = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{properties}end_header\n{rows}")


def ply_open3d(path, points):
    import open3d as o3d

    assert o3d.io.write_point_cloud(str(path), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)))


def pcd_open3d(path, points, **how):
    import open3d as o3d

    assert o3d.t.io.write_point_cloud(str(path), o3d.t.geometry.PointCloud(o3d.core.Tensor(points)), **how)


def pcd_float(path, points):
    import open3d as o3d

    local = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    assert o3d.io.write_point_cloud(str(path), local)


def pcd_ascii(path, points):
    header = f"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nDATA ascii\n"
    path.write_text(header + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()))


def xyz(path, points, delimiter=" ", head=""):
    with path.open("w") as file:
        file.write(head)
        np.savetxt(file, points, fmt="%.9f", delimiter=delimiter)


def pts(path, points):
    xyz(path, np.column_stack([points, np.ones((len(points), 4))]), head=f"{len(points)}\n")


def ptx(path, points, station=UTM, R=None):
    R = np.eye(3) if R is None else R
    local = (points - station) @ R
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = R.T, station
    with path.open("a") as file:
        np.savetxt(file, [1, len(points)], fmt="%d")
        np.savetxt(file, np.vstack([station, R.T]), fmt="%.17g")
        np.savetxt(file, matrix, fmt="%.17g")
        np.savetxt(file, np.column_stack([local, np.full(len(local), 0.5)]), fmt="%.9f")


def las(path, points, version="1.2", point_format=3):
    import laspy

    header = laspy.LasHeader(version=version, point_format=point_format)
    header.offsets, header.scales = np.floor(points.min(axis=0)), [1e-7] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.write(str(path))


def e57(path, points):
    import pye57

    local = points - UTM
    columns = {f"cartesian{axis}": local[:, i].copy() for i, axis in enumerate("XYZ")}
    columns["cartesianInvalidState"] = np.zeros(len(points), dtype=np.int8)
    with pye57.E57(str(path), mode="w") as file:
        file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=UTM)


def e57_scans(path, *scans, extensions=()):
    """Scans of any fields, without the ones that pye57's own writer always adds.

    A scan is a dictionary of columns; "pose" in it is (quaternion w x y z or None, translation or None).
    """
    import pye57
    from pye57 import libe57

    def numbers(names, values):
        node = libe57.StructureNode(image)
        for name, value in zip(names, values, strict=True):
            node.set(name, libe57.FloatNode(image, float(value)))
        return node

    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file
        for extension in extensions:
            image.extensionsAdd(*extension)
        for scan in scans:
            rotation, translation = scan.get("pose", (None, None))
            columns = {name: np.ascontiguousarray(column) for name, column in scan.items() if name != "pose"}
            node, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
            for name, column in columns.items():
                is_float = column.dtype.kind == "f"
                prototype.set(name, libe57.FloatNode(image, 0.0) if is_float else libe57.IntegerNode(image, 0, 0, 9999))
            if "pose" in scan:
                pose = libe57.StructureNode(image)
                if rotation is not None:
                    pose.set("rotation", numbers("wxyz", rotation))
                if translation is not None:
                    pose.set("translation", numbers("xyz", translation))
                node.set("pose", pose)
            points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
            node.set("points", points)
            file.data3d.append(node)
            buffers = libe57.VectorSourceDestBuffer()
            for name, column in columns.items():
                buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
            writer = points.writer(buffers)
            writer.write(len(next(iter(columns.values()))))
            writer.close()


Writer = Callable[[Path, np.ndarray], None]
WRITERS: dict[str, Writer] = {
    "ascii.ply": ply_ascii,
    "little.ply": ply,
    "big.ply": lambda path, points: ply(path, points, ">f8"),
    "open3d.ply": ply_open3d,
    "ascii.pcd": pcd_ascii,
    "binary.pcd": pcd_open3d,
    "compressed.pcd": lambda path, points: pcd_open3d(path, points, compressed=True),
    "blanks.xyz": xyz,
    "tabs.txt": lambda path, points: xyz(path, points, "\t"),
    "commas.csv": lambda path, points: xyz(path, points, ",", "x,y,z\n"),
    "semicolons.asc": lambda path, points: xyz(path, points, ";", "//X;Y;Z\n"),
    "count.pts": pts,
    "grid.ptx": ptx,
    "v12.las": las,
    "v14.las": lambda path, points: las(path, points, "1.4", 6),
    "v12.laz": las,
    "v14.laz": lambda path, points: las(path, points, "1.4", 7),
    "posed.e57": e57,
}
STATIONS = {"grid.ptx", "posed.e57"}


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """One file of every kind, by name, and the points in it."""
    folder = tmp_path_factory.mktemp("scans")
    points = cloud()
    for name, write in WRITERS.items():
        write(folder / name, points)
    return folder, points


@pytest.mark.parametrize("name", WRITERS)
def test_map_coordinates_survive(written, name, capfd):
    folder, points = written
    scan = read_scan(folder / name)
    assert scan.points.dtype == np.float64
    np.testing.assert_allclose(scan.points, points, rtol=0, atol=1e-6)
    if name in STATIONS:
        np.testing.assert_array_equal(scan.stations, [UTM])
        assert not scan.station_index.any()
    else:
        assert scan.stations is None
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", WRITERS)
def test_pieces_are_the_whole(written, name):
    folder, _ = written
    pieces = list(iter_scan(folder / name, chunk_points=7))
    assert max(map(len, pieces)) <= 7
    np.testing.assert_array_equal(np.concatenate([p.points for p in pieces]), read_scan(folder / name).points)
    for piece in pieces:
        assert (piece.stations is not None) == (name in STATIONS)


@pytest.mark.parametrize(
    "name", ["little.ply", "binary.pcd", "blanks.xyz", "count.pts", "grid.ptx", "v14.las", "v14.laz", "posed.e57"]
)
def test_pieces_take_no_more_memory_for_a_longer_file(tmp_path, name):
    import tracemalloc

    path, points = tmp_path / name, cloud(30_000)
    WRITERS[name](path, points)
    next(iter_scan(path, chunk_points=10))
    tracemalloc.start()
    assert sum(len(piece) for piece in iter_scan(path, chunk_points=1000)) == len(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < points.nbytes / 2


def test_several_files_are_one_scan(written):
    folder, points = written
    scan = read_scan(folder / "little.ply", str(folder / "v12.las"), folder / "posed.e57")
    np.testing.assert_allclose(scan.points, np.vstack([points] * 3), rtol=0, atol=1e-6)
    assert scan.stations is None


def test_stations_of_several_files_stay_apart(tmp_path):
    here, there = np.array([1.0, 2, 3]), np.array([4.0, 5, 6])
    ptx(tmp_path / "a.ptx", cloud(20), station=here)
    ptx(tmp_path / "b.ptx", cloud(30), station=there)
    scan = read_scan(tmp_path / "a.ptx", tmp_path / "b.ptx", tmp_path / "a.ptx")
    np.testing.assert_array_equal(scan.stations, [here, there])
    np.testing.assert_array_equal(scan.station_index, [0] * 20 + [1] * 30 + [0] * 20)
