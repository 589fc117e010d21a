"""`linear-ik check`: what it says of a design and of scans of it, where the truth is known."""

import json
import tracemalloc

import numpy as np
import pytest
from ifc_files import IfcFile

import linear_ik
from linear_ik.cli import main
from linear_ik.design_model import DesignModel
from linear_ik.exports.scan_file import write_scan
from linear_ik.scan import Scan
from linear_ik.simulate import simulate
from linear_ik.site_check import SiteCheck
from linear_ik.site_frames import Hits, compare_frames

POINTS = 6000


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A frame of four members and a map conversion, and the scan of all but one of them, in the model's coordinates."""
    folder = tmp_path_factory.mktemp("site")
    file = IfcFile("IFC4", "millimetre", north=(0.5, np.sqrt(0.75)))
    column = file.new("IfcIShapeProfileDef", "AREA", "HEB200", file.frame2d(), 200, 200, 9, 15, 18)
    beam = file.new("IfcRectangleHollowProfileDef", "AREA", "RHS 200x100x8", file.frame2d(), 100, 200, 8, None, None)
    for i, (x, y) in enumerate([(0, 0), (6000, 0), (6000, 4000)]):
        placement = file.frame((x, y, 0))
        file.product("IfcColumn", file.extrusion(column, 3500), placement=placement, tag=f"C{i + 1}", extra=(None,))
    file.beam(file.extrusion(beam, 6000), placement=file.frame((0, 0, 3600), (1, 0, 0), (0, 1, 0)), tag="B1")
    plate = file.new("IfcRectangleProfileDef", "AREA", "PL10", file.frame2d(), 300, 300)
    file.beam(file.extrusion(plate, 10), tag="P1", name="plate")
    metre = file.new("IfcSIUnit", None, "LENGTHUNIT", None, "METRE")
    crs = file.new("IfcProjectedCRS", "EPSG:25832", None, None, None, None, None, metre)
    file.new("IfcMapConversion", file.context, crs, 500000.0, 5400000.0, 100.0, 0.8, 0.6, 0.001)
    path = file.write(folder / "design.ifc")
    model = linear_ik.read_design(path, threads=1)
    seen = [m for m in model.members if m.tag != "C2"]
    points = [simulate(m.element, points=POINTS, noise_m=0.002, seed=i).points for i, m in enumerate(seen)]
    floor = np.random.default_rng(1).uniform([-5, -5, -0.5], [12, 9, -0.5], (4000, 3))
    return folder, path, model, np.concatenate([*points, floor])


