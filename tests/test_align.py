"""Alignment: a scan from anywhere laid on its design, and what it says where that cannot be done."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from small_ifc import write_small_ifc

from linear_ik.align import Alignment, align
from linear_ik.alignment.bodies import turned_outward
from linear_ik.alignment.quality import Cloud, quality
from linear_ik.alignment.target import Target
from linear_ik.alignment.thinning import Thinner, thin
from linear_ik.cli import main
from linear_ik.cli.fit_model import read_transform
from linear_ik.design_model import DesignModel, Member, Obstacle
from linear_ik.element import Element, Placement
from linear_ik.errors import LinearIkError, ScanError, SettingsError
from linear_ik.exports.scan_file import write_scan
from linear_ik.profile import Circle, IShape, Profile, Rectangle, RectangleHollow
from linear_ik.scan import Scan
from linear_ik.scene import box_mesh, element_mesh

H, BEAM, BRACE = IShape(0.3, 0.3, 0.011, 0.019), Rectangle(0.2, 0.4), Circle(0.1)
CORNERS = ((0.0, 0.0), (8.0, 0.0), (8.0, 5.0), (0.0, 5.0))
MIDDLE = np.array([4.0, 2.5, 2.0])


def member(i: int, profile: Profile, start: tuple, end: tuple) -> Member:
    along = tuple(b - a for a, b in zip(start, end, strict=True))
    element = Element(f"m{i}", profile, float(np.linalg.norm(along)), 6, Placement(start, along))
    return Member(f"G{i}", "IfcBeam", f"m{i}", "", "", element)


def frame(symmetric: bool = False) -> DesignModel:
    """Four columns and four beams; a brace and a beam more where it is not symmetric."""
    rows = [(H, (x, y, 0.0), (x, y, 4.0)) for x, y in CORNERS]
    rows += [(BEAM, (*CORNERS[i], 4.0), (*CORNERS[(i + 1) % 4], 4.0)) for i in range(4)]
    if not symmetric:
        rows += [(BRACE, (0.0, 0.0, 0.0), (8.0, 0.0, 4.0)), (BEAM, (5.5, 0.0, 4.0), (5.5, 5.0, 4.0))]
    return DesignModel("frame.ifc", "IFC4", 1.0, tuple(member(i, *row) for i, row in enumerate(rows)))


def scan_of(design: DesignModel, seed: int, bent: int | None = None, noise_m: float = 0.002) -> np.ndarray:
    """What one station sees of the faces that look towards it (not of what hides behind), and of a floor."""
    rng, station = np.random.default_rng(seed), np.array([3.0, -8.0, 1.5])
    parts = [np.column_stack([rng.uniform(-5, 13, 2500), rng.uniform(-5, 10, 2500), np.zeros(2500)])]
    for i, one in enumerate(design.members):
        element, angles = one.element, one.element.design.angles_rad.copy()
        if isinstance(element.profile, RectangleHollow):  # nobody sees its inside
            element = replace(element, profile=Rectangle(element.profile.x_dim, element.profile.y_dim))
        if i == bent:
            angles[2:5, 0] += 0.02
        vertices, triangles = element_mesh(element, joint_angles_rad=angles)
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        k = rng.choice(len(areas), 2500, p=areas / areas.sum())
        u, v = rng.random((2, 2500))
        u, v = np.where(u + v > 1, 1 - u, u)[:, None], np.where(u + v > 1, 1 - v, v)[:, None]
        points = a[k] + u * (b - a)[k] + v * (c - a)[k]
        parts.append(points[np.einsum("ij,ij->i", normals[k], station - points) > 0])
    points = np.concatenate(parts)
    return points + noise_m * rng.standard_normal(points.shape)


def motion(seed: int, far_m: float = 50.0) -> np.ndarray:
    """A heading and a translation: T_scan_model."""
    rng = np.random.default_rng(seed)
    c, s = np.cos(angle := rng.uniform(0, 2 * np.pi)), np.sin(angle)
    T = np.eye(4)
    T[:2, :2], T[:3, 3] = [[c, -s], [s, c]], rng.uniform(-far_m, far_m, 3)
    return T


def moved(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def error(found: Alignment, T_scan_model: np.ndarray) -> tuple[float, float]:
    """How far the middle of the frame is off, in metres, and the turn, in degrees."""
    E = found.T_model_scan @ T_scan_model
    turn = np.arccos(np.clip((np.trace(E[:3, :3]) - 1) / 2, -1, 1))
    return float(np.linalg.norm(moved(MIDDLE[None], E)[0] - MIDDLE)), float(np.degrees(turn))


@cache
def aligned(seed: int, far_m: float = 50.0) -> tuple[Alignment, np.ndarray]:
    T = motion(seed, far_m)
    return align(frame(), moved(scan_of(frame(), seed, bent=seed % 8), T)), T


@pytest.mark.parametrize(("seed", "far_m"), [(1, 50.0), (2, 400_000.0)], ids=["near", "map coordinates"])
def test_a_scan_from_anywhere_is_laid_on_its_design(seed: int, far_m: float) -> None:
    found, T = aligned(seed, far_m)
    off_m, turn_deg = error(found, T)
    assert found.status == "aligned" and not found.reasons
    assert off_m < 0.002 and turn_deg < 0.02
    assert 0.001 < found.rms_m < 0.006 and found.tilt_deg < 0.02
    # Turned by half a circle the frame is nearly the same: that must be known, and be worse.
    assert found.alternatives and found.alternatives[0].score < 0.95 * found.score


SLAB = box_mesh((4.0, 2.5, -0.1), (12.0, 9.0, 0.2))


@pytest.mark.parametrize(("seed", "stations"), [(1, True), (2, False)])
def test_a_floor_is_laid_on_the_top_of_its_slab(seed: int, stations: bool) -> None:
    design = replace(frame(), obstacles=(Obstacle("S", "IfcSlab", SLAB.vertices, SLAB.triangles),))
    rng, T = np.random.default_rng(seed), motion(seed)
    floor = np.column_stack(
        [rng.uniform(-2, 10, 20_000), rng.uniform(-2, 7, 20_000), 0.002 * rng.standard_normal(20_000)]
    )
    points = moved(np.concatenate([scan_of(design, seed, bent=seed % 8)[2500:], floor]), T)
    station = moved(np.array([[3.0, -8.0, 1.5]]), T)
    found = align(design, Scan(points, None, station, np.zeros(len(points), np.int32)) if stations else points)
    off_m, turn_deg = error(found, T)
    assert found.status == "aligned" and off_m < 0.005 and turn_deg < 0.05


def on_underside(stations: np.ndarray | None, turned: bool = False) -> float:
    """The share of a floor's points that count when it is laid on the underside of a slab 0.2 m below it."""
    triangles = SLAB.triangles[:, ::-1] if turned else SLAB.triangles
    target = Target(replace(frame(), obstacles=(Obstacle("S", "IfcSlab", SLAB.vertices, triangles),)))
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-1, 9, 2000), rng.uniform(-1, 6, 2000), np.full(2000, -0.2)])
    floor = floor - target.origin_m
    seen_from = np.full(floor.shape, np.nan) if stations is None else np.tile(stations - target.origin_m, (2000, 1))
    return quality(target, Cloud(floor, seen_from, 0.1), np.eye(4)).scan_share


