import asyncio
import math
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from dataclasses import replace
from urllib.parse import urlsplit

import numpy as np
import pytest
import umsgpack
from browser import CHROMIUM, browser
from PIL import Image

import linear_ik
from linear_ik.chain import Chain
from linear_ik.element import Element, Placement
from linear_ik.errors import OutputError
from linear_ik.profile import Circle, IShape, RectangleHollow
from linear_ik.result import FitResult, IterationRecord, SegmentResult
from linear_ik.scan import Scan
from linear_ik.settings import FitSettings
from linear_ik.simulate import simulate
from linear_ik.viewer import Viewer
from linear_ik.viewer_cloud import MOST_POINTS
from linear_ik.viewer_pairs import MOST_PAIRS
from linear_ik.viewer_result import RADIUS_95

UTM = (512345.678, 5403210.123, 412.5)


def column(location=UTM, profile=None, segments=10):
    profile = profile or IShape(0.2, 0.2, 0.009, 0.015, 0.018)
    return Element("H <column>", profile, 3.0, segments, Placement(location, axis=(0.1, 0.0, 1.0)))


def fitted(element, scan, status="converged"):
    n = element.segments
    history = tuple(
        IterationRecord(i + 1, "full", 900, 0.001, math.inf, 0.0, 0.1, scan.q * i / 4, scan.base_pose) for i in range(5)
    )
    return FitResult(
        element=element,
        status=status,
        reasons=("A <reason>.",),
        nodes_m=scan.nodes_m,
        nodes_covariance_m2=np.zeros((n + 1, 3, 3)),
        q=scan.q,
        joint_angles_rad=scan.joint_angles_rad,
        joint_limits_rad=np.zeros((n, 3, 2)),
        base_pose=scan.base_pose,
        rmse_m=0.007,
        surface_rmse_m=0.001,
        range_noise_m=0.001,
        segments=tuple(SegmentResult("measured", 100, 1.0, 0.001) for _ in range(n)),
        history=history,
        settings=FitSettings(),
    )


def commands(viewer):
    """What a browser is told: (path below /meshcat, type) -> command."""
    decoded = [umsgpack.unpackb(data) for data in viewer.scene.commands()]
    return {(c["path"].replace("/meshcat/", ""), c["type"] + c.get("property", "")): c for c in decoded}


def matrix(viewer, path):
    return np.array(commands(viewer)[path, "set_transform"]["matrix"]).reshape(4, 4).T


def points_of(viewer):
    geometry = commands(viewer)["scan", "set_object"]["object"]["geometries"][0]["data"]["attributes"]
    return [np.frombuffer(geometry[name]["array"].data, np.float32).reshape(-1, 3) for name in ("position", "color")]


def test_fitted_segments_stand_where_the_chain_puts_them():
    element = column()
    scan = simulate(element, bends=["4:y:20", "8:x:-10"], points=1000)
    viewer = Viewer()
    viewer.show_design(element)
    viewer.show_fit(element, scan.q, scan.base_pose)
    T = np.array([matrix(viewer, f"fitted/{k + 1}") for k in range(10)])
    designed = matrix(viewer, "design")
    # About a local origin, yet the same relative to each other to the last micrometre.
    assert np.abs(T[:, :3, 3]).max() < 10
    np.testing.assert_allclose(T[:, :3, 3] - designed[:3, 3], scan.nodes_m[:-1] - np.array(UTM), atol=1e-7)
    np.testing.assert_allclose(designed[:3, :3], element.placement.T_world_element[:3, :3], atol=1e-12)
    assert np.abs(T[9, :3, :3] - T[0, :3, :3]).max() > 0.1


