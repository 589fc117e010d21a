"""Headers that lie and bytes that were changed: refused before memory or the process is lost."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_readers_bad import changed, refused
from test_readers_files import WRITERS, cloud, pcd_open3d, written

from linear_ik.errors import ScanError
from linear_ik.readers import read_scan

__all__ = ["refused", "written"]
pytestmark = pytest.mark.filterwarnings("error")

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
