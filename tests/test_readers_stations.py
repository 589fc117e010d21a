"""PTX and E57: scans of several stations, each with its pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_readers_files import UTM, cloud, e57_scans, ptx

from linear_ik.errors import ScanError
from linear_ik.readers import iter_scan, read_scan

pytestmark = pytest.mark.filterwarnings("error")

POSES = [
    (Rotation.from_euler("zyx", [0.3, -1.0, 2.0]), UTM),
    (Rotation.from_euler("zyx", [-2.3, 0.1, 0.4]), UTM + [20, -7, 1.5]),
    (Rotation.identity(), UTM + [0, 0, 50]),
]
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")


def local_columns(points, R, t):
    return dict(zip(CARTESIAN, R.inv().apply(points - t).T, strict=True))


def wxyz(R):
    return np.roll(R.as_quat(), 1)


def write_ptx(path, parts):
    for points, (R, t) in zip(parts, POSES, strict=True):
        ptx(path, points, t, R.as_matrix())


def write_e57(path, parts):
    scans = [local_columns(p, R, t) | {"pose": (wxyz(R), t)} for p, (R, t) in zip(parts, POSES, strict=True)]
    e57_scans(path, *scans)


@pytest.mark.parametrize(("name", "write"), [("a.ptx", write_ptx), ("a.e57", write_e57)])
def test_every_station_keeps_its_points(tmp_path, name, write):
    parts = [cloud(40, 1), cloud(25, 2), cloud(30, 3)]
    write(tmp_path / name, parts)
    scan = read_scan(tmp_path / name)
    np.testing.assert_allclose(scan.points, np.vstack(parts), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(scan.stations, [t for _, t in POSES])
    np.testing.assert_array_equal(scan.station_index, np.repeat([0, 1, 2], [40, 25, 30]))
    pieces = list(iter_scan(tmp_path / name, chunk_points=20))
    assert [len(piece) for piece in pieces] == [20, 20, 20, 5, 20, 10]
    np.testing.assert_array_equal([piece.stations[0] for piece in pieces], scan.stations[[0, 0, 1, 1, 2, 2]])


def test_ptx_rays_without_echo_are_no_points(tmp_path):
    points = cloud(10, offset=0)
    points[[2, 7]] = 0
    ptx(tmp_path / "a.ptx", points, np.zeros(3))
    np.testing.assert_allclose(read_scan(tmp_path / "a.ptx").points, np.delete(points, [2, 7], axis=0), atol=1e-9)


def test_ptx_without_a_position_takes_it_from_the_matrix(tmp_path):
    ptx(tmp_path / "a.ptx", cloud(10))
    lines = (tmp_path / "a.ptx").read_text().splitlines()
    lines[2] = "0 0 0"
    (tmp_path / "a.ptx").write_text("\n".join(lines))
    np.testing.assert_array_equal(read_scan(tmp_path / "a.ptx").stations, [UTM])


@pytest.mark.parametrize(
    ("line", "text", "said"),
    [
        (2, "1 2", "2 numbers"),
        (3, "1 0 zero", "'zero' is not a number"),
        (6, "nan 0 0 0", "not a number"),
        (6, "2 0 0 0", "no rotation"),
        (6, "1 0 0 5", "last column"),
        (9, "1e400 2 3 1", "not a number"),
        (12, "1 2", "2 columns"),
        (12, "", "ends after"),
    ],
)
def test_ptx_damage(tmp_path, line, text, said):
    ptx(tmp_path / "a.ptx", cloud(10))
    lines = (tmp_path / "a.ptx").read_text().splitlines()
    lines[line] = text
    (tmp_path / "a.ptx").write_text("\n".join(lines) + "\n")
    with pytest.raises(ScanError, match=said):
        read_scan(tmp_path / "a.ptx")


def test_e57_is_what_pye57_reads(tmp_path):
    import pye57

    R, t = POSES[0]
    columns = local_columns(cloud(50), R, t) | {"cartesianInvalidState": np.zeros(50, dtype=np.int8)}
    e57_scans(tmp_path / "a.e57", columns | {"pose": (wxyz(R), t)})
    with pye57.E57(str(tmp_path / "a.e57")) as file:
        own = file.read_scan(0)
    np.testing.assert_allclose(
        read_scan(tmp_path / "a.e57").points, np.column_stack([own[n] for n in CARTESIAN]), rtol=0, atol=1e-8
    )


def test_e57_fields_that_may_be_missing_or_more(tmp_path):
    points = cloud(30)
    columns = dict(zip(CARTESIAN, points.T, strict=True))
    normals = {f"nor:normal{axis}": points[:, 0] for axis in "XYZ"}
    grid = {"rowIndex": np.arange(30, dtype=np.int16), "columnIndex": np.zeros(30, dtype=np.int16)}
    extension = ("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")
    cases = {
        "plain": (columns, None),
        "normals": (columns | normals, None),
        "grid": (columns | grid, np.zeros(3)),
        "no_rotation": (columns | {"pose": (None, UTM)}, UTM),
        "no_translation": (columns | {"pose": ((1, 0, 0, 0), None)}, np.zeros(3)),
    }
    for name, (scan, station) in cases.items():
        path = tmp_path / f"{name}.e57"
        e57_scans(path, scan, extensions=[extension])
        found = read_scan(path)
        np.testing.assert_array_equal(found.points, points + (UTM if name == "no_rotation" else 0))
        if station is None:
            assert found.stations is None
        else:
            np.testing.assert_array_equal(found.stations, [station])


def test_e57_spherical(tmp_path):
    points = cloud(30, offset=-5)
    distance = np.linalg.norm(points, axis=1)
    spherical = {
        "sphericalRange": distance,
        "sphericalAzimuth": np.arctan2(points[:, 1], points[:, 0]),
        "sphericalElevation": np.arcsin(points[:, 2] / distance),
        "sphericalInvalidState": (np.arange(30) % 3).astype(np.int8),
    }
    e57_scans(tmp_path / "a.e57", spherical)
    np.testing.assert_allclose(read_scan(tmp_path / "a.e57").points, points[::3], rtol=0, atol=1e-12)


def test_e57_invalid_points_and_empty_scans_are_left_out(tmp_path):
    columns = dict(zip(CARTESIAN, cloud(31).T, strict=True))
    state = {"cartesianInvalidState": (np.arange(31) % 3).astype(np.int8)}
    nothing = {name: np.empty(0) for name in CARTESIAN}
    e57_scans(tmp_path / "a.e57", nothing | {"pose": ((1, 0, 0, 0), (9, 9, 9))}, columns | state)
    np.testing.assert_array_equal(read_scan(tmp_path / "a.e57").points, cloud(31)[::3])


@pytest.mark.parametrize(
    ("scans", "said"),
    [
        ([], "holds no scans"),
        ([{"cartesianX": np.ones(5), "intensity": np.ones(5)}], "scan 1 has no coordinates"),
        ([dict.fromkeys(CARTESIAN, np.ones(5)) | {"pose": ((0, 0, 0, 0), (0, 0, 0))}], "is no pose"),
        ([dict.fromkeys(CARTESIAN, np.ones(5)) | {"pose": ((3, 0, 0, 0), (0, 0, 0))}], "is no pose"),
        ([dict.fromkeys(CARTESIAN, np.empty(0))], "no point with finite coordinates"),
    ],
)
def test_e57_without_points(tmp_path, capfd, scans, said):
    e57_scans(tmp_path / "a.e57", *scans)
    with pytest.raises(ScanError, match=said):
        read_scan(tmp_path / "a.e57")
    assert capfd.readouterr() == ("", "")