def test_each_iteration_moves_the_segments():
    element = column(segments=4)
    base = element.placement.T_world_element
    viewer = Viewer()
    viewer.on_iteration(IterationRecord(1, "full", 0, 0.0, 1.0, 0.0, 0.0, np.zeros(12), base))
    assert not [key for key in commands(viewer) if key[0].startswith("fitted")]
    viewer.show_design(element)
    tips = []
    for i in range(3):
        q = np.zeros(12)
        q[4] = 0.2 * i
        viewer.on_iteration(IterationRecord(i + 1, "full", 0, 0.0, 1.0, 0.0, 0.0, q, base))
        tips.append(matrix(viewer, "fitted/4")[:3, 3])
        node = Chain.of(element).nodes(q)[3]
        np.testing.assert_allclose(tips[-1] - matrix(viewer, "design")[:3, 3], base[:3, :3] @ node, atol=1e-7)
    assert np.linalg.norm(tips[2] - tips[1]) > 0.05
    bodies = [key[0] for key in commands(viewer) if key[0].startswith("fitted") and key[1] == "set_object"]
    assert sorted(bodies) == sorted(
        [*(f"fitted/{k}{part}" for k in (1, 2, 3, 4) for part in ("", "/joint")), "fitted/4/end"]
    )


def test_a_search_is_shown_no_faster_than_an_eye_follows(monkeypatch):
    now = [10.0]
    monkeypatch.setattr("linear_ik.viewer.time.monotonic", lambda: now[0])
    element = column(segments=2)
    viewer, shown = Viewer(), []
    viewer.show_design(element)
    monkeypatch.setattr(viewer, "show_fit", lambda *what: shown.append(now[0]))
    T = element.placement.T_world_element
    for i in range(100):
        now[0] += 0.01
        phase = "search" if i < 99 else "full"
        viewer.on_iteration(IterationRecord(i + 1, phase, 0, 0.0, 1.0, 0.0, 0.0, np.zeros(6), T))
    assert 10 <= len(shown) <= 16 and shown[-1] == now[0]


def test_slowed_iterations_end(monkeypatch):
    slept = []
    monkeypatch.setattr("linear_ik.viewer_playback.time.sleep", slept.append)
    element = column(segments=2)
    viewer = Viewer()
    viewer.show_design(element)
    record = IterationRecord(1, "full", 0, 0.0, 1.0, 0.0, 0.0, np.zeros(6), element.placement.T_world_element)
    viewer.on_iteration(record)
    assert not slept
    viewer.slow_down(pause_s=0.1, total_s=0.25)
    for _ in range(10):
        viewer.on_iteration(record)
    viewer.catch_up()
    assert sum(slept) == pytest.approx(0.25) and max(slept) <= 0.1


def test_a_live_view_does_not_hold_the_fit(monkeypatch):
    """States are held for an eye, 2 s of them here; the fit runs ahead, and the view costs it less than a tenth."""
    element = column(segments=6, location=(0, 0, 0))
    scan = simulate(element, bends=["2:y:8", "5:x:-6"], points=3000).without_truth()
    viewer = Viewer()
    viewer.show_design(element)
    viewer.show_scan(scan)
    shown = []
    monkeypatch.setattr(viewer, "_show_record", lambda record: shown.append(record.iteration))
    viewer.slow_down(pause_s=0.5, total_s=2.0)
    spent = [0.0]

    def watched(record):
        started = time.thread_time()
        viewer.on_iteration(record)
        spent[0] += time.thread_time() - started

    started = time.thread_time()
    result = linear_ik.fit(element, scan, on_iteration=watched)
    took = time.thread_time() - started
    assert len(shown) < result.iterations  # still at the first ones
    assert spent[0] < 0.1 * took
    viewer.catch_up()
    assert shown[0] == 1 and shown[-1] == result.iterations


def test_states_are_shown_with_their_own_number_of_segments(monkeypatch):
    """The fit tries how many segments there are, and is ahead of what is shown."""
    element, shown = Element("b", Circle(0.05), 3.0, auto_segments=True), []
    viewer, show, first = Viewer("b"), Viewer.show_fit, threading.Event()

    def slowly(self, element, q, base_pose):
        first.wait(10.0)
        show(self, element, q, base_pose)
        shown.append(element.segments)

    monkeypatch.setattr(Viewer, "show_fit", slowly)
    viewer.show_design(element)
    viewer.slow_down(pause_s=0.001)
    for n in (5, 5, 10, 5, 20):
        viewer.on_iteration(IterationRecord(1, "full", 0, 0.0, 1.0, 0.0, 0.0, np.zeros(3 * n), np.eye(4)))
    first.set()
    viewer.catch_up()
    viewer.close()
    assert shown == [5, 5, 10, 5, 20]