def test_faces_count_for_points_that_can_have_been_measured_on_them() -> None:
    above, below = np.array([4.0, 2.0, 1.5]), np.array([4.0, 2.0, -3.0])
    for turned in (False, True):  # whichever way the file has its triangles
        assert on_underside(above, turned) == 0.0
        assert on_underside(below, turned) == 1.0
        assert on_underside(None, turned) == 0.0  # nothing of the scan lies below it


def test_only_closed_bodies_have_an_outside() -> None:
    outward, thick_m = turned_outward(SLAB.vertices, SLAB.triangles[:, ::-1])
    assert {tuple(sorted(t)) for t in outward} == {tuple(sorted(t)) for t in SLAB.triangles}
    np.testing.assert_array_equal(outward, SLAB.triangles[:, ::-1][:, ::-1])
    assert 0.15 < thick_m < 0.2
    assert turned_outward(SLAB.vertices, SLAB.triangles[1:])[1] == 0.0
    one_turned = np.concatenate([SLAB.triangles[:1, ::-1], SLAB.triangles[1:]])
    assert turned_outward(SLAB.vertices, one_turned)[1] == 0.0


def test_a_symmetric_design_is_ambiguous_and_a_guess_settles_it() -> None:
    design, T = frame(symmetric=True), motion(3)
    points = moved(scan_of(design, 3), T)
    found = align(design, points)
    assert found.status == "ambiguous" and "nearly as good" in found.reasons[0]
    both = [found.T_model_scan, *(a.T_model_scan for a in found.alternatives[:1])]
    off = [np.linalg.norm(moved(MIDDLE[None] + [4, 0, 0], M @ T)[0] - MIDDLE - [4, 0, 0]) for M in both]
    assert min(off) < 0.002 and max(off) > 7.9  # one is right, the other turned by half a circle
    guess = np.linalg.inv(T)
    guess[:3, 3] += [0.1, -0.1, 0.05]
    settled = align(design, points, near=guess)
    assert settled.status == "aligned" and error(settled, T)[0] < 0.002


def test_a_scan_of_something_else_is_not_aligned() -> None:
    rows = [(H, (x, y, 0.0), (x, y, 6.0)) for x, y in ((0.0, 0.0), (11.0, 0.0), (11.0, 9.0), (3.0, 12.0))]
    other = DesignModel("other.ifc", "IFC4", 1.0, tuple(member(i, *row) for i, row in enumerate(rows)))
    found = align(frame(), moved(scan_of(other, 4), motion(4)))
    assert found.status == "not_found" and "something else" in found.reasons[1]


