"""COPC: a scan of a site read where the elements are, with the results of reading it whole."""

from __future__ import annotations

import json
import struct
import time
from dataclasses import replace

import numpy as np
import pytest
from copc_files import write_copc
from site_samples import GUIDS, only, site

import linear_ik
from linear_ik.design_model import MapConversion
from linear_ik.errors import ScanError
from linear_ik.model_fit import ModelFitOptions, fit_model
from linear_ik.model_fit.placing import scan_to_model
from linear_ik.readers import copc, iter_scan
from linear_ik.site.handout import boxes_back, hand_out, moved
from linear_ik.site.neighbourhood import Neighbourhoods
from linear_ik.site.spill import Spill

CORNER = np.array([[[500000.0, 5e6, 100.0], [500005.0, 5e6 + 4, 106.0]]])


@pytest.fixture(scope="module", params=[True, False], ids=["pages", "one page"])
def octree(request, tmp_path_factory):
    rng = np.random.default_rng(1)
    points = np.round(rng.uniform([0, 0, 0], [40, 30, 10], (20_000, 3)), 4) + CORNER[0, 0]
    path = tmp_path_factory.mktemp("copc") / "site.copc.laz"
    assert write_copc(path, points, 1e-4, request.param) > 50
    return path, points


def inside(points, boxes):
    return np.any([((points >= low) & (points <= high)).all(axis=1) for low, high in boxes], axis=0)


def ordered(points):
    return points[np.lexsort(points.T)]


def test_the_file_is_what_laspy_takes_for_copc(octree):
    import laspy

    path, points = octree
    with laspy.CopcReader.open(str(path)) as reader:
        found = reader.query(bounds=laspy.copc.Bounds(*CORNER[0]))
        assert len(reader.query()) == len(points)
    assert len(found) == inside(points, CORNER).sum() > 30


@pytest.mark.parametrize("chunk_points", [500, 250_000])
def test_what_is_in_the_boxes_is_read_and_little_else(octree, chunk_points):
    path, points = octree
    # Two that overlap, and one that holds nothing: each point comes once.
    boxes = np.concatenate([CORNER, CORNER + [2.0, 0.0, 0.0], CORNER + 1e4])
    pieces = list(iter_scan(path, chunk_points, boxes))
    assert max(map(len, pieces)) <= max(chunk_points, 2500)
    found = np.concatenate([piece.points for piece in pieces])
    np.testing.assert_allclose(
        ordered(found[inside(found, boxes)]), ordered(points[inside(points, boxes)]), rtol=0, atol=1e-6
    )
    assert len(found) < 0.4 * len(points)
    assert len(np.unique(found, axis=0)) == len(found)


def test_what_is_withheld_is_left_out(tmp_path):
    points = np.round(np.random.default_rng(3).uniform(0, 9, (500, 3)), 4)
    write_copc(tmp_path / "a.copc.laz", points, 1e-4, withheld=40)
    pieces = list(iter_scan(tmp_path / "a.copc.laz", within=np.array([[[0.0] * 3, [9.0] * 3]])))
    np.testing.assert_allclose(ordered(np.concatenate([p.points for p in pieces])), ordered(points[40:]), atol=1e-6)
    assert sum(piece.left_out for piece in pieces) == 40


def test_chunks_that_follow_each_other_are_read_together_up_to_the_most():
    runs = [copc.Run(offset, [(40, 10)]) for offset in (0, 10, 20, 40, 50)]
    joined = copc.joined(runs, 100)
    assert [(run.offset, run.points, run.bytes) for run in joined] == [(0, 80, 20), (20, 40, 10), (40, 80, 20)]
    many = [copc.Run(10 * i, [(1, 10)]) for i in range(50_000)]
    began = time.process_time()
    assert [run.points for run in copc.joined(many, 10**9)] == [50_000]
    # Counted through again for each chunk it took half a minute.
    assert time.process_time() - began < 2.0


def test_far_from_everything_a_sample_says_where_the_scan_is(octree):
    path, points = octree
    found = np.concatenate([piece.points for piece in iter_scan(path, within=CORNER + 1e4)])
    assert 0 < len(found) <= len(points) / 8
    np.testing.assert_allclose(found.min(axis=0), points.min(axis=0), atol=1.0)
    np.testing.assert_allclose(found.max(axis=0), points.max(axis=0), atol=1.0)


def test_other_files_are_read_whole(tmp_path):
    points = np.random.default_rng(2).uniform(0, 9, (50, 3))
    for name in ("a.ply", "a.laz"):
        linear_ik.write_scan(linear_ik.Scan(points), tmp_path / "a.ply")
        if name == "a.laz":
            import laspy

            data = laspy.create(point_format=6, file_version="1.4")
            data.header.scales = [1e-4] * 3
            data.x, data.y, data.z = points.T
            data.write(str(tmp_path / name))
        assert sum(map(len, iter_scan(tmp_path / name, within=CORNER))) == 50


def damaged(path, change):
    data = bytearray(path.read_bytes())
    info = 375 + 54
    root, size = struct.unpack_from("<QQ", data, info + 40)
    change(data, info, root, size)
    out = path.with_name("damaged.copc.laz")
    out.write_bytes(data)
    return out