def test_a_view_that_nobody_follows_costs_nothing(monkeypatch):
    element = column(segments=2)
    viewer, base = Viewer(), element.placement.T_world_element
    viewer.show_design(element)
    viewer.serve()
    try:
        record = IterationRecord(1, "full", 0, 0.0, 1.0, 0.0, 0.0, np.zeros(6), base)
        viewer.on_iteration(record)
        assert ("fitted/1", "set_object") not in commands(viewer)
        monkeypatch.setattr(viewer.scene, "watchers", lambda: 1)
        viewer.on_iteration(record)
        assert ("fitted/1", "set_object") in commands(viewer)
    finally:
        viewer.close()


def test_closing_a_live_view_ends_what_it_shows(monkeypatch):
    element = column(segments=2)
    viewer = Viewer()
    monkeypatch.setattr(viewer.scene, "watchers", lambda: 1)
    viewer.show_design(element)
    viewer.serve()
    viewer.slow_down(pause_s=0.05, total_s=100.0)
    base = element.placement.T_world_element
    for i in range(1000):
        viewer.on_iteration(IterationRecord(i + 1, "full", 0, 0.0, 1.0, 0.0, 0.0, np.zeros(6), base))
    before = threading.active_count()
    started = time.monotonic()
    viewer.close()
    assert time.monotonic() - started < 20 and threading.active_count() == before - 2  # playback and server


def lines_of(viewer, step):
    data = commands(viewer)[f"pairs/{step}", "set_object"]["object"]["geometries"][0]["data"]["attributes"]
    return np.frombuffer(data["position"]["array"].data, np.float32).reshape(-1, 2, 3)


def test_pairs_join_points_to_the_surface_at_each_step():
    element = column(segments=3, profile=RectangleHollow(0.2, 0.2, 0.01), location=(0, 0, 0))
    scan = simulate(element, bends=["2:y:20"], points=2000)
    viewer = Viewer()
    viewer.show_result(fitted(element, scan))
    assert not [key for key in commands(viewer) if key[0].startswith("pairs/")]  # without a scan there are none
    viewer.show_result(fitted(element, scan), scan)
    drawn = commands(viewer)
    assert drawn["pairs", "set_propertyvisible"]["value"] is False
    first, last = lines_of(viewer, 0), lines_of(viewer, 5)
    assert first.shape == last.shape == (MOST_PAIRS, 2, 3) and ("pairs/6", "set_object") not in drawn
    # The same points at each step; from the design they lie far off, from the result on it.
    np.testing.assert_array_equal(first[:, 0], last[:, 0])
    off = [np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) for lines in (first, last)]
    assert off[0].max() > 0.1 and off[1].max() < 0.003
    told = {c["type"]: c for c in (umsgpack.unpackb(data) for data in viewer.scene.commands())}
    assert told["steps"]["pairs"] is True and len(told["steps"]["labels"]) == 6


def test_scan_is_coloured_by_its_distance_to_the_fit():
    element = column()
    scan = simulate(element, bends=["6:y:15"], points=4000, noise_m=0.0)
    wall = scan.nodes_m.mean(axis=0) + [0.5, 0.0, 0.0] + np.random.default_rng(0).normal(size=(500, 3)) * [0, 0.1, 0.5]
    off = scan.points[scan.segment == 2] + np.array([0.0, 0.012, 0.0])
    viewer = Viewer()
    viewer.show_result(fitted(element, scan), Scan(np.concatenate([scan.points, off, wall])))
    points, colours = points_of(viewer)
    assert np.abs(points).max() < 10
    blue, grey = np.array([0.16, 0.38, 0.95]), np.array([0.75, 0.78, 0.82])
    on_surface = np.abs(colours[:4000] - blue).max(axis=1) < 0.05
    assert on_surface.mean() > 0.97
    assert (np.abs(colours[4000:-500] - blue).max(axis=1) > 0.3).mean() > 0.3
    assert np.abs(colours[-500:] - grey).max() < 1e-6


