"""The curve behind a chain: a sag is none of its polyline, a kink stays a kink."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from command import run
from posed import BEAM, H, bent, posed

import linear_ik
from linear_ik import Circle, Element, Placement, simulate, smooth_axis, write_smooth_glb
from linear_ik.deviation import deviations
from linear_ik.deviation_bands import BAND_95, Bands
from linear_ik.smooth_axis import curve_of, kinks, node_operator

FINE, LENGTH_M, SAG_M = 100, 5.0, 0.040
LYING = Placement((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def slopes(kind):
    """Of the fine chain's segments, of a member that sags by 40 mm between its ends."""
    z = (np.arange(FINE) + 0.5) / FINE
    return {
        "circle": np.linspace(-1.0, 1.0, FINE) * np.arctan(4.0 * SAG_M / LENGTH_M),
        "parabola": np.arctan(4.0 * SAG_M / LENGTH_M * (2.0 * z - 1.0)),
        "clamped": np.arctan(-np.pi * SAG_M / LENGTH_M * np.sin(2.0 * np.pi * z)),
    }[kind]


def sagging(kind, seed, segments=10):
    """The fit of some segments to a finely bent member, its true nodes [FINE + 1][3] and offsets from the chord."""
    angles = np.zeros((FINE, 3))
    angles[:, 0] = np.diff(slopes(kind), prepend=0.0)
    scan = simulate(Element("m", H, LENGTH_M, FINE, LYING), joint_angles_rad=angles, seed=seed)
    result = linear_ik.fit(Element("m", H, LENGTH_M, segments, LYING), scan.without_truth())
    nodes = scan.nodes_m
    chord = (nodes[-1] - nodes[0]) / np.linalg.norm(nodes[-1] - nodes[0])
    off = nodes - nodes[0]
    return result, nodes, np.linalg.norm(off - (off @ chord)[:, None] * chord, axis=1)


def best_chain(y, segments, held):
    """Values [N+1] of the polyline that fits evenly spread values y [K] best, its first and last one held or not."""
    t = np.linspace(0, segments, len(y))
    hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - np.arange(segments + 1)))
    free = np.arange(1 if held[0] else 0, segments + (0 if held[1] else 1))
    n = np.zeros(segments + 1)
    n[0], n[-1] = (y[0] if held[0] else 0.0), (y[-1] if held[1] else 0.0)
    n[free] = np.linalg.lstsq(hats[:, free], y - hats @ n, rcond=None)[0]
    return n


@pytest.mark.parametrize("held", [(True, False), (False, False), (True, True), (False, True)])
@pytest.mark.parametrize("segments", [5, 10, 11])
def test_the_operator_undoes_what_fitting_a_polyline_does(segments, held):
    z = np.linspace(0.0, 1.0, 22_001)
    y = 0.040 * 4.0 * z * (1.0 - z)
    n, at = best_chain(y, segments, held), np.linspace(0, 22_000, segments + 1).astype(int)
    smooth = np.zeros(segments + 1, dtype=bool)
    # Outside by h^2 / 12 R: of 40 mm that is 40 * 8 / 12 N^2.
    assert np.abs(n - y[at]).max() > 0.9 * 0.040 * 8 / 12 / segments**2
    np.testing.assert_allclose(node_operator(segments, smooth, held) @ n, y[at], atol=2e-5 / segments)
    np.testing.assert_allclose(
        node_operator(segments, np.ones(segments + 1, dtype=bool), held), np.eye(segments + 1), atol=1e-12
    )


@pytest.mark.parametrize("segments", [5, 7])
def test_the_middle_of_an_odd_number_of_segments_is_seen(segments):
    """At the nodes an arc of 40 mm shows 1.6 and 0.8 mm less."""
    result, _, off = sagging("circle", 0, segments)
    d = deviations(result)
    at_nodes = np.linalg.norm(d.offset_m.xy, axis=1).max()
    assert off.max() - at_nodes > 0.9 * SAG_M / segments**2
    for figure in (d.bow_m, d.sag_m):
        assert abs(figure.value) == pytest.approx(off.max(), abs=figure.band) and figure.band < 4e-4
        assert figure.s_m == pytest.approx(LENGTH_M / 2, abs=0.1)
    assert abs(d.camber_m.value) == pytest.approx(off.max(), abs=d.camber_m.band)


