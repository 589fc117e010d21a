"""Files that cannot be read: one line about the file, at once, and nothing else."""

import os
import shutil
import struct
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_readers_files import WRITERS, cloud, e57_scans, pcd_open3d, ply, written

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


HUGE = 10**12


@pytest.mark.parametrize(
    ("name", "old"),
    [
        ("ascii.ply", b"vertex 300"),
        ("little.ply", b"vertex 300"),
        ("big.ply", b"vertex 300"),
        ("ascii.pcd", b"WIDTH 300"),
        ("binary.pcd", b"WIDTH 300|POINTS 300"),
        ("compressed.pcd", b"WIDTH 300|POINTS 300"),
        ("count.pts", b"300"),
        ("grid.ptx", b"300"),
    ],
)
@pytest.mark.parametrize("count", [HUGE, 10**19, 301, 600, 299, 10])
def test_header_lies_about_the_count(written, tmp_path, refused, name, old, count):
    def lie(data):
        for word in old.split(b"|"):
            assert word in data
            data = data.replace(word, word.replace(b"300", str(count).encode()), 1)
        return data

    refused(changed(written, tmp_path, name, lie))


@pytest.mark.parametrize("count", ["-5", "1e3", "", "x", "9" * 5000, "0x10", "1_0"])
@pytest.mark.parametrize("name", ["little.ply", "ascii.pcd", "grid.ptx"])
def test_count_that_is_no_count(written, tmp_path, refused, name, count):
    def lie(data):
        return data.replace(b"300", count.encode(), 1)

    refused(changed(written, tmp_path, name, lie))


@pytest.mark.parametrize(
    ("name", "count"),
    # A LAZ 1.2 chunk that has more than the header says is full for all one can see.
    [(name, count) for name in ("v12.las", "v14.las") for count in (4 * 10**9, 301, 299, 0)]
    + [(name, count) for name in ("v12.laz", "v14.laz") for count in (4 * 10**9, 50_001, 301, 0)]
    + [("v14.laz", 299)],
)
def test_las_header_lies_about_the_count(written, tmp_path, refused, name, count):
    offset, kind = (107, "<I") if name.startswith("v12") else (247, "<Q")

    def lie(data):
        return data[:offset] + struct.pack(kind, count) + data[offset + struct.calcsize(kind) :]

    refused(changed(written, tmp_path, name, lie))


@pytest.mark.parametrize(("offset", "value"), [(100, 2**32 - 1), (96, 2**32 - 1), (94, 0), (105, 0), (24, 2), (25, 9)])
def test_las_header_that_does_not_fit_the_file(written, tmp_path, refused, offset, value):
    size = {94: 2, 105: 2, 24: 1, 25: 1}.get(offset, 4)

    def lie(data):
        return data[:offset] + value.to_bytes(size, "little") + data[offset + size :]

    refused(changed(written, tmp_path, "v12.las", lie))


@pytest.mark.parametrize("scale", [0.0, np.nan, np.inf, 1e300])
def test_las_scale(written, tmp_path, refused, scale):
    refused(changed(written, tmp_path, "v12.las", lambda data: data[:131] + struct.pack("<d", scale) + data[139:]))


@pytest.mark.parametrize("chunks", [2**31, 2**32 - 1, 1000, 2, 0])
def test_laz_chunk_table_that_would_end_the_process(written, tmp_path, refused, chunks):
    def lie(data):
        start = struct.unpack_from("<I", data, 96)[0]
        table = struct.unpack_from("<q", data, start)[0]
        return data[: table + 4] + struct.pack("<I", chunks) + data[table + 8 :]

    refused(changed(written, tmp_path, "v14.laz", lie))


@pytest.mark.parametrize(
    ("number", "value"), [(0, 301), (0, 299), (0, 0), *((n, v) for n in (0, 1, 5) for v in (2**31, 2**32 - 1))]
)
def test_laz_layers_that_would_end_the_process(written, tmp_path, refused, number, value):
    def lie(data):
        start, point_bytes = struct.unpack_from("<I", data, 96)[0], struct.unpack_from("<H", data, 105)[0]
        at = start + 8 + point_bytes + 4 * number
        return data[:at] + struct.pack("<I", value) + data[at + 4 :]

    refused(changed(written, tmp_path, "v14.laz", lie))