def test_an_element_that_was_not_found_is_not_drawn_as_fitted():
    element = column(segments=3)
    scan = simulate(element, points=300)
    viewer = Viewer()
    viewer.show_result(fitted(element, scan, "not_scanned"), scan)
    assert not [key for key in commands(viewer) if key[0].startswith("fitted")]
    assert any("not_scanned" in text for _, text in viewer.scene.captions)


def test_a_large_scan_keeps_the_element():
    element = column(profile=Circle(0.05))
    member = simulate(element, points=5000).points
    site = np.array(UTM) + np.random.default_rng(1).uniform(-50, 50, size=(400_000, 3))
    viewer = Viewer()
    viewer.show_design(element)
    viewer.show_scan(Scan(np.concatenate([member, site])))
    points, _ = points_of(viewer)
    assert len(points) <= MOST_POINTS
    local = matrix(viewer, "design")[:3, :3].T @ (points.T - matrix(viewer, "design")[:3, 3:])
    assert (np.hypot(local[0], local[1]) < 0.06).sum() > 4900


def test_a_large_scan_of_nothing_known():
    points = np.array(UTM) + np.random.default_rng(1).uniform(-5, 5, size=(MOST_POINTS + 1000, 3))
    viewer = Viewer()
    viewer.show_scan(Scan(points))
    shown, _ = points_of(viewer)
    assert len(shown) == MOST_POINTS and np.abs(shown).max() < 6


def test_the_fit_alone_is_about_a_local_origin():
    element = column(segments=5)
    scan = simulate(element, points=100)
    viewer = Viewer()
    viewer.show_fit(element, scan.q, scan.base_pose)
    assert np.abs(matrix(viewer, "fitted/5")[:3, 3]).max() < 4


def test_the_camera_looks_from_the_scanned_side():
    element = column(location=(0, 0, 0))
    for missing, sign in ((("+x",), -1), (("-x",), 1)):
        scan = simulate(element, points=2000, missing=missing)
        viewer = Viewer()
        viewer.show_design(element)
        viewer.show_scan(Scan(scan.points))
        eye = commands(viewer)["/Cameras/default/rotated/<object>", "set_propertyposition"]["value"]
        assert sign * eye[0] > 0.5


def test_the_page_needs_nothing_else_and_escapes_names(tmp_path):
    element = column()
    viewer = Viewer(element.name)
    viewer.show_result(fitted(element, simulate(element, points=100)))
    page = viewer.static_html(tmp_path / "new" / "page.html").read_text(encoding="utf-8")
    assert "<title>H &lt;column&gt;</title>" in page and "A &lt;reason&gt;." in page
    assert "<column>" not in page.replace("&lt;column&gt;", "")
    markup = page.replace(viewer.scene._page(""), "").replace('<link rel="icon" href="data:,">', "")
    for outside in ("<script src", "<link", "@import", 'fetch("http'):
        assert outside not in markup
    with pytest.raises(OutputError):
        viewer.static_html(tmp_path)


def test_what_the_scan_does_not_fix_has_another_colour():
    element = column(segments=4)
    scan = simulate(element, points=400)
    result = fitted(element, scan)
    kinds = ("measured", "inferred", "not_scanned", "measured")
    parts = tuple(replace(s, status=kind) for s, kind in zip(result.segments, kinds, strict=True))
    viewer = Viewer()
    viewer.show_result(replace(result, segments=parts))
    drawn = commands(viewer)
    colours = [drawn[f"fitted/{k}", "set_object"]["object"]["materials"][0]["color"] for k in (1, 2, 3, 4)]
    assert colours[0] == colours[3] and len(set(colours)) == 3
    legend = [text for _, text in viewer.scene.captions]
    assert "inferred: segment 2" in legend and "not scanned: segment 3" in legend