@pytest.mark.parametrize(
    "change",
    [
        lambda d, info, root, size: struct.pack_into("<Q", d, info + 40, len(d) + 7),
        lambda d, info, root, size: struct.pack_into("<Q", d, info + 48, size - 5),
        lambda d, info, root, size: struct.pack_into("<Q", d, info + 48, size - 32),
        lambda d, info, root, size: struct.pack_into("<i", d, root, -3),
        # A node that goes on on the page it is on.
        lambda d, info, root, size: struct.pack_into("<Qii", d, root + 16, root, size, -1),
        lambda d, info, root, size: struct.pack_into("<i", d, root + 28, 17),
    ],
    ids=["no page there", "half an entry", "a node is missing", "no level", "for ever", "another number"],
)
def test_a_damaged_octree_is_refused(octree, change):
    path = damaged(octree[0], change)
    with pytest.raises(ScanError, match="octree") as caught:
        list(iter_scan(path, within=CORNER))
    assert caught.value.subject == str(path)
    # The points are all there all the same.
    assert sum(map(len, iter_scan(path))) == len(octree[1])


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_boxes_go_back_into_the_scans_coordinates(scale):
    angle = np.radians(30)
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, :3] *= scale
    T[:3, 3] = [3, -2, 1]
    boxes = np.array([[[0.0, 0.0, 0.0], [2.0, 1.0, 0.5]], [[5.0, 5.0, 5.0], [5.0, 5.0, 5.0]]])
    back = boxes_back(boxes, T)
    rng = np.random.default_rng(0)
    for box, held in zip(boxes, back, strict=True):
        points = rng.uniform(*box, (500, 3))
        scan = (points - T[:3, 3]) @ np.linalg.inv(T[:3, :3]).T
        assert inside(scan, [held + [[-1e-9], [1e-9]]]).all()
    np.testing.assert_allclose(back[1, 0], back[1, 1])
    assert boxes_back(boxes, None) is boxes


def test_on_a_map_with_a_scale_the_elements_get_the_points_of_the_whole_scan(tmp_path):
    built = site(tmp_path)
    model = only(built.design, GUIDS[2])
    T_map_model = np.eye(4)
    T_map_model[:3, :3] = 0.9996 * np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    T_map_model[:3, 3] = 500_000.0, 5_400_000.0, 100.0
    rng = np.random.default_rng(5)
    hall = rng.uniform([-1, -1, -0.5], [30, 30, 6], (20_000, 3))
    points = np.concatenate([linear_ik.read_scan(built.scan).points, hall])
    path = tmp_path / "octree.copc.laz"
    write_copc(path, np.round(points @ T_map_model[:3, :3].T + T_map_model[:3, 3], 4), 1e-4)
    T = scan_to_model(
        replace(model, map_conversion=MapConversion(T_map_model, "grid")), ModelFitOptions(map_coordinates=True)
    )
    near = Neighbourhoods.of([m.element for m in model.members], [0.15])
    received = []
    for within in (boxes_back(near.bounds_m, T), None):
        spill = Spill(tmp_path, 1, 10**6, 10**8)
        read = hand_out(moved(iter_scan(path, within=within), T), near, spill).points
        received.append((int(spill.received[0]), read < len(points)))
    assert received[0][0] == received[1][0] > 1000
    assert [few for _, few in received] == [True, False]


def test_a_run_ends_as_with_the_whole_scan(tmp_path):
    built = site(tmp_path)
    # Spread over a hall, of which the elements are a corner.
    rng = np.random.default_rng(5)
    near = linear_ik.read_scan(built.scan).points
    points = np.round(np.concatenate([near, rng.uniform([-1, -1, -0.5], [30, 30, 6], (60_000, 3))]), 4)
    write_copc(tmp_path / "octree.copc.laz", points, 1e-4)
    # The same chunks without the record that makes it COPC.
    data = (tmp_path / "octree.copc.laz").read_bytes().replace(b"copc\0", b"none\0")
    (tmp_path / "plain.laz").write_bytes(data)
    model = only(built.design, GUIDS[2])
    runs = {}
    for name in ("octree.copc.laz", "plain.laz"):
        out = tmp_path / name.split(".")[0]
        fit_model(model, [tmp_path / name], out, options=ModelFitOptions(workers=0))
        report = json.loads((out / "run.json").read_text())
        files = {
            p.name: {k: v for k, v in json.loads(p.read_text()).items() if k != "timings_s"}
            for p in sorted((out / "elements").iterdir())
        }
        runs[name] = files, (out / "elements.csv").read_bytes(), (out / "deviation.ply").read_bytes(), report
    few, whole = runs["octree.copc.laz"], runs["plain.laz"]
    assert few[:3] == whole[:3]
    read = [run[3]["scan_points"] for run in (few, whole)]
    assert read[0]["in_a_neighbourhood"] == read[1]["in_a_neighbourhood"] > 1000
    assert read[1]["points"] == len(points) > 3 * read[0]["points"]