def check_json(path, scans, capsys):
    code = main(["check", str(path), *map(str, scans), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_the_design_alone(site, capsys):
    assert main(["check", str(site[1])]) == 0
    out = capsys.readouterr().out
    for said in (
        "design     design.ifc: IFC4, in millimetres",
        "EPSG:25832: origin at E 500000.000 N 5400000.000 H 100.000, X turned 36.870 degrees from east, ",
        " from east, a metre of the model is 1 m of the map\n",
        "true north is 30.00 degrees right of the model's Y",
        "elements   4 to fit",
        "3  IfcColumn  HEB200         i shape",
        "1  IfcBeam    RHS 200x100x8  rectangle hollow",
        "1  IfcBeam  it is a plate, not linear: 300 x 300 x 10 mm  such as plate",
    ):
        assert said in out, said


def test_a_scan_in_place(site, tmp_path, capsys):
    _, path, model, points = site
    write_scan(Scan(points), tmp_path / "scan.ply")
    code, found = check_json(path, [tmp_path / "scan.ply"], capsys)
    assert code == 0 and found["schema"] == "linear_ik/check/1"
    (scan,) = found["scans"]
    assert (scan["points"], scan["place"], scan["sentences"], scan["stations"]) == (len(points), "model", [], None)
    np.testing.assert_allclose(scan["extent_m"], [points.min(axis=0), points.max(axis=0)], atol=1e-6)
    by_tag = {one["tag"]: one for one in found["elements"]}
    assert {tag: one["covered"] for tag, one in by_tag.items()} == {"C1": True, "C2": False, "C3": True, "B1": True}
    # A column's own points, and none of the beam that rests on it.
    assert by_tag["C3"]["points"] == pytest.approx(POINTS, rel=0.02)
    assert by_tag["C3"]["points_per_m"] == pytest.approx(POINTS / 3.5, rel=0.02)
    # The outline of a HEB200: 1.151 m a metre.
    assert by_tag["C3"]["points_per_m2"] == pytest.approx(POINTS / 3.5 / 1.151, rel=0.03)
    # The beam ends at its top.
    assert by_tag["C2"]["points"] < 10
    assert scan["points_near"] == pytest.approx(3 * POINTS, rel=0.02)


def test_it_says_so_in_words(site, tmp_path, capsys):
    np.savetxt(tmp_path / "scan.xyz", np.insert(site[3], 5, np.nan, axis=0))
    assert main(["check", str(site[1]), str(tmp_path / "scan.xyz")]) == 0
    out = capsys.readouterr().out
    for said in (
        f"scan       scan.xyz: {len(site[3]):,} points, stations unknown",
        "left out   1 point without usable coordinates, withheld or noise",
        "place      in the model's coordinates",
        "overlap    3 of 4 elements are covered: at least half of their segments seen",
        "density    points a metre of length: least ",
        "           points a m2 of surface: least ",
        "not seen   C2 HEB200: ",
    ):
        assert said in out, said


def test_a_scan_in_another_unit_is_told_the_line_to_type(site, tmp_path, capsys):
    write_scan(Scan(site[3] * 1000), tmp_path / "scan.ply")
    assert main(["check", str(site[1]), str(tmp_path / "scan.ply")]) == 3
    out = capsys.readouterr().out
    assert " m, as if in metres\n" in out
    assert "next       type the line again with --scan-unit mm to see the overlap\n" in out
    assert "overlap    none of 4 elements, as the scans lie\n" in out
    assert main(["check", str(site[1]), str(tmp_path / "scan.ply"), "--scan-unit", "mm"]) == 0
    out = capsys.readouterr().out
    assert "as if" not in out and "overlap    3 of 4 elements are covered" in out


def test_two_scans_cover_more_than_one(site, tmp_path, capsys):
    _, path, model, points = site
    (missing,) = (m for m in model.members if m.tag == "C2")
    write_scan(Scan(points), tmp_path / "a.ply")
    write_scan(Scan(simulate(missing.element, points=2000, seed=9).points), tmp_path / "b.ply")
    code, found = check_json(path, [tmp_path / "a.ply", tmp_path / "b.ply"], capsys)
    assert code == 0
    assert all(one["covered"] for one in found["elements"])
    assert [scan["file"] for scan in found["scans"]] == ["a.ply", "b.ply"]


FEET = 0.3048
SWAPPED = [0, 2, 1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p * 1000, "it seems to be in millimetres: times 0.001 it would be where the model is"),
        (lambda p: p / FEET, "it seems to be in feet: times 0.3048 it would be where the model is"),
        (lambda p: p / 0.0254, "it seems to be in inches"),
        (lambda p: p / 1000, "it seems to be in metres taken for millimetres"),
        (
            lambda p: p[:, SWAPPED],
            "it seems to have y and z swapped: turned it would be where the model is (export it again",
        ),
        (lambda p: p[:, SWAPPED] * [1, 1, -1], "it seems to have y up instead of z"),
        (lambda p: p + [700000.0, 6000000.0, 0], "from the model, and its map conversion doesn't lead there"),
        (lambda p: p + [300.0, 0, 0], "m from the model's elements (linear-ik align"),
    ],
)
def test_what_keeps_the_two_apart(change, said, site, tmp_path, capsys):
    _, path, _, points = site
    write_scan(Scan(change(points)), tmp_path / "scan.ply")
    code, found = check_json(path, [tmp_path / "scan.ply"], capsys)
    assert code == 3
    assert found["scans"][0]["place"] == "elsewhere"
    assert any(said in sentence for sentence in found["scans"][0]["sentences"]), found["scans"][0]["sentences"]
    assert not any(one["covered"] for one in found["elements"])


def test_a_scan_around_the_model_but_not_on_it_is_sent_to_align():
    sample = np.random.default_rng(1).uniform(0, 5, (500, 3))
    box_m = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 5.0]])
    model = DesignModel("design.ifc", "IFC4", 1.0, ())
    found = compare_frames(model, sample, box_m, lambda points: Hits(0.01, 2))
    assert found.sentences == (
        "it is around the model, but only 1.0 % of its points are near an element "
        "(linear-ik align finds the motion between them)",
    )


def test_a_scan_on_the_map(site, tmp_path, capsys):
    _, path, model, points = site
    write_scan(Scan(model.map_conversion.to_map(points)), tmp_path / "scan.ply")
    code, found = check_json(path, [tmp_path / "scan.ply"], capsys)
    assert code == 0
    assert found["scans"][0]["place"] == "map"
    assert sum(one["covered"] for one in found["elements"]) == 3


