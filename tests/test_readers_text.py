"""Text formats: whatever the separator, the header and the further columns."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from linear_ik.errors import ScanError
from linear_ik.readers import iter_scan, read_scan

pytestmark = pytest.mark.filterwarnings("error")

ROWS = [[500000.123456, 5000000.654321, 1.5], [-2.0, 3e-3, 4e2], [7.0, 8.0, 9.0]]


def read(tmp_path, text, suffix=".txt"):
    path = tmp_path / f"scan{suffix}"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_scan(path).points


def lines(delimiter, *extra, rows=ROWS):
    return "".join(delimiter.join([*map(repr, row), *extra]) + "\n" for row in rows)


@pytest.mark.parametrize("delimiter", [" ", "   ", "\t", ",", ", ", " , ", ";", "; ", " \t "])
@pytest.mark.parametrize("extra", [(), ("17",), ("0.5", "255", "0", "7"), ("wall",)])
def test_separators(tmp_path, delimiter, extra):
    np.testing.assert_array_equal(read(tmp_path, lines(delimiter, *extra)), ROWS)


@pytest.mark.parametrize(
    "header",
    [
        "x,y,z,i",
        '"X","Y","Z","Intensity"',
        "X [m],Y [m],Z [m],I",
        "X(m), Y(m), Z(), I",
        "x_m,y_m,z_m,i",
        "pos_x,pos_y,pos_z,i",
        "Easting,Northing,Elevation,i",
        "E,N,H,code",
        "Points:0,Points:1,Points:2,i",
        "//X,Y,Z,I",
        "//X Y Z I",
        "# x y z i",
        "# columns: x y z i",
        "X Y Z I",
        "X;Y;Z;I",
        "# made by hand\n\n// another remark\n#x,y,z,i",
        "# a cloud with x and y and z, in metres",
        "\n\n",
    ],
)
def test_headers(tmp_path, header):
    np.testing.assert_array_equal(read(tmp_path, f"{header}\n{lines(',', '1')}"), ROWS)


@pytest.mark.parametrize(
    "header", ["id,Z,red,Y,X", "Point ID,z,R [0-255],y,x", "nr,h,r,n,e", "//Nr Z Red Y X", "# no names at all"]
)
def test_columns_are_found_by_name(tmp_path, header):
    text = "".join(f"{i},{z!r},200,{y!r},{x!r}\n" for i, (x, y, z) in enumerate(ROWS))
    points = read(tmp_path, f"{header}\n{text}")
    if "no names" in header:
        np.testing.assert_array_equal(points[:, 1], [row[2] for row in ROWS])
    else:
        np.testing.assert_array_equal(points, ROWS)


def test_a_column_of_words_ahead(tmp_path):
    text = "".join(f"wall {i}\t{x!r}\t{y!r}\t{z!r}\n" for i, (x, y, z) in enumerate(ROWS))
    np.testing.assert_array_equal(read(tmp_path, "name\tx\ty\tz\n" + text), ROWS)


@pytest.mark.parametrize("suffix", [".pts", ".txt", ".xyz", ".csv", ".asc"])
@pytest.mark.parametrize("head", ["3\n", "\n 3 \n\n", "x y z i\n3\n", "# remark\n3\n", "3\nx y z i\n"])
def test_count_ahead(tmp_path, suffix, head):
    np.testing.assert_array_equal(read(tmp_path, head + lines(" ", "7") + "\n\n", suffix), ROWS)


def test_several_clouds_in_a_file(tmp_path):
    text = "3\n" + lines(" ", "7") + "1\n1 2 3\n\n# remark\n0\n3\n" + lines(" ").rstrip("\n")
    np.testing.assert_array_equal(read(tmp_path, text, ".pts"), [*ROWS, [1, 2, 3], *ROWS])


def test_ends_of_lines_and_byte_order_mark(tmp_path):
    text = "x,y,z\n" + lines(",")
    for data in (text.replace("\n", "\r\n"), "\ufeff" + text, text.rstrip("\n"), text + "\n  \n"):
        np.testing.assert_array_equal(read(tmp_path, data), ROWS)


def test_remarks_and_blanks_between(tmp_path):
    text = lines(" ").replace("\n", "\n# 1 2 3\n\n  // 4 5 6\n")
    np.testing.assert_array_equal(read(tmp_path, text), ROWS)


@pytest.mark.parametrize("word", ["nan", "NaN", "-nan", "inf", "-Infinity", "1.#QNAN", "-1.#IND00", "-nan(ind)"])
def test_rows_without_a_number(tmp_path, word):
    text = f"1 2 {word}\n" + lines(" ") + f"{word} 2 3\n1 {word} 3 4\n"
    np.testing.assert_array_equal(read(tmp_path, text), ROWS)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,5 2,5 3,5\n", "line 1: 1,5 has a decimal comma"),
        ("1,5;2,5;3,5;17\n", "line 1: 1,5 has a decimal comma"),
        ("1,5\t2,5\t3,5\n", "decimal comma"),
        ("1,5, 2,5, 3,5\n", "decimal comma"),
        ("x;y;z\n1,5;2,5;3,5\n", "line 2: 1,5 has a decimal comma"),
        ("x y z\n1 2 3\n1,5 2 3\n", "line 3: 1,5 has a decimal comma"),
        ("1 2\n3 4\n", "line 1: 2 columns"),
        ("1 2 3\n4 5 6\n\n# x\n7 8\n9 9 9\n", "line 5: 2 columns"),
        ("1 2 3\n4 5 six\n7 8 9\n", "line 2: 'six' is not a number"),
        ("1 2 3\n4 5 6\n7 8 9 10\n1 1\n", "line 4: 2 columns"),
        ("1,2,3\n4,,6\n", "line 2: '' is not a number"),
        ("x,y,z\n", "no points"),
        ("# nothing\n\n", "no points"),
        ("0\n", "no points"),
        ("0\n0\n", "no points"),
        ("3\n1 2 3\n4 5 6\n", "room"),
        ("4\n11.125 12.5 13\n24.5 25.5 26\n37 38 39\n", "ends after 3 of 4"),
        ("3\n", "room"),
        ("1\n1 2 3\n4 5 6\n", "line 3 comes after"),
        ("a,b,c\n1,2,3\n", "neither a point nor a header"),
        ("x,y,z\nx,y,z\n1,2,3\n", "'x' is not a number"),
        ("x,y,z,i\n1,2,3\n", "line 2: not as many columns as the header names"),
        ("x [mm],y [mm],z [mm]\n1,2,3\n", "not in metres"),
        ("x(ft) y(ft) z(ft)\n1 2 3\n", "not in metres"),
        ("ncols 4\nnrows 5\n1 2 3\n", "line 1"),
        ("<html>\n", "neither a point nor a header"),
        ("1 2 3\n" + "9" * 70_000 + "\n", "line 2"),
        ("1 2 3\n4 5 6\n7 8", "ends inside a line"),
        ("1 2 3\n4 5 6\n7 8 9\0\0\0", "binary data"),
        (b"\xff\xfe1\x00 \x002\x00 \x003\x00\n\x00", "UTF-16"),
        (b"1 2 \xe9\n", "line 1"),
        ("1 2 3\n4_0 5 6\n", "line"),
        ("1 2 0x10\n", "line 1"),
    ],
)
@pytest.mark.parametrize("suffix", [".txt", ".pts"])
def test_text_that_holds_no_points(tmp_path, capfd, text, said, suffix):
    with pytest.raises(ScanError) as caught:
        read(tmp_path, text, suffix)
    assert caught.value.subject == str(tmp_path / f"scan{suffix}")
    assert said in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_the_line_is_named_far_into_the_file(tmp_path):
    text = "x,y,z\n" + "1,2,3\n" * 300_000 + "1,2,?\n" + "1,2,3\n" * 10
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ScanError, match=r"line 300002: '\?' is not a number"):
        for _ in iter_scan(path, chunk_points=1000):
            pass


def test_one_endless_line_is_not_loaded(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"1 2 3 " * 5_000_000)
    tracemalloc.start()
    with pytest.raises(ScanError, match="more than 65536 characters"):
        read_scan(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30e6


NUMBERS = st.floats(-1e7, 1e7)
NAMES = st.sampled_from(["i", "red", "nx", "class", "time stamp", "Scalar field"])


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=40),
    extra=st.lists(st.tuples(NAMES, NUMBERS), max_size=4),
    where=st.permutations(range(7)),
    delimiter=st.sampled_from([" ", "\t", ",", ";", ", "]),
    end=st.sampled_from(["\n", "\r\n"]),
    header=st.sampled_from(["", "{}", "//{}", "# {}"]),
    count=st.booleans(),
    chunk_points=st.integers(1, 50),
)
def test_any_layout(tmp_path, rows, extra, where, delimiter, end, header, count, chunk_points):
    columns = [("X", [r[0] for r in rows]), ("Y", [r[1] for r in rows]), ("Z", [r[2] for r in rows])]
    columns += [(name.replace(" ", "" if delimiter == " " else " "), [value] * len(rows)) for name, value in extra]
    if header:
        order = [i for i in where if i < len(columns)]
        columns = [columns[i] for i in order]
    text = [header.format(delimiter.join(name for name, _ in columns))] if header else []
    if count:
        text.append(str(len(rows)))
    text += [delimiter.join(map(repr, row)) for row in zip(*(values for _, values in columns), strict=True)]
    path = tmp_path / "a.csv"
    path.write_bytes(end.join([*text, ""]).encode())
    pieces = [piece.points for piece in iter_scan(path, chunk_points)]
    assert all(len(piece) <= chunk_points for piece in pieces)
    np.testing.assert_array_equal(np.concatenate(pieces), rows)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet="0123456789.,;-+eEnaxyz# \t\n\r/\"'()[]m", max_size=200))
def test_any_text_is_a_scan_or_one_line(tmp_path, text):
    path = tmp_path / "a.txt"
    path.write_bytes(text.encode() or b" ")
    try:
        assert np.isfinite(read_scan(path).points).all()
    except ScanError as error:
        assert error.subject == str(path)
        assert "\n" not in str(error)
