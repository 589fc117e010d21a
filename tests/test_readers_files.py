"""Scan files from independent writers, one function a format, and what reading them gives."""

import struct
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


@pytest.mark.parametrize(
    "write",
    [
        lambda path, points: ply(path.with_suffix(".ply"), points, "<f4"),
        lambda path, points: ply(path.with_suffix(".ply"), points, ">f4"),
        lambda path, points: pcd_float(path.with_suffix(".pcd"), points),
    ],
)
def test_single_precision_files(tmp_path, write):
    points = cloud(offset=0)
    write(tmp_path / "scan", points)
    np.testing.assert_array_equal(read_scan(*tmp_path.iterdir()).points, points.astype(np.float32))


def test_extension_in_capitals(tmp_path):
    ply(tmp_path / "SCAN.PLY", cloud(5))
    assert len(read_scan(tmp_path / "SCAN.PLY")) == 5


def test_normals_have_unit_length(tmp_path):
    import open3d as o3d

    points, normals = cloud(4), np.array([[2.0, 0, 0], [0, 0, 0], [0, 3, 4], [np.nan, 1, 0]])
    unit = [[1, 0, 0], [0, 0, 0], [0, 0.6, 0.8], [0, 0, 0]]
    ply(tmp_path / "n.ply", points, normals=normals)
    tensor = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    tensor.point.normals = o3d.core.Tensor(normals)
    o3d.t.io.write_point_cloud(str(tmp_path / "n.pcd"), tensor)
    for path in tmp_path.iterdir():
        np.testing.assert_allclose(read_scan(path).normals, unit)
    both = read_scan(tmp_path / "n.ply", tmp_path / "n.pcd")
    assert both.normals.shape == (8, 3)
    xyz(tmp_path / "n.xyz", points)
    assert read_scan(tmp_path / "n.ply", tmp_path / "n.xyz").normals is None


def test_ply_with_faces(tmp_path):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, resolution=4)
    for is_ascii in (False, True):
        path = tmp_path / f"{is_ascii}.ply"
        assert o3d.io.write_triangle_mesh(str(path), mesh, write_ascii=is_ascii)
        np.testing.assert_allclose(read_scan(path).points, np.asarray(mesh.vertices), atol=1e-5)


def test_ply_with_rows_ahead_of_the_vertices(tmp_path):
    head = "ply\nformat {} 1.0\nelement strip 2\nproperty list uchar int i\nelement vertex 2\n"
    head += "".join(f"property {t} {n}\n" for t, n in (("uchar", "red"), ("double", "X"), ("int", "y"), ("float", "z")))
    (tmp_path / "a.ply").write_text(head.format("ascii") + "end_header\n2 7 8\n0\n9 1.5 2 3\n9 4 5 6\n\n")
    strips = struct.pack(">BiiB", 2, 7, 8, 0)
    vertices = struct.pack(">BdifBdif", 9, 1.5, 2, 3, 9, 4, 5, 6)
    (tmp_path / "b.ply").write_bytes((head.format("binary_big_endian") + "end_header\n").encode() + strips + vertices)
    for path in tmp_path.iterdir():
        np.testing.assert_array_equal(read_scan(path).points, [[1.5, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    "points",
    [np.zeros((1000, 3)), np.repeat(cloud(10), 60, axis=0), cloud(2000).round(1)],
    ids=["zeros", "repeats", "lattice"],
)
def test_compressed_pcd_of_repetitive_data(tmp_path, points):
    pcd_open3d(tmp_path / "a.pcd", points, compressed=True)
    assert (tmp_path / "a.pcd").stat().st_size < points.nbytes
    np.testing.assert_array_equal(read_scan(tmp_path / "a.pcd").points, points)


def test_laz_written_to_a_pipe(written, tmp_path):
    folder, points = written
    for name in ("v12.laz", "v14.laz"):
        data = (folder / name).read_bytes()
        start = struct.unpack_from("<I", data, 96)[0]
        path = tmp_path / name
        path.write_bytes(data[:start] + b"\xff" * 8 + data[start + 8 :] + data[start : start + 8])
        np.testing.assert_allclose(read_scan(path).points, points, rtol=0, atol=1e-6)


@pytest.mark.parametrize("point_format", [0, 3, 6, 7, 8, 10])
def test_laz_with_extra_bytes_and_many_chunks(tmp_path, point_format):
    import laspy

    points = cloud(100_001, offset=0)
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.scales = [1e-6] * 3
    header.add_extra_dim(laspy.ExtraBytesParams("deviation", np.float64))
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.write(str(tmp_path / "a.laz"))
    np.testing.assert_allclose(read_scan(tmp_path / "a.laz").points, points, rtol=0, atol=1e-6)


@pytest.mark.parametrize("point_format", [3, 6])
def test_laz_chunks_of_varying_size(tmp_path, point_format):
    import laspy
    import lazrs

    points = cloud(1000, offset=0)
    las(tmp_path / "a.las", points, "1.4", point_format)
    raw = laspy.read(tmp_path / "a.las").points.array
    vlr = lazrs.LazVlr.new_for_compression(point_format, 0, True)
    start = 375 + 54 + len(vlr.record_data())
    with (tmp_path / "a.laz").open("wb") as file:
        file.write(b"\0" * start)
        compressor = lazrs.LasZipCompressor(file, vlr)
        compressor.reserve_offset_to_chunk_table()
        for part in (raw[:10], raw[10:700], raw[700:]):
            compressor.compress_many(np.frombuffer(part.tobytes(), dtype=np.uint8))
            compressor.finish_current_chunk()
        compressor.done()
        file.seek(0)
        head = bytearray((tmp_path / "a.las").read_bytes()[:375])
        struct.pack_into("<II", head, 96, start, 1)
        head[104] |= 0x80
        file.write(head)
        file.write(struct.pack("<H16sHH32s", 0, b"laszip encoded", 22204, len(vlr.record_data()), b""))
        file.write(vlr.record_data())
    np.testing.assert_allclose(read_scan(tmp_path / "a.laz").points, points, rtol=0, atol=1e-6)


def test_pcd_with_padding_and_histograms(tmp_path):
    head = "# .PCD v0.7\nVERSION .7\nFIELDS x h y z rgb\nSIZE 8 4 8 4 4\nTYPE F F F F U\nCOUNT 1 3 1 1 1\n"
    head += "WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA {}\n"
    (tmp_path / "a.pcd").write_text(head.format("ascii") + "1 7 7 7 2 3 255\n4 nan 8 8 5 6 0\n")
    body = struct.pack("<dfffdfIdfffdfI", 1, 7, 7, 7, 2, 3, 255, 4, 8, 8, 8, 5, 6, 0)
    (tmp_path / "b.pcd").write_bytes(head.format("binary").encode() + body)
    for path in tmp_path.iterdir():
        np.testing.assert_array_equal(read_scan(path).points, [[1, 2, 3], [4, 5, 6]])


def test_rows_that_are_no_points_are_dropped(tmp_path):
    points = cloud(6)
    points[1, 0], points[4, 2] = np.nan, -np.inf
    left = points[[0, 2, 3, 5]]
    for name in ("little.ply", "binary.pcd", "compressed.pcd", "blanks.xyz", "commas.csv", "count.pts"):
        WRITERS[name](tmp_path / name, points)
        np.testing.assert_allclose(read_scan(tmp_path / name).points, left, rtol=0, atol=1e-6)