def test_each_node_has_its_ellipsoid_as_large_as_the_legend_says():
    element = column(segments=3)
    scan = simulate(element, points=400)
    result = fitted(element, scan)
    turn = element.placement.T_world_element[:3, :3]
    covariance = np.tile(turn @ np.diag([0.001, 0.002, 0.004]) ** 2 @ turn.T, (4, 1, 1))
    covariance[0] = 0.0  # a held start is known exactly
    covariance[3] = np.nan
    viewer = Viewer()
    viewer.show_result(replace(result, nodes_covariance_m2=covariance))
    drawn = commands(viewer)
    assert [key[0] for key in drawn if key[0].startswith("nodes/") and key[1] == "set_object"] == ["nodes/1", "nodes/2"]
    (text,) = [text for _, text in viewer.scene.captions if text.startswith("nodes: ")]
    scale = float(text.split("drawn ")[1].split()[0]) if "drawn" in text else 1.0
    body = np.array(drawn["nodes/2", "set_object"]["object"]["object"]["matrix"]).reshape(4, 4).T[:3, :3]
    pose = matrix(viewer, "nodes/2")
    shape = pose[:3, :3] @ body
    np.testing.assert_allclose(shape @ shape.T, (scale * RADIUS_95) ** 2 * covariance[2], rtol=1e-6, atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(
        pose[:3, 3] - matrix(viewer, "design")[:3, 3], scan.nodes_m[2] - np.array(UTM), atol=1e-7
    )


def test_the_page_is_told_the_steps_and_the_legend():
    element = column(segments=3)
    viewer = Viewer()
    viewer.show_result(fitted(element, simulate(element, points=200)))
    told = {c["type"]: c for c in (umsgpack.unpackb(data) for data in viewer.scene.commands())}
    assert told["steps"]["labels"] == [*(f"iteration {i} of 5, full, 1.00 mm rms" for i in range(1, 6)), "result"]
    assert [text for _, text in viewer.scene.captions] == [text for _, text in told["captions"]["lines"]]
    assert told["captions"]["lines"][-1][1].startswith("status: converged")


@pytest.fixture
def served():
    viewer = Viewer("served")
    viewer.show_design(column(segments=2))
    url = viewer.serve()
    yield viewer, url
    viewer.close()


def test_served_on_the_loopback_address_only(served):
    viewer, url = served
    port = urlsplit(url).port
    assert url.startswith("http://127.0.0.1:") and viewer.serve() == url
    page = urllib.request.urlopen(url, timeout=10).read().decode()
    assert "<title>served</title>" in page and "/scene" in page
    # A server on every interface answers on the loopback network's other addresses too.
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), timeout=2):
        pass


