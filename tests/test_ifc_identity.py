"""GlobalIds that a file has twice, with blanks, or not at all: every product is fitted, drawn and named as itself."""

from __future__ import annotations

import ifcopenshell
import ifcopenshell.util.element
import numpy as np
import pytest
from asbuilt_samples import result_of
from ifc_files import IfcFile
from small_ifc import tessellated

import linear_ik
from linear_ik.cli import main
from linear_ik.deviation import deviations
from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc


def two_columns(*others):
    """Columns at x = 0 and 3 m, and what else stands there."""
    file = IfcFile()
    profile = file.new("IfcRectangleProfileDef", "AREA", "R", file.frame2d(), 0.2, 0.3)
    columns = [
        file.product(kind, file.extrusion(profile, 3.0), name=f"C{i}", tag=f"C{i}", placement=file.frame((3 * i, 0, 0)))
        for i, kind in enumerate(("IfcColumn", "IfcColumn", *others))
    ]
    return file, columns


def as_built(path, tmp_path):
    """What the design is read as, and the file of its members found as designed."""
    model = linear_ik.read_design(path, threads=1)
    results = {m.guid: result_of(m.element) for m in model.members}
    return model, ifcopenshell.open(str(write_asbuilt_ifc(path, results, tmp_path / "asbuilt.ifc")))


def sheets(model):
    """Tag -> what LinearIK_AsBuilt says."""
    every = model.by_type("IfcColumn") + model.by_type("IfcWall")
    return {p.Tag: ifcopenshell.util.element.get_pset(p, "LinearIK_AsBuilt") for p in every}


def items(model, tag):
    (product,) = (p for p in model.by_type("IfcProduct") if getattr(p, "Tag", None) == tag)
    return [len(r.Items) for r in product.Representation.Representations]


def test_of_two_elements_with_one_globalid_the_first_is_fitted_and_drawn(tmp_path):
    # A wall earlier in the file has it too: it is of no linear class.
    file, (first, second, wall) = two_columns("IfcWall")
    first.GlobalId = second.GlobalId = wall.GlobalId
    model, built = as_built(file.write(tmp_path / "m.ifc"), tmp_path)
    assert [m.tag for m in model.members] == ["C0"]
    assert [(one.name, one.reason) for one in model.left_out] == [("C1", "its GlobalId is that of another element")]
    said = sheets(built)
    assert (said["C0"]["Status"], said["C1"]["Status"], said["C2"]) == ("converged", "not fitted", None)
    assert said["C1"]["Reasons"] == "its GlobalId is that of another element."
    assert items(built, "C0") == [1, 10] and items(built, "C1") == items(built, "C2") == [1]
    sheet_guids = [s.GlobalId for s in built.by_type("IfcPropertySet")]
    assert len(set(sheet_guids)) == len(sheet_guids) == 2


def test_a_first_element_that_is_left_out_keeps_its_globalid(tmp_path):
    file, (first, second) = two_columns()
    first.Representation.Representations[0].Items[0].Depth = 0.1
    second.GlobalId = first.GlobalId
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert not model.members and len(model.left_out) == 2


@pytest.mark.parametrize("blank", [" ", "\t"])
def test_blanks_in_a_globalid_are_none_of_it(blank, tmp_path):
    file, (first, _) = two_columns()
    guid = first.GlobalId
    first.GlobalId = guid + blank
    model, built = as_built(file.write(tmp_path / "m.ifc"), tmp_path)
    assert [m.guid for m in model.members][0] == guid
    assert {tag: said["Status"] for tag, said in sheets(built).items()} == {"C0": "converged", "C1": "converged"}


def test_elements_without_a_globalid_are_left_out_and_stand_in_the_way(tmp_path, capsys):
    file, (first, _, wall) = two_columns("IfcWall")
    first.GlobalId = wall.GlobalId = None
    path = file.write(tmp_path / "m.ifc")
    for threads in (1, 2):
        model = linear_ik.read_design(path, threads=threads)
        assert [m.tag for m in model.members] == ["C1"]
        assert [(one.guid, one.reason) for one in model.left_out] == [("", "it has no GlobalId")]
        # Their points are not the other column's.
        assert sorted((o.guid, o.ifc_class, o.vertices_m[:, 0].min().round(3)) for o in model.obstacles) == [
            ("", "IfcColumn", -0.1),
            ("", "IfcWall", 5.9),
        ]
    _, built = as_built(path, tmp_path)
    assert {tag: said and said["Status"] for tag, said in sheets(built).items()} == {
        "C0": "not fitted",
        "C1": "converged",
        "C2": None,
    }
    assert sheets(built)["C0"]["Reasons"] == "it has no GlobalId."
    first = next(p for p in built.by_type("IfcColumn") if p.Tag == "C0")
    first.GlobalId = "0" * 22  # so that the kernel draws it
    assert np.ptp(tessellated(built, "0" * 22)[0][:, 2]) == pytest.approx(3.0)
    assert main(["check", str(path)]) == 0
    assert "it has no GlobalId" in capsys.readouterr().out


@pytest.mark.parametrize("status", ["converged", "not_scanned"])
def test_an_owner_history_without_a_user_costs_nothing(status, tmp_path):
    file, (first, _) = two_columns()
    organisation = file.new("IfcOrganization", None, "x")
    application = file.new("IfcApplication", organisation, "1", "n", "i")
    first.OwnerHistory = file.new("IfcOwnerHistory", None, application, None, "ADDED", 1, None, None, 1)
    path = file.write(tmp_path / "m.ifc")
    results = {m.guid: result_of(m.element, status=status) for m in linear_ik.read_design(path, threads=1).members}
    built = ifcopenshell.open(str(write_asbuilt_ifc(path, results, tmp_path / "asbuilt.ifc")))
    assert {said["Status"] for said in sheets(built).values()} == {status.replace("_", " ")}


def test_a_body_is_not_replaced_where_its_figures_cannot_be_written(tmp_path, monkeypatch):
    file, _ = two_columns()
    path = file.write(tmp_path / "m.ifc")
    good, bad = (result_of(m.element) for m in linear_ik.read_design(path, threads=1).members)
    guids = [m.guid for m in linear_ik.read_design(path, threads=1).members]
    left = []

    def fails(result):
        if result is bad:
            raise ValueError("no figures")
        return deviations(result)

    monkeypatch.setattr("linear_ik.asbuilt.properties.deviations", fails)
    out = write_asbuilt_ifc(
        path,
        dict(zip(guids, (good, bad), strict=True)),
        tmp_path / "out.ifc",
        on_left=lambda guid, what: left.append((guid, what)),
    )
    built = ifcopenshell.open(str(out))
    assert left == [(guids[1], "ValueError: no figures")]
    assert {tag: said["Shape"] for tag, said in sheets(built).items()} == {"C0": "as built", "C1": "as designed"}
    assert items(built, "C0") == [1, 10] and items(built, "C1") == [1]
