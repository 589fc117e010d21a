"""Which of a product's representations is its body, when a design is read and when an as-built one is written."""

from __future__ import annotations

import csv

import ifcopenshell
import ifcopenshell.util.element
import pytest
from asbuilt_samples import result_of
from ifc_files import IfcFile

import linear_ik
from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc
from linear_ik.profile import IShape


def read(file, path):
    model = linear_ik.read_design(file.write(path), threads=1)
    assert not model.left_out, model.left_out
    (member,) = model.members
    return model, member


def beam(file):
    section = file.new("IfcIShapeProfileDef", "AREA", "IPE", file.frame2d(), 0.15, 0.3, 0.0071, 0.0107, 0.015)
    return file.beam(file.extrusion(section, 6.0))


def box(file, context, identifier):
    """A box around the beam of `beam`, 400 mm longer."""
    section = file.new("IfcRectangleProfileDef", "AREA", "R", file.frame2d(), 0.4, 0.4)
    solid = file.extrusion(section, 6.4, file.frame((0, 0, -0.2)))
    return file.new("IfcShapeRepresentation", context, identifier, "SweptSolid", [solid])


def subcontext(file, identifier, view):
    return file.new(
        "IfcGeometricRepresentationSubContext", identifier, "Model", None, None, None, None, file.context, None, view,
        None,
    )  # fmt: skip


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("other", ["Body", "Mesh", "Clearance", "Reference", "Box"])
def test_the_body_of_the_model_view_is_read_whatever_stands_beside_it(first, other, tmp_path):
    file = IfcFile()
    made = beam(file)
    both = [*made.Representation.Representations, box(file, subcontext(file, other, "SKETCH_VIEW"), other)]
    made.Representation.Representations = both[::-1] if first else both
    # Obstacles too: a wall is what its body is, not the space in front of it.
    section = file.new("IfcRectangleProfileDef", "AREA", "R", file.frame2d(), 0.1, 3.0)
    wall = file.product("IfcWall", file.extrusion(section, 2.0), placement=file.frame((9, 0, 0)))
    wall.Representation.Representations = [*wall.Representation.Representations, box(file, file.context, "Clearance")]
    model, member = read(file, tmp_path / "m.ifc")
    assert member.element.profile == IShape(0.15, 0.3, 0.0071, 0.0107, 0.015)
    assert member.element.length_m == pytest.approx(6.0)
    several = "read from one of the 2 representations of its body"
    assert member.remark == (several if other in ("Body", "Mesh") else "")
    (obstacle,) = model.obstacles
    assert obstacle.vertices_m[:, 2].max() == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["Mesh", "Body-FallBack", "Body-Fallback", "Facetation", None])
def test_a_body_of_another_name_is_read_and_replaced(name, tmp_path):
    file = IfcFile()
    beam(file).Representation.Representations[0].RepresentationIdentifier = name
    model, member = read(file, tmp_path / "m.ifc")
    assert not model.obstacles and not member.remark
    assert isinstance(member.element.profile, IShape)
    out = write_asbuilt_ifc(tmp_path / "m.ifc", {member.guid: result_of(member.element)}, tmp_path / "out.ifc")
    model = ifcopenshell.open(str(out))
    (built,) = model.by_type("IfcBeam")
    shown = {r.RepresentationIdentifier: len(r.Items) for r in built.Representation.Representations}
    assert shown == {"Axis": 1, "Body": member.element.segments}


def test_an_as_built_file_that_keeps_the_design_is_read_as_built(tmp_path):
    file = IfcFile()
    beam(file)
    _, member = read(file, tmp_path / "m.ifc")
    result = result_of(member.element, displacement=[[1, 0, 0, 0.03], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    out = write_asbuilt_ifc(tmp_path / "m.ifc", {member.guid: result}, tmp_path / "out.ifc", keep_design=True)
    (again,) = linear_ik.read_design(out, threads=1).members
    assert again.element.placement.location[0] == pytest.approx(0.03)


def test_parts_that_are_not_in_the_element_are_named_in_the_table_and_in_the_as_built_file(tmp_path):
    def section(x, y):
        return file.new("IfcRectangleProfileDef", "AREA", "R", file.frame2d(), x, y)

    file = IfcFile()
    plate = file.extrusion(section(0.6, 0.8), 0.04, file.frame((0, 0, 3.0)))
    corbel = file.extrusion(section(0.3, 0.3), 0.5, file.frame((0.2, 0, 1), (1, 0, 0), (0, 1, 0)))
    file.beam(file.extrusion(section(0.2, 0.3), 3.0), plate, corbel, name="with plate and corbel")
    _, member = read(file, tmp_path / "m.ifc")
    assert member.remark == "read from one of the 3 solids of its body"
    scan = linear_ik.simulate(member.element, points=1500, seed=1)
    linear_ik.write_scan(linear_ik.Scan(scan.points), tmp_path / "scan.ply")
    options = linear_ik.ModelFitOptions(workers=0)
    found = linear_ik.fit_model(tmp_path / "m.ifc", [tmp_path / "scan.ply"], tmp_path / "out", options=options)
    assert found.fitted == 1
    (row,) = csv.DictReader((tmp_path / "out" / "elements.csv").read_text().splitlines())
    assert row["remark"] == member.remark
    model = ifcopenshell.open(str(tmp_path / "out" / "asbuilt.ifc"))
    (built,) = model.by_type("IfcBeam")
    said = ifcopenshell.util.element.get_pset(built, "LinearIK_AsBuilt")
    assert (said["Shape"], said["Notes"]) == (
        "as built",
        "What else the design shows of it is not in the as-built body: read from one of the 3 solids of its body.",
    )
