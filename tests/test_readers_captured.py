"""Captured files (README of the data folder): their counts and places."""

import os
from pathlib import Path

import numpy as np
import pytest

from linear_ik.readers import iter_scan, read_scan

DATA = Path(os.environ.get("LINEAR_IK_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "scans"
pytestmark = [
    pytest.mark.filterwarnings("error"),
    pytest.mark.skipif(not DATA.is_dir(), reason=f"the captured scans are not in {DATA} (LINEAR_IK_DATA)"),
]

COUNTS = {
    "steel_joint.txt": 3907,
    "pump.e57": 155_201,
    "timber_000A.ply": 19_116,
    "timber_000Z.ply": 26_556,
    "lamppost.pcd": 1771,
    "wire_harness.txt": 2253,
}


@pytest.mark.parametrize("name", COUNTS)
def test_counts(name, capfd):
    scan = read_scan(DATA / name)
    assert len(scan) == COUNTS[name]
    assert sum(len(piece) for piece in iter_scan(DATA / name, chunk_points=1000)) == COUNTS[name]
    assert (scan.normals is not None) == name.startswith("timber")
    assert capfd.readouterr() == ("", "")


def test_the_pump_was_scanned_from_the_origin():
    scan = read_scan(DATA / "pump.e57")
    np.testing.assert_array_equal(scan.stations, [[0, 0, 0]])
    # The file states these bounds itself.
    np.testing.assert_allclose(scan.points.min(axis=0), [-2.903764, -5.301103, -1.899705], atol=2e-6)
    np.testing.assert_allclose(scan.points.max(axis=0), [1.721604, -0.792647, 1.843003], atol=2e-6)


def test_the_lamppost_stands_where_it_did():
    points = read_scan(DATA / "lamppost.pcd").points
    for end in ([-9.86, -0.02, -5.29], [-11.1, 0.37, 0.42]):
        assert np.linalg.norm(points - end, axis=1).min() < 0.1


def test_the_joint_and_its_normals_are_told_apart():
    points = read_scan(DATA / "steel_joint.txt").points
    np.testing.assert_array_equal(points[0], [-0.6909, 18.350901, 6.6215])