def test_another_host_name_is_refused(served):
    _, url = served
    request = urllib.request.Request(url, headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(request, timeout=10)
    assert caught.value.code == 404


def test_a_browser_is_told_the_scene_and_every_change(served):
    from tornado.websocket import websocket_connect

    viewer, url = served

    async def follow():
        connection = await websocket_connect(url.replace("http", "ws") + "scene")
        first = [await asyncio.wait_for(connection.read_message(), 5) for _ in viewer.scene.commands()]
        assert viewer.wait_for_browser(5)
        viewer._vis["fitted/1"].set_transform(np.eye(4))
        change = umsgpack.unpackb(await asyncio.wait_for(connection.read_message(), 5))
        connection.close()
        return first, change

    first, change = asyncio.run(follow())
    assert first == viewer.scene.commands()[: len(first)]
    assert change["path"] == "/meshcat/fitted/1"


def test_a_taken_port_and_closing_twice():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        viewer = Viewer()
        with pytest.raises(OSError):
            viewer.serve(taken.getsockname()[1])
    viewer.close()
    url = viewer.serve()
    assert not viewer.wait_for_browser(0.1)
    viewer.close()
    viewer.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(url, timeout=2)


def test_importing_and_showing_prints_nothing():
    code = "from linear_ik import *; v = Viewer(); v.serve(); v.close()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def live(viewer):
    """The ends [P][2][3] of the pairs that are drawn while a fit runs; None where there are none."""
    data = commands(viewer).get(("pairs/live", "set_object"))
    if data is None:
        return None
    place = data["object"]["geometries"][0]["data"]["attributes"]["position"]["array"].data
    return np.frombuffer(place, np.float32).reshape(-1, 2, 3)


def test_pairs_of_a_fit_that_runs_are_drawn_where_they_are_asked_for():
    element = column(segments=3, profile=RectangleHollow(0.2, 0.2, 0.01), location=(0, 0, 0))
    scan = simulate(element, bends=["2:y:20"], points=2000)
    wall = np.random.default_rng(0).uniform(20.0, 30.0, size=(500, 3))
    records = [replace(record, scale_m=scale) for record, scale in zip(
        fitted(element, scan).history, (math.inf, 0.03, 0.03, 0.03, 0.012), strict=True)]  # fmt: skip
    for asked in (False, True):
        viewer = Viewer()
        viewer.show_design(element)
        viewer.show_scan(Scan(np.concatenate([scan.points, wall])))
        viewer.follow_pairs(asked)
        lengths = []
        for record in records:
            viewer.on_iteration(record)
            ends = live(viewer)
            assert (ends is not None) == asked
            if ends is not None:
                lengths.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
                # Of the member's points, not of what is far off; no more than an eye tells apart.
                assert 0 < len(ends) <= MOST_PAIRS and np.abs(ends).max() < 5.0
        if asked:
            assert lengths[0].max() > 0.1  # all count
            assert all(size.max() <= 3 * 0.03 + 1e-6 for size in lengths[1:4]) and lengths[4].max() < 3 * 0.012
    viewer.show_result(fitted(element, scan), scan)
    assert live(viewer) is None  # those of the result's steps are in their place


def test_whoever_looks_says_whether_pairs_are_computed():
    from tornado.ioloop import IOLoop
    from tornado.websocket import websocket_connect

    viewer = Viewer()
    viewer.follow_pairs(True)
    assert viewer.scene.asked_for("pairs")  # for a file
    url = viewer.serve().replace("http", "ws") + "scene"

    async def look():
        assert not viewer.scene.asked_for("pairs")  # nobody looks
        page = await websocket_connect(url)
        await page.read_message()
        assert viewer.scene.asked_for("pairs")  # before the page has said anything
        await page.write_message("no pairs")
        await until(lambda: not viewer.scene.asked_for("pairs"))
        await page.write_message("pairs")
        await until(lambda: viewer.scene.asked_for("pairs"))
        page.close()
        await until(lambda: not viewer.scene.asked_for("pairs"))

    async def until(true):
        end = time.monotonic() + 10
        while not true() and time.monotonic() < end:
            await asyncio.sleep(0.01)
        assert true()

    try:
        IOLoop().run_sync(look)
    finally:
        viewer.close()


def test_the_scan_is_chosen_about_the_design_whatever_was_fitted(monkeypatch):
    element = replace(column(segments=3, profile=RectangleHollow(0.2, 0.2, 0.01)), length_tolerance_m=0.1)
    scan = simulate(element, points=500)
    result = replace(fitted(element, scan), length_m=element.length_m - 0.05, length_sd_m=0.001)
    about = []
    monkeypatch.setattr("linear_ik.viewer.rows_shown", lambda points, of: about.append(of) or np.arange(len(points)))
    Viewer().show_result(result, scan)
    assert about == [element] and result.fitted_element != element


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium (Debian: apt-get install chromium)")
def test_the_page_renders_in_a_browser(tmp_path):
    element = column(profile=RectangleHollow(0.3, 0.4, 0.01))
    scan = simulate(element, bends=["3:y:10", "4:y:10"], points=3000)
    viewer = Viewer()
    viewer.show_result(fitted(element, scan), scan)
    page = viewer.static_html(tmp_path / "page.html")
    shot = tmp_path / "shot.png"
    switches = (
        "--headless --no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader "
        "--disable-background-networking --no-first-run --disable-sync --disable-component-update --disable-quic "
        "--virtual-time-budget=8000 --window-size=800,600"
    ).split()
    command = [CHROMIUM, *switches, f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={shot}", page.as_uri()]
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    red, green, blue = np.asarray(Image.open(shot).convert("RGB")).astype(int).transpose(2, 0, 1)
    # The fitted member is green, what of the design it has left behind is nearly white.
    assert ((green > red + 25) & (green > blue + 15)).sum() > 2000
    grey = np.abs(red - green) + np.abs(green - blue)
    assert ((grey < 40) & (green > 145))[120:].sum() > 300


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium (Debian: apt-get install chromium)")
def test_the_slider_goes_through_the_iterations(tmp_path):
    element = column(segments=4, location=(0, 0, 0))
    scan = simulate(element, bends=["2:y:20"], points=500)
    viewer = Viewer()
    viewer.show_result(fitted(element, scan))
    page = viewer.static_html(tmp_path / "page.html")
    x = "viewer.scene_tree.find(['meshcat', 'fitted', '4']).object.position.x"

    def slide(tab, step):
        tab.ask(f"{{ const s = document.querySelector('#player input'); s.value = {step};"
                " s.dispatchEvent(new Event('input')); }")  # fmt: skip
        return tab.ask(x), tab.ask("document.querySelector('#player output').textContent")

    with browser(tmp_path / "profile") as tab:
        tab.open(page.as_uri())
        assert tab.ask("document.querySelector('#player label').hidden")  # no scan, no pairs
        assert tab.ask("document.querySelector('#player input').max") == "5"
        places = [slide(tab, step) for step in (0, 2, 5)]
        assert [text.split(",")[0] for _, text in places] == ["iteration 1 of 5", "iteration 3 of 5", "result"]
        assert places[0][0] + 0.1 < places[1][0] < places[2][0] - 0.1
        tab.ask("document.querySelector('#player button').click()")  # from the end it plays from the start
        moved = set()
        for _ in range(60):
            moved.add(round(tab.ask(x), 3))
            time.sleep(0.02)
        assert tab.wait("document.querySelector('#player button').textContent === 'Play'")
        assert len(moved) > 2 and tab.ask("document.querySelector('#player output').textContent") == "result"
        errors = [text for text in tab.complaints if "GL Driver Message" not in text]
        assert errors == [] and all(url.startswith(("file:", "data:")) for url in tab.requests)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium (Debian: apt-get install chromium)")
def test_a_live_view_renders_and_follows(tmp_path):
    """The served page: drawn, moved by each iteration, and after the result a slider and the pairs on request."""
    element = column(segments=4, profile=RectangleHollow(0.3, 0.3, 0.01), location=(0, 0, 0))
    scan = simulate(element, bends=["2:y:20"], points=1500)
    result = fitted(element, scan)
    viewer = Viewer()
    viewer.show_design(element)
    viewer.show_scan(scan)
    viewer.follow_pairs()
    url = viewer.serve()
    x = "viewer.scene_tree.find(['meshcat', 'fitted', '4']).object.position.x"
    paths = "[['pairs'], ['pairs', '0'], ['pairs', '5']]"
    visible = paths + ".map((p) => viewer.scene_tree.find(['meshcat', ...p]).object.visible)"
    try:
        with browser(tmp_path / "profile") as tab:
            online = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
            tab.send("Network.emulateNetworkConditions", **online)
            tab.open(url, 800, 600)
            assert viewer.wait_for_browser(20)
            places = []
            # Pairs while it runs: offered, drawn where somebody ticks the box, gone where nobody does.
            box = "document.querySelector('#player label input')"
            assert tab.wait("!document.querySelector('#player label').hidden") and not tab.ask(f"{box}.checked")
            assert tab.ask("document.querySelector('#player input').hidden")  # no slider yet
            for record in result.history:
                viewer.on_iteration(record)
                if record.iteration == 1:
                    assert live(viewer) is None
                    tab.ask(f"{box}.click()")
                    end = time.monotonic() + 10
                    while not viewer.scene.asked_for("pairs") and time.monotonic() < end:
                        time.sleep(0.02)
                elif record.iteration == 2:
                    assert len(live(viewer)) > 50
                    lines = "viewer.scene_tree.find(['meshcat', 'pairs', 'live', '<object>']).object"
                    assert tab.wait(f"{lines}.isLineSegments && {lines}.parent.parent.visible")
                    tab.ask(f"{box}.click()")
                    assert not tab.ask(f"{lines}.parent.parent.visible")
                here = matrix(viewer, "fitted/4")[0, 3]
                assert tab.wait(f"Math.abs({x} - {here}) < 1e-6"), record.iteration
                places.append(here)
            assert places[-1] - places[0] > 0.1
            viewer.show_result(result, scan)
            assert tab.wait("!document.querySelector('#player').hidden")
            # It plays once by itself.
            assert tab.wait(
                "document.querySelector('#player output').textContent === 'result' && !viewer.animator.playing"
            )
            assert tab.ask(visible) == [False, False, True]
            tab.ask("document.querySelector('#player label input').click()")
            assert tab.ask(visible) == [True, False, True]
            slide = "{ const s = document.querySelector('#player input'); s.value = 0;"
            tab.ask(slide + " s.dispatchEvent(new Event('input')); }")
            assert tab.ask(visible) == [True, True, False] and tab.ask(x) < places[-1] - 0.1
            time.sleep(2.0)  # software rendering takes its time
            with Image.open(tab.shot(tmp_path / "live.png")) as shot:
                red, green, blue = np.asarray(shot.convert("RGB")).astype(int).transpose(2, 0, 1)
            assert ((green > red + 25) & (green > blue + 15)).sum() > 1000  # the fitted member
            assert ((red > green + 60) & (blue > green + 60)).sum() > 100  # the pairs
            assert [text for text in tab.complaints if "GL Driver" not in text] == []
            assert all(url in one or one.startswith(("ws:", "data:", "about:")) for one in tab.requests)
    finally:
        viewer.close()


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium (Debian: apt-get install chromium)")
@pytest.mark.parametrize("lying", [False, True])
def test_a_phone_sees_the_whole_member_and_opens_the_legend(tmp_path, lying):
    axis = {"axis": (1.0, 0.0, 0.0), "ref_direction": (0.0, 1.0, 0.0)} if lying else {}
    element = Element("m", RectangleHollow(0.3, 0.3, 0.01), 3.0, 4, Placement((0.0, 0.0, 0.0), **axis))
    scan = simulate(element, bends=["3:y:4"], points=800)
    viewer = Viewer()
    viewer.show_result(fitted(element, scan), scan)
    page = viewer.static_html(tmp_path / "page.html")
    ends = """[0, 3].map(z => { const p = viewer.scene_tree.find(['meshcat', 'design']).object.localToWorld(
      viewer.camera.position.clone().set(0, 0, z)).project(viewer.camera);
      return [(p.x + 1) / 2 * innerWidth, (1 - p.y) / 2 * innerHeight]; })"""
    box = "(r => [r.left, r.top, r.right, r.bottom])(document.getElementById('%s').getBoundingClientRect())"
    with browser(tmp_path / "profile") as tab:
        for width, height in ((390, 844), (1280, 720)):
            tab.open(page.as_uri(), width, height)
            assert tab.wait("viewer.scene_tree.find(['meshcat', 'design', '<object>']).object.isMesh")
            tab.ask("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            left, top, right, bottom = tab.ask(box % "legend")
            player_top = tab.ask(box % "player")[1]
            for x, y in tab.ask(ends):
                assert 0 < x < width and 0 < y < player_top, (width, x, y)
                assert not (left < x < right and top < y < bottom), (width, x, y)
            assert tab.ask("document.getElementById('legend').open") == (width > 600)
            assert tab.ask("document.querySelector('#legend summary').textContent") == "Legend; status: converged"
            tab.ask("document.querySelector('#legend').open || document.querySelector('#legend summary').click()")
            assert tab.ask("document.getElementById('caption').getBoundingClientRect().height") > 60
            # meshcat's own panel; what each colour means, the ones between blue and red and the axes' included.
            assert tab.ask("[...document.querySelectorAll('.dg')].every(e => !e.getClientRects().length)")
            marks = tab.ask(
                "[...document.querySelectorAll('#caption i')].map(e => getComputedStyle(e).backgroundImage)"
            )
            assert sum("gradient" in mark for mark in marks) == 2
            assert tab.ask("document.documentElement.scrollWidth") <= width
        said = tab.ask("document.getElementById('caption').textContent")
        assert "status" not in said  # the heading has it
        for colour in ("blue", "yellow", "red", "grey", "X red, Y green, Z blue"):
            assert colour in said
