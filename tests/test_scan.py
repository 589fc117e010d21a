"""Scan and merge: points, and who saw them."""

import numpy as np
import pytest

from linear_ik.errors import ScanError
from linear_ik.scan import Scan, merge


def test_points_that_are_none_are_dropped_with_all_that_belongs_to_them():
    points = np.arange(12.0).reshape(4, 3)
    points[1, 2], points[2, 0] = np.nan, np.inf
    scan = Scan(points, normals=np.eye(4, 3), stations=[[0, 0, 0], [1, 1, 1]], station_index=[0, 1, 0, 1])
    assert len(scan) == 2
    np.testing.assert_array_equal(scan.points, points[[0, 3]])
    np.testing.assert_array_equal(scan.normals, np.eye(4, 3)[[0, 3]])
    np.testing.assert_array_equal(scan.station_index, [0, 1])
    assert scan.left_out == 2
    assert merge([scan, Scan(points)]).left_out == 4


def test_few_points_beyond_the_earth_are_left_out_most_are_not():
    points = np.arange(15.0).reshape(5, 3)
    points[3, 1], points[1, 0] = -2e9, 1e300
    scan = Scan(points)
    np.testing.assert_array_equal(scan.points, points[[0, 2, 4]])
    assert scan.left_out == 2
    points[0, 0] = 3e9
    with pytest.raises(ScanError, match=r"a coordinate of 1e\+300 m"):
        Scan(points)


def test_lists_and_single_precision_become_double():
    assert Scan([[1, 2, 3]]).points.dtype == np.float64
    assert Scan(np.ones((2, 3), dtype=np.float32)).points.dtype == np.float64


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"points": [[1, 2]]}, r"points: shape \(1, 2\)"),
        ({"points": [1, 2, 3]}, r"points: shape \(3,\)"),
        ({"points": "abc"}, "points: not numbers"),
        ({"points": [[1, 2, 3], [4, 5]]}, "points: not numbers"),
        ({"points": np.empty((0, 3))}, "no point with finite coordinates"),
        ({"points": np.full((5, 3), np.nan)}, "no point with finite coordinates"),
        ({"points": [[1, 2, -1e9]]}, r"a coordinate of 1e\+09 m"),
        ({"normals": np.eye(3)}, "normals: 3 rows"),
        ({"stations": [[0, 0, 0]]}, "without station_index"),
        ({"station_index": [0, 0]}, "without station_index"),
        ({"stations": [[0, 0, np.nan]], "station_index": [0, 0]}, "not finite"),
        ({"stations": [[0, 0, 0]], "station_index": [0]}, r"station_index: shape \(1,\)"),
        ({"stations": [[0, 0, 0]], "station_index": [0, 1]}, "station_index: value 1"),
        ({"stations": [[0, 0, 0]], "station_index": [-1, 0]}, "station_index: value -1"),
    ],
)
def test_arrays_that_make_no_scan(fields, said):
    with pytest.raises(ScanError, match=said):
        Scan(**{"points": np.ones((2, 3))} | fields)


def part(count, station=None, normals=False):
    points = np.random.default_rng(count).normal(size=(count, 3))
    return Scan(
        points,
        normals=points if normals else None,
        stations=None if station is None else [station],
        station_index=None if station is None else np.zeros(count),
    )


def test_merge_keeps_what_all_parts_have():
    a, b, c = part(3, (1, 2, 3), True), part(4, (4, 5, 6), True), part(5, (1, 2, 3))
    whole = merge([a, b, c])
    np.testing.assert_array_equal(whole.points, np.vstack([a.points, b.points, c.points]))
    np.testing.assert_array_equal(whole.stations, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(whole.station_index, [0] * 3 + [1] * 4 + [0] * 5)
    assert whole.normals is None
    np.testing.assert_array_equal(merge(iter([a, b])).normals, np.vstack([a.points, b.points]))
    assert merge([a, part(2)]).stations is None
    assert merge([part(2), a]).stations is None


def test_merge_of_parts_with_several_stations():
    first = Scan(np.ones((3, 3)), stations=[[0, 0, 0], [1, 0, 0]], station_index=[1, 0, 1])
    second = Scan(np.ones((2, 3)), stations=[[2, 0, 0], [1, 0, 0]], station_index=[1, 0])
    whole = merge([first, second])
    np.testing.assert_array_equal(whole.stations[whole.station_index][:, 0], [1, 0, 1, 1, 2])
    assert len(whole.stations) == 3


def test_merge_leaves_its_parts_alone():
    a, b = part(3), part(4)
    before = a.points.copy()
    merge([a, b]).points[:] = 0
    np.testing.assert_array_equal(a.points, before)


def test_merge_of_one_and_of_none():
    a = part(3)
    assert merge([a]) is a
    with pytest.raises(ScanError, match="no files"):
        merge([])


def test_repr_is_short():
    assert repr(part(1000, (0, 0, 0))) == "<Scan: 1000 points, 1 stations, no normals>"
