"""What the formats allow beyond the usual: normals, faces, padding, extra bytes, odd chunks."""

import struct

import numpy as np
import pytest
from test_readers_files import WRITERS, cloud, las, pcd_float, pcd_open3d, ply, written, xyz

from linear_ik.errors import ScanError
from linear_ik.readers import iter_scan, read_scan

__all__ = ["written"]
pytestmark = pytest.mark.filterwarnings("error")


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


@pytest.mark.parametrize(("suffix", "point_format"), [(".las", 3), (".las", 6), (".laz", 6)])
def test_what_a_las_file_withholds_or_calls_noise_is_left_out(tmp_path, suffix, point_format):
    import laspy

    points = cloud(7, offset=0)
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.scales = [1e-6] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.withheld[[1, 4]] = 1
    data.classification[:] = [0, 1, 7, 6, 18, 2, 17]
    path = tmp_path / f"a{suffix}"
    data.write(str(path))
    scan = read_scan(path)
    np.testing.assert_allclose(scan.points, points[[0, 3, 5, 6]], rtol=0, atol=1e-6)
    assert scan.left_out == 3
    data.withheld[:] = 1
    data.write(str(path))
    with pytest.raises(ScanError, match=r"a\.la.: no point with .* neither withheld nor noise"):
        read_scan(path)


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
        assert read_scan(tmp_path / name).left_out == 2


@pytest.mark.parametrize("rows", [[0, 1, 2], [3, 4, 5], [0, 2, 3, 5], [0, 1, 2, 3, 4]], ids=str)
def test_points_that_are_left_out_are_counted_wherever_they_stand(tmp_path, rows):
    points = cloud(6)
    points[rows] = np.nan
    WRITERS["blanks.xyz"](tmp_path / "a.xyz", points)
    for size in (1, 2, 250_000):
        pieces = list(iter_scan(tmp_path / "a.xyz", size))
        assert sum(piece.left_out for piece in pieces) == len(rows)
        np.testing.assert_allclose(np.concatenate([p.points for p in pieces]), np.delete(points, rows, axis=0))