def test_a_scan_is_checked_as_the_fit_will_place_it(site, tmp_path, capsys):
    _, path, model, points = site
    T = np.eye(4)
    T[:3, :3] = [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = 40.0, -30.0, 2.0
    write_scan(Scan((points - T[:3, 3]) @ T[:3, :3]), tmp_path / "turned.ply")
    write_scan(Scan(model.map_conversion.to_map(points)), tmp_path / "map.ply")
    np.savetxt(tmp_path / "T.txt", T)
    np.savetxt(tmp_path / "back.txt", np.linalg.inv(T))
    assert check_json(path, [tmp_path / "turned.ply"], capsys)[0] == 3
    for scan, options in (
        ("turned.ply", ["--transform", tmp_path / "T.txt"]),
        ("turned.ply", ["--transform", tmp_path / "back.txt", "--inverse"]),
        ("map.ply", ["--map"]),
    ):
        code, found = check_json(path, [tmp_path / scan, *options], capsys)
        assert (code, found["scans"][0]["place"]) == (0, "model"), options
        assert sum(one["covered"] for one in found["elements"]) == 3
        np.testing.assert_allclose(found["scans"][0]["extent_m"], [points.min(axis=0), points.max(axis=0)], atol=1e-3)


def test_a_scan_on_the_map_in_feet(site, tmp_path, capsys):
    _, path, model, points = site
    write_scan(Scan(model.map_conversion.to_map(points) / FEET), tmp_path / "scan.ply")
    _, found = check_json(path, [tmp_path / "scan.ply"], capsys)
    assert "in feet: times 0.3048 and the map conversion taken back" in found["scans"][0]["sentences"][0]


def test_without_a_map_conversion_the_distance_is_named():
    from linear_ik.design_model import DesignModel, Member
    from linear_ik.element import Element
    from linear_ik.profile import Rectangle

    element = Element("b", Rectangle(0.1, 0.2), 5.0)
    model = DesignModel("m.ifc", "IFC4", 1.0, (Member("g", "IfcBeam", "b", "b", "", element),))
    points = simulate(element, points=1000).points + [512000.0, 0, 0]
    found = SiteCheck(model).scan("s", lambda: [Scan(points)])
    assert found.finding.sentences == (
        "it is 512 km from the model, and the model has no map conversion: is one of them in map coordinates?",
    )


def test_pieces_and_stations_are_added_up(site):
    _, _, model, points = site
    index = np.zeros(len(points), dtype=np.int32)
    pieces = [Scan(points[i::3], stations=np.array([[i // 2, 0.0, 1.0]]), station_index=index[i::3]) for i in range(3)]
    check = SiteCheck(model)
    whole, apart = check.scan("w", lambda: [Scan(points)]), check.scan("p", lambda: pieces)
    assert (apart.points, apart.stations, whole.stations) == (len(points), 2, None)
    np.testing.assert_array_equal(whole.near, apart.near)


def test_memory_does_not_grow_with_the_scan(site):
    check = SiteCheck(site[2])

    def peak(pieces):
        rng = np.random.default_rng(0)
        tracemalloc.start()
        try:
            check.scan("s", lambda: (Scan(rng.uniform(-5, 12, (1_000, 3))) for _ in range(pieces)))
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    some = peak(200)
    assert peak(600) < some + 2e6


def test_far_from_the_origin_nothing_changes(site):
    """A model that itself is on the map."""
    from dataclasses import replace

    _, _, model, points = site
    offset = np.array([500000.0, 5400000.0, 0])

    def moved(member):
        placement = member.element.placement
        return replace(
            member,
            element=replace(member.element, placement=replace(placement, location=tuple(placement.location + offset))),
        )

    far = replace(model, members=tuple(map(moved, model.members)), map_conversion=None)
    near = SiteCheck(model).scan("s", lambda: [Scan(points)]).near
    np.testing.assert_allclose(SiteCheck(far).scan("s", lambda: [Scan(points + offset)]).near, near, atol=3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.ifc"], "error: none.ifc: no such file"),
        (["{design}", "none.e57"], "error: none.e57: no such file"),
        (["{design}", "--class", "IfcWall"], "error: --class: 'IfcWall' (of IfcBeam"),
        (["{design}", "--slenderness", "-1"], "error: --slenderness: -1.0"),
        (["{design}", "{scan}", "--inverse"], "error: --inverse: given without --transform"),
        (["{design}", "{scan}", "--transform", "none.txt"], "error: none.txt: cannot be read"),
        (["{design}", "--slenderness", "1000", "{scan}"], "error: design.ifc: has no element that could be fitted"),
    ],
)
def test_bad_input_is_one_line(arguments, said, site, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_scan(Scan(site[3][:100]), tmp_path / "scan.ply")
    filled = [a.format(design=site[1], scan="scan.ply") for a in arguments]
    assert main(["check", *filled]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith(said) and err.count("\n") == 1


def test_a_design_in_the_wrong_unit_looks_odd(tmp_path, capsys):
    # Written in metres, said to be in millimetres: a beam 0.3 mm deep.
    file = IfcFile("IFC4", "millimetre")
    file.beam(file.extrusion(file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.2, 0.3), 4))
    assert main(["check", str(file.write(tmp_path / "m.ifc"))]) == 0
    assert "WARNING    half of its sections are below 0.0003 m: is its unit right?" in capsys.readouterr().out
