"""Files that cannot be read: one line about the file, at once, and nothing else."""

import os
import shutil
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from test_readers_files import WRITERS, cloud, e57_scans, ply, written

from linear_ik.errors import ScanError, SettingsError
from linear_ik.readers import READERS, iter_scan, read_scan

__all__ = ["written"]
pytestmark = pytest.mark.filterwarnings("error")

COUNTED = [name for name in WRITERS if not name.endswith((".xyz", ".txt", ".csv", ".asc"))]


@pytest.fixture
def refused(capfd):
    """A function that reads a file and returns the one line with which it is refused."""

    def check(path: Path) -> str:
        tracemalloc.start()
        start = time.perf_counter()
        with pytest.raises(ScanError) as caught:
            read_scan(path)
        seconds, peak = time.perf_counter() - start, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert caught.value.subject == str(path)
        assert caught.value.what and caught.value.expected
        line = str(caught.value)
        assert line.startswith(f"{path}: ") and "\n" not in line and len(line) < len(str(path)) + 250
        assert seconds < 5 and peak < 64e6
        assert capfd.readouterr() == ("", "")
        return line.removeprefix(f"{path}: ")

    return check


def changed(written, tmp_path, name, change):
    """A copy of a written file with its bytes changed."""
    folder, _ = written
    path = tmp_path / name
    path.write_bytes(change((folder / name).read_bytes()))
    return path


@pytest.mark.parametrize("suffix", READERS)
def test_empty(tmp_path, refused, suffix):
    path = tmp_path / f"scan{suffix}"
    path.touch()
    assert "empty" in refused(path)


@pytest.mark.parametrize("suffix", READERS)
def test_missing(tmp_path, refused, suffix):
    (tmp_path / f"scan_1{suffix}").touch()
    line = refused(tmp_path / f"scan1{suffix}")
    assert "no such file" in line and f"scan_1{suffix}?" in line


@pytest.mark.parametrize("suffix", READERS)
def test_folder(tmp_path, refused, suffix):
    path = tmp_path / f"scan{suffix}"
    path.mkdir()
    assert "folder" in refused(path)


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("seed", range(3))
def test_garbage(tmp_path, refused, suffix, seed):
    path = tmp_path / f"scan{suffix}"
    path.write_bytes(np.random.default_rng(seed).bytes(20_000))
    refused(path)


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("beginning", [b"ply\n", b"# .PCD v0.7\n", b"LASF", b"ASTM-E57\x01\0\0\0\0\0\0\0", b"3000\n"])
def test_garbage_that_begins_well(tmp_path, refused, suffix, beginning):
    path = tmp_path / f"scan{suffix}"
    path.write_bytes(beginning + np.random.default_rng(0).bytes(20_000))
    refused(path)


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("name", ["ascii.ply", "binary.pcd", "v12.laz", "posed.e57", "count.pts"])
def test_contents_of_another_format(written, tmp_path, refused, suffix, name):
    path = tmp_path / f"scan{suffix}"
    shutil.copy(written[0] / name, path)
    if (
        (name.endswith(".laz") and suffix in (".las", ".laz"))
        or name.endswith(suffix)
        or (name == "count.pts" and suffix in (".asc", ".csv", ".txt", ".xyz"))
    ):
        assert len(read_scan(path)) == len(written[1])
    else:
        line = refused(path)
        if name != "count.pts":
            assert f"holds {name[-3:].upper().replace('LAZ', 'LAS')} data" in line


@pytest.mark.parametrize("name", COUNTED)
@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_truncated(written, tmp_path, refused, name, share):
    refused(changed(written, tmp_path, name, lambda data: data[: int(len(data) * share)]))