@pytest.mark.parametrize("kind", ["circle", "clamped"])
def test_sag_and_w_of_s_are_those_of_the_curve(kind):
    chain, curve, scores, along = [], [], [], []
    for seed in range(6):
        result, _, off = sagging(kind, seed)
        d, own = deviations(result), deviations(result, smooth=False)
        chain.append(abs(own.sag_m.value) - off.max())
        curve.append(abs(d.sag_m.value) - off.max())
        scores.append(curve[-1] / d.sag_m.band * BAND_95)
        along.append(np.linalg.norm(d.offset_m.xy, axis=1) - off[::10])
    assert np.mean(chain) > (0.0006 if kind == "clamped" else 0.00005)
    assert abs(np.mean(curve)) < 0.00012
    assert np.sqrt(np.mean(np.square(along))) < 0.00018
    assert np.sum(np.square(scores)) < 18.5  # 99.5 % of a chi-square of 6


def test_points_and_tangents_follow_the_true_curve():
    result, nodes, _ = sagging("circle", 1)
    axis = smooth_axis(result, pieces=10)
    assert axis.kinks == () and len(axis.points_m) == FINE + 1
    across = (axis.points_m - nodes)[:, 1:]
    assert np.abs(across).max() < 0.0006
    true = np.diff(nodes, axis=0)
    true /= np.linalg.norm(true, axis=1)[:, None]
    middle = (axis.tangents[1:] + axis.tangents[:-1]) / 2
    assert np.abs(middle - true).max() < 0.002
    # Of the chain they are off by half a bend, 1.6 mrad, at every joint.
    np.testing.assert_allclose(np.linalg.norm(axis.tangents, axis=1), 1.0)
    np.testing.assert_allclose(axis.rotations[:, :, 2], axis.tangents, atol=1e-12)
    np.testing.assert_allclose(
        axis.rotations.transpose(0, 2, 1) @ axis.rotations, np.tile(np.eye(3), (101, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(axis.s_m[[0, -1]], [0.0, LENGTH_M])


def test_a_kink_stays_a_kink_and_both_sides_are_smooth():
    element = Element("m", H, 5.0, 20, BEAM)
    angles = bent(element, 0, 0.02)
    angles[8, 0] += np.radians(5.0)
    result = posed(element, angles)
    axis = smooth_axis(result)
    assert axis.kinks == (8,)
    twice = np.flatnonzero(np.diff(axis.s_m) == 0.0)
    assert len(twice) == 1
    np.testing.assert_array_equal(axis.points_m[twice], axis.points_m[twice + 1])
    left = np.degrees(np.arccos(np.clip(axis.tangents[twice[0]] @ axis.tangents[twice[0] + 1], -1, 1)))
    assert left == pytest.approx(5.0, abs=0.4)
    others = np.einsum("ki,ki->k", axis.tangents[1:], axis.tangents[:-1])
    assert np.degrees(np.arccos(np.clip(np.delete(others, twice), -1, 1))).max() < 0.2


def test_bends_that_jump_from_joint_to_joint_are_no_curve():
    element = Element("m", H, 5.0, 20, BEAM)
    angles = np.zeros((20, 3))
    angles[1:, :2] = np.radians(np.random.default_rng(0).uniform(-2.0, 2.0, (19, 2)))
    result = posed(element, angles)
    assert kinks(result)[1:-1].all()
    axis = smooth_axis(result, pieces=1)
    np.testing.assert_allclose(axis.points_m[::2], result.nodes_m[:-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(deviations(result).offset_m.xy, deviations(result, smooth=False).offset_m.xy, atol=1e-12)


def test_nodes_stay_the_chains_and_straight_members_straight():
    element = Element("m", Circle(0.05), 2.0, 1, BEAM)
    result = posed(element, np.zeros((1, 3)))
    axis = smooth_axis(result, pieces=2)
    np.testing.assert_allclose(axis.points_m[[0, -1]], result.nodes_m, rtol=0, atol=1e-9)
    two = posed(Element("m", Circle(0.05), 2.0, 2, BEAM), np.radians([[0.0, 0, 0], [3.0, 0, 0]]))
    assert smooth_axis(two).kinks == (1,)


def test_bands_go_with_the_curve():
    result = posed(Element("m", H, 5.0, 10, BEAM), bent(Element("m", H, 5.0, 10, BEAM), 0, 0.02))
    D, bands = curve_of(result), Bands.of(result)
    flat = np.kron(D, np.eye(3))
    carried = bands.carried(D)
    np.testing.assert_allclose(
        carried.joint.reshape(33, 33), flat @ bands.joint.reshape(33, 33) @ flat.T, rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(carried.own, [carried.joint[k, :, k] for k in range(11)], rtol=0, atol=0)
    # Nodes that do not say how they vary together: the chain itself.
    alone = replace(result, configuration_covariance=None)
    chain = deviations(result, smooth=False)
    np.testing.assert_array_equal(deviations(alone).offset_m.xy, chain.offset_m.xy)
    assert np.abs(deviations(result).offset_m.xy - chain.offset_m.xy).max() > 1e-4


def test_a_smooth_body(tmp_path):
    import trimesh

    element = Element("m", H, 5.0, 10, BEAM)
    result = posed(element, bent(element, 0, 0.1))
    path = write_smooth_glb(result, tmp_path / "new" / "m.glb")
    scene = trimesh.load_scene(path)
    body = scene.geometry["member"]
    assert body.is_watertight and body.volume == pytest.approx(0.1 * 0.2 * 5.0, rel=0.01)
    extras = scene.metadata["linear_ik"]
    points = np.array(extras["axis_m"]) + extras["local_origin_m"]
    np.testing.assert_allclose(points, smooth_axis(result).points_m, rtol=0, atol=1e-6)
    assert json.dumps(extras)


def test_a_kinked_body_is_mitred_and_its_axis_has_each_node_once(tmp_path):
    import trimesh

    element, angles = Element("m", H, 2.0, 5), np.zeros((5, 3))
    angles[1, 0], angles[3, 1] = np.radians(-25.0), np.radians(-20.0)
    scene = trimesh.load_scene(write_smooth_glb(posed(element, angles), tmp_path / "m.glb"))
    extras, body = scene.metadata["linear_ik"], scene.geometry["member"]
    axis = np.array(extras["axis_m"])
    assert len(axis) == 21 and (np.linalg.norm(np.diff(axis, axis=0), axis=1) > 0.09).all()
    # A mitre takes from one side what it gives to the other: the volume is that of the straight member.
    assert body.is_watertight and body.volume == pytest.approx(0.1 * 0.2 * 2.0, rel=1e-4)
    assert len(np.unique(body.vertices.round(6), axis=0)) == 4 * 21
    assert scene.graph.transforms.parents["member"] == "scan"
    # Too sharp for its short segments: the body keeps both of its sections there.
    angles[1, 0] = np.radians(-150.0)
    scene = trimesh.load_scene(write_smooth_glb(posed(Element("m", H, 2.0, 5), angles), tmp_path / "m.glb"))
    assert len(scene.metadata["linear_ik"]["axis_m"]) == 21
    assert len(np.unique(scene.geometry["member"].vertices.round(6), axis=0)) == 4 * 22


def test_a_chain_without_a_smooth_curve_is_said(tmp_path):
    angles = np.zeros((5, 3))
    angles[1, 0], angles[3, 1] = np.radians(-25.0), np.radians(-20.0)
    element = Element("m", H, 2.0, 5)
    np.savetxt(tmp_path / "scan.xyz", simulate(element, joint_angles_rad=angles, seed=9, points=3000).points)
    (tmp_path / "bar.yaml").write_text(
        "name: m\nprofile: {type: rectangle, x_dim: 0.1, y_dim: 0.2}\nlength: 2.0\nsegments: 5\n"
    )
    done = run("fit", "bar.yaml", "scan.xyz", "-o", "r.json", "--glb", "m.glb", "--smooth", cwd=tmp_path)
    assert done.returncode == 0 and not done.stdout
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("smooth")]
    assert line == "smooth     no curve: the bends jump from joint to joint, so the body keeps the segments' corners"
    assert "smooth" not in run("fit", "bar.yaml", "scan.xyz", "-o", "r.json", "--glb", "m.glb", cwd=tmp_path).stderr


def test_the_command_line(tmp_path):
    scan = simulate(Element("m", H, 2.5, 5), seed=9, points=3000)
    np.savetxt(tmp_path / "scan.xyz", scan.points)
    (tmp_path / "bar.yaml").write_text(
        "name: m\nprofile: {type: rectangle, x_dim: 0.1, y_dim: 0.2}\nlength: 2.5\nsegments: 5\n"
    )
    done = run("fit", "bar.yaml", "scan.xyz", "-o", "r.json", "--smooth", cwd=tmp_path)
    assert done.returncode == 2 and not (tmp_path / "r.json").exists()
    assert done.stderr == "error: --smooth: given without --glb (--glb OUT.glb)\n"
    done = run("fit", "bar.yaml", "scan.xyz", "-o", "r.json", "--glb", "m.glb", "--smooth", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert b'"member"' in (tmp_path / "m.glb").read_bytes()