def test_a_guess_that_is_far_off_is_not_believed() -> None:
    _, T = aligned(1)
    guess = np.linalg.inv(T)
    guess[:3, 3] += [3.0, 2.0, 1.0]
    assert align(frame(), moved(scan_of(frame(), 1), T), near=guess).status == "not_found"


def test_one_column_alone_slides() -> None:
    column = DesignModel("one.ifc", "IFC4", 1.0, (member(0, H, (0.0, 0.0, 0.0), (0.0, 0.0, 4.0)),))
    points = scan_of(column, 5)[2500:]
    found = align(column, points[(points[:, 2] > 1) & (points[:, 2] < 3)], near=np.eye(4))
    assert found.status == "ambiguous" and "may have slid" in " ".join(found.reasons)


# thinning --------------------------------------------------------------------------------


def test_thinning_is_the_same_however_a_scan_is_cut_into_pieces() -> None:
    points = np.random.default_rng(6).uniform(-3, 3, (20_000, 3)) + [5e5, 5e6, 100]
    thinned = thin([points], 0.2)
    whole = thinned.points()
    np.testing.assert_array_equal(whole, thin(np.array_split(points, 13), 0.2).points())
    cells = np.floor(whole / 0.2)
    assert thinned.voxel_m == 0.2 and len(np.unique(cells, axis=0)) == len(whole)
    assert (whole[:, None] == points[None, :50]).all(axis=2).any()  # real points, not means


def test_strays_far_away_are_dropped_and_counted() -> None:
    """A scanner writes (0, 0, 0) for a pulse that did not come back; the map's origin is 5000 km away."""
    points = np.random.default_rng(7).uniform(-3, 3, (5000, 3)) + [5e5, 5e6, 100]
    thinned = thin([np.concatenate([np.zeros((1, 3)), points]), np.zeros((2, 3))], 0.2)
    np.testing.assert_array_equal(thinned.points(), thin([points], 0.2).points())
    assert thinned.dropped == 3
    with pytest.raises(ScanError, match="5,000 of 5,010 points lie more than 210 km from"):
        thin([np.zeros((10, 3)), points], 0.2)


def test_a_point_at_the_origin_of_the_map_does_not_stop_an_alignment() -> None:
    T = motion(2, 400_000.0)
    lost = np.array([[0.0, 0.0, 0.0], [np.nan, 1.0, 2.0], [np.nan, np.nan, np.nan]])
    found = align(frame(), np.concatenate([lost, moved(scan_of(frame(), 2, bent=2), T)]))
    assert found.status == "aligned" and error(found, T)[0] < 0.002
    assert found.reasons == (
        "Points left out, more than 31 km from the others: 1.",
        "Left out: 2 points without usable coordinates, withheld or noise.",
    )


def test_voxels_grow_when_there_are_too_many() -> None:
    thinner = Thinner(0.01, most=1000)
    for seed in range(5):
        thinner.add(np.random.default_rng(seed).uniform(0, 1, (2000, 3)))
    assert 200 < len(thinner.points()) <= 1000 and thinner.voxel_m > 0.05
    with pytest.raises(ScanError):
        Thinner(0.1).points()


# the command -----------------------------------------------------------------------------


def test_the_command_writes_what_fit_takes(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    design = write_small_ifc(tmp_path / "design.ifc", "IFC4")
    from linear_ik.bim import read_design

    T = motion(7)
    guess = tmp_path / "guess.txt"
    near = np.linalg.inv(T)
    near[:3, 3] += [0.05, 0.1, -0.05]
    np.savetxt(guess, near)
    points = moved(scan_of(read_design(design), 7)[2500:], T)
    write_scan(Scan(points), tmp_path / "site.ply")
    arguments = ["align", str(design), str(tmp_path / "site.ply"), "--near", str(guess), "-o"]
    assert main([*arguments, str(tmp_path / "new" / "T.txt")]) == 0
    said = capsys.readouterr()
    assert "status     aligned" in said.err and not said.out
    E = read_transform(tmp_path / "new" / "T.txt") @ T
    assert np.abs(moved(MIDDLE[None], E)[0] - MIDDLE).max() < 0.002
    assert main([*arguments, "-", "-q"]) == 0
    assert capsys.readouterr().out == (tmp_path / "new" / "T.txt").read_text()
    np.savetxt(guess, np.eye(4))
    assert main([*arguments, str(tmp_path / "none.txt")]) == 3
    assert not (tmp_path / "none.txt").exists() and "something else" in capsys.readouterr().err


def test_bad_input_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SettingsError, match="scans"):
        align(frame())
    with pytest.raises(SettingsError, match="near"):
        align(frame(), np.zeros((5, 3)), near=np.eye(4) * 2)
    with pytest.raises(LinearIkError, match="has no bodies"):
        align(DesignModel("empty.ifc", "IFC4", 1.0, ()), np.zeros((5, 3)))
    assert main(["align", str(tmp_path / "no.ifc"), str(tmp_path / "no.ply"), "-o", str(tmp_path / "T.txt")]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'no.ifc'}: no such file")
