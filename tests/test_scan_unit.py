"""Scans in other units than metres: said by the person, or by the file, and converted."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from copc_files import write_copc
from site_samples import GUIDS, only, site

import linear_ik
from linear_ik.align import align
from linear_ik.cli import main
from linear_ik.coordinates import NAMES, SCAN_UNITS, unit_hint
from linear_ik.errors import LinearIkError, ScanError, SettingsError
from linear_ik.model_fit import ModelFitOptions, fit_model

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))

from benchlib.building import building  # noqa: E402
from benchlib.building_ifc import write_ifc  # noqa: E402

POINTS = np.random.default_rng(0).uniform(0, 3, (200, 3)) + [0, 0, 7]
BEAM = "name: b\nprofile: {type: rectangle, x_dim: 0.1, y_dim: 0.3}\nlength: 2.5\n"


@pytest.mark.parametrize("unit", SCAN_UNITS)
def test_points_and_stations_become_metres(tmp_path, unit):
    factor = SCAN_UNITS[unit]
    linear_ik.write_scan(linear_ik.Scan(POINTS / factor), tmp_path / "a.ply")
    np.testing.assert_allclose(linear_ik.read_scan(tmp_path / "a.ply", unit=unit).points, POINTS, rtol=1e-15)
    station = " ".join(str(v) for v in np.array([1.0, 2.0, 3.0]) / factor)
    head = f"1\n1\n{station}\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{station} 1\n"
    (tmp_path / "a.ptx").write_text(head + f"{1 / factor} 0 0 0.5\n")
    scan = linear_ik.read_scan(tmp_path / "a.ptx", unit=unit)
    np.testing.assert_allclose(scan.stations, [[1, 2, 3]])
    np.testing.assert_allclose(scan.points, [[2, 2, 3]])


def test_millimetres_on_a_map_are_not_too_far_away(tmp_path):
    (tmp_path / "a.xyz").write_text("500000000.5 5400000000.25 100000\n")
    with pytest.raises(ScanError, match="is it in millimetres"):
        linear_ik.read_scan(tmp_path / "a.xyz")
    np.testing.assert_allclose(
        linear_ik.read_scan(tmp_path / "a.xyz", unit="mm").points, [[500000.0005, 5400000.00025, 100]], rtol=1e-15
    )


def test_what_the_columns_say_must_be_what_the_person_says(tmp_path):
    (tmp_path / "a.csv").write_text("x [mm],y [mm],z [mm]\n1000,2000,3000\n")
    np.testing.assert_allclose(linear_ik.read_scan(tmp_path / "a.csv", unit="mm").points, [[1, 2, 3]])
    for unit in ("m", "ft"):
        with pytest.raises(ScanError, match="numbers are in mm.*--scan-unit mm"):
            linear_ik.read_scan(tmp_path / "a.csv", unit=unit)
    (tmp_path / "a.csv").write_text("x [mm],y [mm],z [m]\n1000,2000,3000\n")
    with pytest.raises(ScanError, match="m and mm"):
        linear_ik.read_scan(tmp_path / "a.csv", unit="mm")


@pytest.mark.parametrize(
    "comment",
    [
        "# x[mm] y[mm] z[mm]",
        "# x [mm] y [mm] z [mm]",
        "x [mm] y [mm] z [mm]",
        "// X (mm);Y (mm);Z (mm)",
        "# x[mm] y[mm] z[mm] intensity",
        "# x y z (mm)",
        "# x y z\n# x [ millimetres ] y [ millimetres ] z [ millimetres ]",
        "# X [mm], Y [mm], Z [mm]\nx y z",
        "# x_mm y_mm z_mm",
        "x_mm y_mm z_mm",
        "# X_mm;Y_mm;Z_mm;intensity",
        "# units: mm",
        "// Unit = millimetres",
        "# unit of length is mm",
        "# coordinates are given in millimetres\nx y z",
    ],
)
def test_a_unit_counts_wherever_it_is_named(tmp_path, comment):
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1000 2000 3000\n")
    with pytest.raises(ScanError, match="--scan-unit mm"):
        linear_ik.read_scan(path)
    np.testing.assert_allclose(linear_ik.read_scan(path, unit="mm").points, [[1, 2, 3]])


@pytest.mark.parametrize("comment", ["# units: m", "# unit is in metres", "# x_m y_m z_m", "# points in m"])
def test_metres_are_what_is_expected(tmp_path, comment):
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1 2 3\n")
    np.testing.assert_array_equal(linear_ik.read_scan(path).points, [[1, 2, 3]])


def test_names_of_columns_bind_the_person_too(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("# x_m y_m z_m\n1 2 3\n")
    with pytest.raises(ScanError, match="in m, not mm"):
        linear_ik.read_scan(path, unit="mm")


@pytest.mark.parametrize(
    "comment",
    [
        "# units of accuracy: mm",
        "# Unit of intensity: mm",
        "# range noise values are in mm",
        "# numbers in mm",
        "# units: mm (accuracy), coordinates in m",
        "# units: mm/s",
        "# x y z (local)",
        "# x (easting) y (northing) z (height)",
        "# x [m] y [m] z [m]",
        "# x, y, z (see 1)",
        "# unit: LeicaP40",
        "# units in the scan: 3",
        "# points in file: 1",
    ],
)
def test_remarks_in_brackets_are_no_units(tmp_path, comment):
    """Nor are the units of anything but the coordinates."""
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1 2 3\n")
    np.testing.assert_array_equal(linear_ik.read_scan(path).points, [[1, 2, 3]])


@pytest.mark.parametrize(
    "comment, unit",
    [
        ("# units: u.s. survey feet", "us-ft"),
        ("# units: US Survey Foot", "us-ft"),
        ("# unit = Foot_US", "us-ft"),
        ("# units of measure: international feet", "ft"),
        ("# coordinates in feet.", "ft"),
        ("# units: in", "in"),
    ],
)
def test_other_ways_to_name_feet(tmp_path, comment, unit):
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1 2 3\n")
    with pytest.raises(ScanError, match=f"--scan-unit {unit}$|--scan-unit {unit}\\)$"):
        linear_ik.read_scan(path)


@pytest.mark.parametrize("comment", ["# units: km", "# units: microns", "# unit = µm", "# points in kilometres"])
def test_a_length_that_is_no_unit_of_a_scan_is_never_read_as_metres(tmp_path, comment):
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1 2 3\n", encoding="utf-8")
    with pytest.raises(ScanError, match="line 1 says that its unit is .*--scan-unit"):
        linear_ik.read_scan(path)


@pytest.mark.parametrize("comment", ["# units: mm", "# units: km", "# units: mm\n# coordinates in feet"])
def test_the_person_has_the_last_word_on_a_comment(tmp_path, comment):
    path = tmp_path / "a.xyz"
    path.write_text(f"{comment}\n1 2 3\n")
    with pytest.raises(ScanError):
        linear_ik.read_scan(path)
    np.testing.assert_array_equal(linear_ik.read_scan(path, unit="m").points, [[1, 2, 3]])
    np.testing.assert_allclose(linear_ik.read_scan(path, unit="cm").points, [[0.01, 0.02, 0.03]])


def test_a_comment_and_columns_that_contradict_each_other(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("# units: mm\nx[m],y[m],z[m]\n1,2,3\n")
    with pytest.raises(ScanError, match="in m and mm"):
        linear_ik.read_scan(path)


def test_columns_and_units_that_stand_apart(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("# z [us survey feet] y [us survey feet] x [us survey feet]\n3 2 1\n")
    with pytest.raises(ScanError, match="--scan-unit us-ft"):
        linear_ik.read_scan(path)
    points = linear_ik.read_scan(path, unit="us-ft").points
    np.testing.assert_allclose(points, SCAN_UNITS["us-ft"] * np.array([[1.0, 2.0, 3.0]]))
    path.write_text("# x [km] y [km] z [km] intensity\n1 2 3\n")
    with pytest.raises(ScanError, match=r"column x\[km\] is not in metres"):
        linear_ik.read_scan(path)


def test_a_unit_that_is_none_is_refused_before_anything_is_read(tmp_path, capsys):
    with pytest.raises(SettingsError, match="unit: 'miles' .*m, mm, cm, in, ft, us-ft"):
        linear_ik.read_scan(tmp_path / "no.ply", unit="miles")
    with pytest.raises(SettingsError, match="scan_unit: 'miles'"):
        ModelFitOptions(scan_unit="miles")
    for verb in (
        ["fit", "b.yaml", "s.ply", "-o", "r.json"],
        ["check", "d.ifc"],
        ["align", "d.ifc", "s.ply", "-o", "T"],
    ):
        assert main([*verb, "--scan-unit", "miles"]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert err.startswith("error: --scan-unit: 'miles'")


@pytest.mark.parametrize("unit", NAMES)
def test_what_is_recognised_says_how_it_is_converted(unit):
    beam = np.random.default_rng(0).uniform([-0.05, -0.15, 0], [0.05, 0.15, 2.5], (5000, 3))
    assert f"in {NAMES[unit]}" in (unit_hint(beam / SCAN_UNITS[unit], np.eye(4), 2.5) or "") or unit == "us-ft"
    assert f"--scan-unit {unit}" in (unit_hint(beam / SCAN_UNITS[unit], np.eye(4), 2.5) or "") or unit == "us-ft"


def test_one_element_is_fitted_to_a_scan_in_millimetres(tmp_path, capsys):
    (tmp_path / "b.yaml").write_text(BEAM)
    element = linear_ik.load_element(tmp_path / "b.yaml")
    truth = linear_ik.simulate(element, bends=["8:y:5"], points=4000, seed=1)
    linear_ik.write_scan(linear_ik.Scan(truth.points * 1000), tmp_path / "mm.ply")
    words = ["fit", str(tmp_path / "b.yaml"), str(tmp_path / "mm.ply"), "-o", str(tmp_path / "r.json")]
    assert main(words) == 3
    assert "--scan-unit mm" in capsys.readouterr().err
    assert main([*words, "--scan-unit", "mm"]) == 0
    assert np.abs(linear_ik.read_result(tmp_path / "r.json").nodes_m - truth.nodes_m).max() < 1e-3


def test_a_building_is_fitted_to_a_scan_in_feet(tmp_path):
    built = site(tmp_path)
    points = np.round(linear_ik.read_scan(built.scan).points / 0.3048, 5)
    write_copc(tmp_path / "ft.copc.laz", points, 1e-5)
    model = only(built.design, GUIDS[2])
    out = tmp_path / "out"
    found = fit_model(model, [tmp_path / "ft.copc.laz"], out, options=ModelFitOptions(workers=0, scan_unit="ft"))
    assert found.fitted == 1
    nodes = linear_ik.read_result(out / "elements" / f"{GUIDS[2]}.json").nodes_m
    assert np.abs(nodes - built.truth[GUIDS[2]])[:, 1:].max() < 1e-3
    report = json.loads((out / "run.json").read_text())
    assert report["options"]["scan_unit"] == "ft"
    assert np.ptp([report["scan_points"]["low_m"], report["scan_points"]["high_m"]], axis=0).max() < 5
    # Nobody said so: refused, and what is there stays.
    with pytest.raises(LinearIkError, match="in feet"):
        fit_model(model, [tmp_path / "ft.copc.laz"], out, options=ModelFitOptions(workers=0))
    assert json.loads((out / "run.json").read_text()) == report
    # In metres it is another scan: nothing is taken over.
    metres = ModelFitOptions(workers=0, scan_unit="m")
    assert fit_model(model, [tmp_path / "ft.copc.laz"], out, options=metres).fitted == 0


def test_align_takes_the_unit_too(tmp_path):
    built = site(tmp_path)
    points = linear_ik.read_scan(built.scan).points
    linear_ik.write_scan(linear_ik.Scan(points * 1000), tmp_path / "mm.ply")
    found = align(built.design, tmp_path / "mm.ply", near=np.eye(4), unit="mm")
    assert np.abs(found.T_model_scan - np.eye(4)).max() < 0.02


def test_check_takes_the_unit_too(tmp_path, capsys):
    pytest.importorskip("ifcopenshell")
    plan = building(1, 1, 1, pipes=0, seed=3)
    write_ifc(plan, tmp_path / "design.ifc")
    parts = [linear_ik.simulate(m.element, points=500, seed=i).points for i, m in enumerate(plan.design.members)]
    linear_ik.write_scan(linear_ik.Scan(np.concatenate(parts) * 1000), tmp_path / "mm.ply")
    words = ["check", str(tmp_path / "design.ifc"), str(tmp_path / "mm.ply")]
    assert main(words) == 3
    assert "--scan-unit mm" in capsys.readouterr().out
    assert main([*words, "--scan-unit", "mm"]) == 0
    assert "--scan-unit" not in capsys.readouterr().out
