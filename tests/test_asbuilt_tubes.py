"""As-built tubes and bars: what a geometry kernel makes of them is closed, whole and where the fit says."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

ifcopenshell = pytest.importorskip("ifcopenshell")

from asbuilt_samples import result_of  # noqa: E402
from small_ifc import COLUMN, write_small_ifc  # noqa: E402

from linear_ik.asbuilt.directrix import smooth_directrix  # noqa: E402
from linear_ik.asbuilt.shape import bent_shape, skin  # noqa: E402
from linear_ik.bim.curves import directrix  # noqa: E402
from linear_ik.element import Element, Placement  # noqa: E402
from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc  # noqa: E402
from linear_ik.profile import Circle, CircleHollow  # noqa: E402
from linear_ik.result import FitResult  # noqa: E402

AT = Placement((0.3, 0.2, 0.1), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0))
TUBE, BAR = CircleHollow(0.084, 0.0045), Circle(0.084)
# What a kernel is asked for: its own choice, and one tenth of a millimetre.
DEFLECTIONS = (None, 1e-4)


def noise(segments: int, largest_rad: float) -> np.ndarray:
    """The small turns that a fit leaves at each joint."""
    angles = np.zeros((segments, 3))
    angles[:, :2] = np.random.default_rng(0).uniform(-largest_rad, largest_rad, (segments, 2))
    return angles


def straight(section: Circle | CircleHollow, turn_rad: np.ndarray) -> FitResult:
    """Fourteen segments of half a metre, bent in one plane, with a fit's noise."""
    angles = noise(14, 2e-5)
    angles[:, 0] += turn_rad
    return result_of(Element("tube", section, 7.0, 14, AT), angles)


def sagging(section: Circle | CircleHollow) -> FitResult:
    """20 mm in the middle of 7 m: an even bend."""
    return straight(section, np.r_[-13 / 2, np.ones(13)] * 8 * 0.020 / 7.0 / 14)


def s_bend(section: Circle | CircleHollow) -> FitResult:
    return straight(section, 0.02 * np.sin(2 * np.pi * np.arange(14) / 14))


def one_kink(section: Circle | CircleHollow) -> FitResult:
    return straight(section, np.where(np.arange(14) == 7, np.radians(10.0), 0.0))


def elbow(section: Circle | CircleHollow, radius_m: float = 0.4) -> FitResult:
    """A bend of 90 degrees as it is designed, between two straight pieces, with a fit's noise."""
    turn = np.linspace(0.0, np.pi / 2, 60)
    bend = radius_m * np.column_stack([np.zeros(60), 1 - np.cos(turn), np.sin(turn)])
    line = np.concatenate([[[0, 0, 0]], bend + [0, 0, 1.0], [[0, radius_m + 1.0, radius_m + 1.0]]])
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    element = Element("elbow", section, length, 36, AT, axis_points=tuple(map(tuple, line.tolist())))
    return result_of(element, element.design.angles_rad + noise(36, 2e-4))


def wide_bend(section: Circle | CircleHollow) -> FitResult:
    """An elbow of which each kink becomes an arc; those of the tight one stay corners."""
    return elbow(section, 0.8)