@pytest.mark.parametrize("table", [0, 5, 2**40, -(2**60), 2**62])
def test_laz_chunk_table_elsewhere(written, tmp_path, refused, table):
    def lie(data):
        start = struct.unpack_from("<I", data, 96)[0]
        return data[:start] + struct.pack("<q", table) + data[start + 8 :]

    refused(changed(written, tmp_path, "v12.laz", lie))


def crc32c(page):
    crc = 0xFFFFFFFF
    for byte in page:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


@pytest.mark.parametrize("count", [999_999_999_999, 301])
def test_e57_header_lies_about_the_count(written, tmp_path, refused, count):
    def lie(data):
        text = b"".join(data[i : i + 1020] for i in range(0, len(data), 1024))
        old, new = b'recordCount="300"', b'recordCount="%d"' % count
        spare = b"pye57 v"
        at = text.index(spare) + len(spare)
        cut = len(new) - len(old)
        assert old in text
        # Keep every offset: what the number gains, the description loses ahead of it.
        short = text[: at - cut] + text[at:]
        assert text.index(old) > at
        text = short.replace(old, new)
        pages = [text[i : i + 1020] for i in range(0, len(text), 1020)]
        return b"".join(page + struct.pack(">I", crc32c(page)) for page in pages)

    refused(changed(written, tmp_path, "posed.e57", lie))


@pytest.mark.parametrize("value", [1e300, -3.4e38, 1e9])
def test_coordinates_that_are_nowhere_on_earth(tmp_path, refused, value):
    points = cloud(5)
    points[3, 1] = value
    ply(tmp_path / "a.ply", points)
    assert "1e+08 m" in refused(tmp_path / "a.ply")


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


@pytest.mark.parametrize(
    "header",
    [
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n",
        "ply\nformat ascii 1.0\nelement face 1\nproperty float x\nend_header\n1\n",
        "ply\nformat text 1.0\nelement vertex 1\n",
        "ply\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
        "ply\nformat ascii 1.0\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\n"
        "end_header\n1 1 2 3\n",
        "ply\nformat ascii 1.0\nelement vertex 1\n" + "comment long\n" * 5000,
        "ply\nformat ascii 1.0\ncomment " + "x" * 10000,
        "plywood\n",
    ],
)
def test_ply_headers(tmp_path, refused, header):
    (tmp_path / "a.ply").write_text(header)
    refused(tmp_path / "a.ply")


PCD = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3\n"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FIELDS x y z", "FIELDS x y w"),
        ("SIZE 8 8 8", "SIZE 8 8"),
        ("SIZE 8 8 8", "SIZE 8 8 3"),
        ("SIZE 8 8 8", "SIZE 8 8 8\nCOUNT 1 1 2"),
        ("TYPE F F F", "TYPE F F Q"),
        ("HEIGHT 1", "HEIGHT 1\nPOINTS 2"),
        ("DATA ascii", "DATA zip"),
        ("DATA ascii\n1 2 3\n", "DATA ascii"),
        ("DATA ascii\n1 2 3\n", "DATA binary_compressed\n"),
        ("HEIGHT 1", "DEPTH 1"),
        ("DATA ascii\n1 2 3\n", "# no end\n" * 2000),
        ("1 2 3", "1 2 3\n4 5 6"),
    ],
)
def test_pcd_headers(tmp_path, refused, old, new):
    assert old in PCD
    (tmp_path / "a.pcd").write_text(PCD.replace(old, new))
    refused(tmp_path / "a.pcd")


@pytest.mark.parametrize("place", [0, 0.5, 0.95])
def test_damaged_lzf(tmp_path, refused, place):
    pcd_open3d(tmp_path / "a.pcd", np.repeat(cloud(10), 60, axis=0), compressed=True)
    data = bytearray((tmp_path / "a.pcd").read_bytes())
    body = data.index(b"compressed\n") + len(b"compressed\n") + 8
    at = body + int((len(data) - body) * place)
    data[at:] = b"\xff" * (len(data) - at)
    (tmp_path / "a.pcd").write_bytes(data)
    assert "damaged" in refused(tmp_path / "a.pcd")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(sorted(WRITERS)), data=st.data())
def test_damage_anywhere_is_a_scan_or_one_line(written, tmp_path, name, data):
    whole = (written[0] / name).read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    gone = data.draw(st.integers(0, 40))
    damage = data.draw(st.binary(max_size=20))
    path = tmp_path / name
    path.write_bytes(whole[:at] + damage + whole[at + gone :])
    try:
        assert len(read_scan(path))
    except ScanError as error:
        assert error.subject == str(path)
        assert "\n" not in str(error)