@pytest.mark.parametrize("name", ["blanks.xyz", "tabs.txt", "commas.csv", "semicolons.asc"])
def test_truncated_inside_a_line(written, tmp_path, refused, name):
    def cut(data):
        return data[: data.index(b"5", data.rindex(b"\n", 0, len(data) // 2)) + 3]

    assert "ends inside a line" in refused(changed(written, tmp_path, name, cut))


@pytest.mark.parametrize("name", [n for n in WRITERS if not n.endswith((".las", ".laz"))])
def test_nothing_but_nan(tmp_path, refused, name):
    points = np.full((50, 3), np.nan)
    if name == "posed.e57":
        # pye57's own writer gives bounds that are not numbers, and fails.
        e57_scans(tmp_path / name, {f"cartesian{axis}": points[:, 0] for axis in "XYZ"})
    else:
        WRITERS[name](tmp_path / name, points)
    assert refused(tmp_path / name).startswith("no point with finite coordinates")


@pytest.mark.parametrize("value", [1e300, -3.4e38, 1e9])
def test_coordinates_that_are_nowhere_on_earth(tmp_path, refused, value):
    points = cloud(5)
    points[:3, 1] = value
    ply(tmp_path / "a.ply", points)
    assert "1e+08 m" in refused(tmp_path / "a.ply")


def test_few_points_that_are_nowhere_on_earth_are_left_out_wherever_they_stand(tmp_path):
    points = cloud(7)
    points[[2, 6]] = 2e9
    ply(tmp_path / "a.ply", points)
    # A piece may hold nothing else.
    for size in (1, 3, 250_000):
        pieces = list(iter_scan(tmp_path / "a.ply", size))
        assert sum(piece.left_out for piece in pieces) == 2
        np.testing.assert_array_equal(np.concatenate([p.points for p in pieces]), np.delete(points, [2, 6], axis=0))


@pytest.mark.parametrize(
    ("suffix", "guess"), [(".pyl", ".ply?"), (".lass", ".las?"), (".e75", ".e57?"), (".stl", ".pcd")]
)
def test_unknown_extension(tmp_path, refused, suffix, guess):
    path = tmp_path / f"scan{suffix}"
    path.write_text("1 2 3\n")
    line = refused(path)
    assert suffix in line and guess in line and ".xyz" in line


def test_no_extension_but_known_contents(tmp_path, refused):
    ply(tmp_path / "scan", cloud(5))
    line = refused(tmp_path / "scan")
    assert "no extension" in line and ".ply?" in line


def test_pipe(tmp_path, refused):
    os.mkfifo(tmp_path / "scan.ply")
    assert "no regular file" in refused(tmp_path / "scan.ply")


def test_impossible_names(tmp_path, refused):
    refused(tmp_path / ("n" * 5000 + ".ply"))
    refused(tmp_path / "file.ply" / "in_a_file.ply")
    with pytest.raises(ScanError, match="null"):
        read_scan("nul\0l.ply")


@pytest.fixture
def nobody():
    """Root may read everything, so be somebody else for a while."""
    if os.geteuid():
        yield
        return
    os.seteuid(65534)
    yield
    os.seteuid(0)


@pytest.mark.parametrize("suffix", READERS)
def test_unreadable(tmp_path, refused, nobody, suffix):
    path = tmp_path / f"scan{suffix}"
    if os.getuid():
        path.write_text("1 2 3\n")
        path.chmod(0)
    # Else the folder is root's, closed to nobody.
    assert "ermission denied" in refused(path)


@pytest.mark.parametrize(
    ("name", "modules"),
    [("posed.e57", ["pye57"]), ("v12.las", ["laspy"]), ("v12.laz", ["laspy"]), ("v12.laz", ["lazrs"])],
)
def test_extra_is_not_installed(written, monkeypatch, refused, name, modules):
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    line = refused(written[0] / name)
    assert modules[0] in line and 'pip install "linear_ik[scan]"' in line


def test_pye57_on_arm(written, monkeypatch, refused):
    monkeypatch.setitem(sys.modules, "pye57", None)
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    monkeypatch.setattr("platform.system", lambda: "Linux")
    assert "ARM" in refused(written[0] / "posed.e57")


def test_no_files():
    with pytest.raises(ScanError, match="no files"):
        read_scan()


def test_chunk_of_nothing(written):
    with pytest.raises(SettingsError, match="chunk_points: 0"):
        iter_scan(written[0] / "little.ply", chunk_points=0)


def test_what_can_be_seen_from_outside_is_said_at_once(tmp_path):
    with pytest.raises(ScanError, match="no such file"):
        iter_scan(tmp_path / "a.ply")


def test_the_second_file_is_named(written, tmp_path):
    (tmp_path / "b.ply").write_text("ply\n")
    with pytest.raises(ScanError, match=r"b\.ply"):
        read_scan(written[0] / "little.ply", tmp_path / "b.ply")