def drawn(path: Path, deflection: float | None) -> tuple[np.ndarray, np.ndarray]:
    """What the kernel makes of the column, read anew: vertices [V][3], triangles [T][3]."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    if deflection is not None:
        settings.set("mesher-linear-deflection", deflection)
        settings.set("mesher-angular-deflection", 0.1)
    model = ifcopenshell.open(str(path))
    geometry = ifcopenshell.geom.create_shape(settings, model.by_guid(COLUMN)).geometry
    return np.array(geometry.verts).reshape(-1, 3), np.array(geometry.faces).reshape(-1, 3)


def open_edges(triangles: np.ndarray) -> int:
    edges = Counter(tuple(sorted(e)) for t in triangles.tolist() for e in (t[:2], t[1:], t[::2]))
    return sum(times != 2 for times in edges.values())


def volume_m3(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis((vertices - vertices[0])[triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def from_line_m(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """How far points [P][3] are from a polyline."""
    legs = np.diff(line, axis=0)
    off = points - line[:-1, None]
    part = np.clip(np.einsum("kpi,ki->kp", off, legs) / (legs**2).sum(axis=1)[:, None], 0, 1)
    return np.linalg.norm(off - part[:, :, None] * legs[:, None], axis=2).min(axis=0)


def from_surface_m(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> float:
    import trimesh

    return float(trimesh.proximity.closest_point(trimesh.Trimesh(vertices, triangles, process=False), points)[1].max())


def written(folder: Path, schema: str, result: FitResult) -> Path:
    design = write_small_ifc(folder / "design.ifc", schema)
    return write_asbuilt_ifc(design, {COLUMN: result}, folder / "asbuilt.ifc")


@pytest.mark.parametrize("section", [TUBE, BAR], ids=["tube", "bar"])
@pytest.mark.parametrize("shape", [sagging, s_bend, one_kink, elbow, wide_bend])
def test_a_kernel_draws_round_members_closed_and_whole(tmp_path: Path, shape, section) -> None:
    result = shape(section)
    nodes = result.nodes_m
    path = written(tmp_path, "IFC4", result)
    bore = section.radius - getattr(section, "wall_thickness", section.radius)
    meant = np.pi * (section.radius**2 - bore**2) * np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()
    wanted, _ = skin(bent_shape(result))
    for deflection in DEFLECTIONS:
        vertices, triangles = drawn(path, deflection)
        assert open_edges(triangles) == 0
        assert volume_m3(vertices, triangles) == pytest.approx(meant, rel=0.01)
        # Hollow ones keep their bore: each vertex is on the tube's outside or on its inside.
        away = from_line_m(vertices, nodes)
        radii = np.array([section.radius, *[bore] * (bore > 0)])
        assert np.abs(away[:, None] - radii).min(axis=1).max() < 0.001
        assert all((np.abs(away - radius) < 0.001).sum() > 50 for radius in radii)
        # A chord of the kernel's own choice is up to a millimetre inside the tube.
        if deflection is not None:
            assert from_surface_m(wanted, vertices, triangles) < 0.001
        again = drawn(path, deflection)
        np.testing.assert_array_equal(again[0], vertices)
        np.testing.assert_array_equal(again[1], triangles)
    model = ifcopenshell.open(str(path))
    (disk,) = next(
        r.Items for r in model.by_guid(COLUMN).Representation.Representations if r.RepresentationIdentifier == "Body"
    )
    # The column's own coordinates are the model's.
    assert from_line_m(nodes, directrix(disk, 0.001)).max() < 0.0005


def test_bends_are_arcs_where_an_arc_stays_near_and_corners_where_none_does() -> None:
    kinks = {shape: smooth_directrix(shape(TUBE).nodes_m, TUBE.radius) for shape in (sagging, wide_bend, elbow)}
    assert sum(kinks[sagging].arcs) == 13 and max(len(run) for run in kinks[sagging].runs) == 3
    assert max(len(run) for run in kinks[wide_bend].runs) == 3
    # A straight piece with corners in it.
    assert max(len(run) for run, arc in zip(kinks[elbow].runs, kinks[elbow].arcs, strict=True) if not arc) > 5


@pytest.mark.parametrize("shape", [elbow, one_kink])
def test_in_ifc2x3_a_sharp_bend_is_one_disk_too(tmp_path: Path, shape) -> None:
    result = shape(TUBE)
    path = written(tmp_path, "IFC2X3", result)
    model = ifcopenshell.open(str(path))
    assert len(model.by_type("IfcSweptDiskSolid")) == 1
    vertices, triangles = drawn(path, 1e-4)
    assert open_edges(triangles) == 0
    assert from_surface_m(skin(bent_shape(result))[0], vertices, triangles) < 0.001


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4X3"])
def test_the_file_with_a_disk_is_as_valid_as_the_design(tmp_path: Path, schema: str) -> None:
    import ifcopenshell.validate

    path = written(tmp_path, schema, elbow(TUBE))
    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(str(path), logger, express_rules=True)
    assert [str(s.get("message", s)) for s in logger.statements] == []


# the line --------------------------------------------------------------------------------


def test_a_line_that_is_straight_to_rounding_is_two_points() -> None:
    x = np.linspace(0.0, 6.0, 15)
    line = smooth_directrix(np.column_stack([x, 2e-6 * np.sin(3 * x), 0 * x]), 0.05)
    assert line.runs == ((0, 1),) and line.arcs == (False,)


@pytest.mark.parametrize("degrees", [0.01, 0.3, 5.0, 9.0])
def test_arcs_are_tangent_and_pass_near_their_nodes(degrees: float) -> None:
    a = np.radians(degrees)
    nodes = np.array([[0, 0, 0], [0.5, 0, 0], [0.5 + 0.5 * np.cos(a), 0.5 * np.sin(a), 0]])
    line = smooth_directrix(nodes, 0.05)
    assert line.runs == ((0, 1), (1, 2, 3), (3, 4)) and line.arcs == (False, True, False)
    start, middle, end = line.points_m[1:4]
    # The chords of half an arc lean against the tangents by a quarter of its angle.
    for chord, leg in ((middle - start, nodes[1] - nodes[0]), (end - middle, nodes[2] - nodes[1])):
        cosine = chord @ leg / np.linalg.norm(chord) / np.linalg.norm(leg)
        assert np.arccos(min(cosine, 1.0)) == pytest.approx(a / 4, abs=1e-6)
    assert np.linalg.norm(middle - nodes[1]) < (1e-5 if degrees < 1 else 3e-4)


def test_a_corner_that_no_arc_comes_near_stays() -> None:
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1.0, 0]])
    line = smooth_directrix(nodes, 0.05)
    assert line.runs == ((0, 1, 2),) and line.arcs == (False,)
    np.testing.assert_array_equal(line.points_m, nodes)
