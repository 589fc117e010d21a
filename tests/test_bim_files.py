"""Files as they come: versions, byte order marks, archives, damage; units, maps and north; what is left out."""

import re
import zipfile
from collections import Counter

import numpy as np
import pytest
from ifc_files import IfcFile, prism

import linear_ik
from linear_ik.errors import DesignError, SettingsError


def beam_file(schema="IFC4", **options):
    file = IfcFile(schema, **options)
    profile = file.new("IfcRectangleProfileDef", "AREA", "R200", file.frame2d(), 0.2, 0.3)
    file.beam(file.extrusion(profile, 4), extra=() if schema == "IFC2X3" else (None,), tag="B1", name="beam 1")
    return file


@pytest.mark.parametrize(
    "header", ["IFC4X3", "IFC4X3_ADD1", "IFC4X3_ADD2", "IFC4X3_TC1", "IFC4X3_RC4", "ifc4x3_add2", "IFC4X3_FINAL"]
)
def test_every_spelling_of_ifc4x3(header, tmp_path):
    model = linear_ik.read_design(beam_file("IFC4X3").write(tmp_path / "m.ifc", header), threads=1)
    assert model.schema == header.upper()
    assert len(model.members) == 1


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
def test_a_byte_order_mark(schema, tmp_path):
    model = linear_ik.read_design(beam_file(schema).write(tmp_path / "m.ifc", bom=True), threads=1)
    assert [(m.ifc_class, m.name, m.tag, m.profile_name) for m in model.members] == [
        ("IfcBeam", "beam 1", "B1", "R200")
    ]


def test_an_archive(tmp_path):
    inner = beam_file().write(tmp_path / "m.ifc")
    with zipfile.ZipFile(tmp_path / "m.ifczip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(inner, "folder/m.ifc")
    assert len(linear_ik.read_design(tmp_path / "m.ifczip", threads=1).members) == 1
    with zipfile.ZipFile(tmp_path / "two.ifczip", "w") as archive:
        archive.write(inner, "a.ifc")
        archive.write(inner, "b.ifc")
    with pytest.raises(DesignError, match="two.ifczip: holds 2 .ifc files"):
        linear_ik.read_design(tmp_path / "two.ifczip")


def good(tmp_path):
    return beam_file().write(tmp_path / "good.ifc").read_bytes()


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda data: b"", "is empty"),
        (lambda data: b"\xef\xbb\xbf \n", "is empty"),
        (lambda data: b"hello\n", "is not an IFC file"),
        (lambda data: bytes(range(256)) * 40, "is not an IFC file"),
        (lambda data: b"PK\x03\x04" + data, "is a damaged zip archive"),
        (lambda data: data[: len(data) // 2], "is cut off"),
        (lambda data: data[:100], "is cut off"),
        (lambda data: data.replace(b"'IFC4'", b"'IFC5'"), "is of version IFC5"),
        (lambda data: data.replace(b"FILE_SCHEMA(('IFC4'));", b""), "does not name its version"),
        (lambda data: data.replace(b"IFCPROJECT(", b"IFCSITE("), "holds no IfcProject"),
        (lambda data: data.replace(b"LENGTHUNIT", b"AREAUNIT"), "does not say its length unit"),
        (lambda data: data.replace(b"IFCBEAM(", b"IFCSLAB("), "holds no linear element"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_in_one_line(damage, said, tmp_path, capfd):
    path = tmp_path / "bad.ifc"
    path.write_bytes(damage(good(tmp_path)))
    with pytest.raises(DesignError) as error:
        linear_ik.read_design(path, threads=1)
    assert said in str(error.value)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)
    assert capfd.readouterr().out == ""


def test_one_broken_product_costs_nobody_else(tmp_path):
    file = beam_file()
    for _ in range(3):
        file.beam(file.extrusion(file.new("IfcCircleProfileDef", "AREA", None, None, 0.05), 3))
    path = file.write(tmp_path / "m.ifc")
    text = path.read_text()
    # An extrusion without a depth, one without a profile, a sphere without a size.
    lines = text.split("\n")
    solids = [i for i, line in enumerate(lines) if "=IFCEXTRUDEDAREASOLID" in line][1:]
    lines[solids[0]] = lines[solids[0]].replace(",3.)", ",$)")
    lines[solids[1]] = re.sub(r"\(#\d+,", "($,", lines[solids[1]])
    lines[solids[2]] = re.sub(r"IFCEXTRUDEDAREASOLID\(.*\)", "IFCSPHERE($,$)", lines[solids[2]])
    path.write_text("\n".join(lines))
    model = linear_ik.read_design(path, threads=1)
    assert [m.name for m in model.members] == ["beam 1"]
    assert len(model.left_out) == 3 and all("\n" not in one.reason for one in model.left_out)


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(DesignError, match="no such file"):
        linear_ik.read_design(tmp_path / "none.ifc")
    with pytest.raises(DesignError, match="is a folder"):
        linear_ik.read_design(tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"classes": ("IfcWall",)},
        {"classes": ()},
        {"slenderness": -1},
        {"segments": 0},
        {"threads": 0},
        {"colour": "red"},
        {"fewest_segments": 20, "most_segments": 10},
    ],
)
def test_a_wrong_setting_is_named(wrong, tmp_path):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        linear_ik.read_design(beam_file().write(tmp_path / "m.ifc"), **wrong)


def test_segments_as_the_length_asks(tmp_path):
    file = IfcFile()
    profile = file.new("IfcCircleProfileDef", "AREA", None, file.frame2d(), 0.05)
    for length in (1, 4, 12, 100):
        file.beam(file.extrusion(profile, length))
    path = file.write(tmp_path / "m.ifc")
    segments = [m.element.segments for m in linear_ik.read_design(path, threads=1).members]
    assert segments == [10, 10, 24, 60]
    one = linear_ik.read_design(path, threads=1, segment_length_m=1.0, fewest_segments=4, most_segments=200)
    assert [m.element.segments for m in one.members] == [4, 4, 12, 100]
    assert {m.element.segments for m in linear_ik.read_design(path, threads=1, segments=7).members} == {7}


def test_the_classes_and_what_stands_besides(tmp_path):
    file = IfcFile()
    profile = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.2, 0.3)
    bar = file.extrusion(profile, 3)
    for kind, extra in (
        ("IfcBeam", (None,)), ("IfcBeamStandardCase", (None,)), ("IfcColumn", (None,)),
        ("IfcColumnStandardCase", (None,)), ("IfcMember", (None,)), ("IfcMemberStandardCase", (None,)),
        ("IfcPile", (None, None)),
        ("IfcPipeSegment", (None,)), ("IfcDuctSegment", (None,)), ("IfcCableCarrierSegment", (None,)),
        ("IfcReinforcingBar", (None,) * 6), ("IfcSlab", (None,)), ("IfcPlate", (None,)), ("IfcPipeFitting", (None,)),
    ):  # fmt: skip
        file.product(kind, bar, extra=extra)
    path = file.write(tmp_path / "m.ifc")
    model = linear_ik.read_design(path, threads=1)
    assert Counter(m.ifc_class for m in model.members) == Counter(
        ["IfcBeam", "IfcBeamStandardCase", "IfcColumn", "IfcColumnStandardCase", "IfcMember", "IfcMemberStandardCase",
         "IfcPile", "IfcPipeSegment", "IfcDuctSegment", "IfcCableCarrierSegment", "IfcReinforcingBar"]
    )  # fmt: skip
    assert sorted(o.ifc_class for o in model.obstacles) == ["IfcPipeFitting", "IfcPlate", "IfcSlab"]
    np.testing.assert_allclose(np.ptp(model.obstacles[0].vertices_m, axis=0), [0.2, 0.3, 3])
    columns = linear_ik.read_design(path, threads=1, classes="IfcColumn", obstacles=False)
    assert [m.ifc_class for m in columns.members] == ["IfcColumn", "IfcColumnStandardCase"]
    assert columns.obstacles == ()


def test_rails(tmp_path):
    file = IfcFile("IFC4X3")
    profile = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.07, 0.17)
    file.product("IfcRail", file.extrusion(profile, 18), extra=(None,))
    assert [m.ifc_class for m in linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).members] == [
        "IfcRail"
    ]


def test_flow_segments_of_ifc2x3_are_what_their_types_are(tmp_path):
    file = IfcFile("IFC2X3")
    profile = file.new("IfcCircleProfileDef", "AREA", None, file.frame2d(), 0.05)
    for kind in ("IfcPipeSegmentType", "IfcDuctSegmentType", "IfcCableCarrierSegmentType", "IfcCableSegmentType", None):
        product = file.product("IfcFlowSegment", file.extrusion(profile, 3))
        if kind:
            file.typed(product, kind, "NOTDEFINED")
    path = file.write(tmp_path / "m.ifc")
    model = linear_ik.read_design(path, threads=1)
    classes = ["IfcPipeSegment", "IfcDuctSegment", "IfcCableCarrierSegment", "IfcFlowSegment"]
    assert [m.ifc_class for m in model.members] == classes
    assert [m.ifc_class for m in linear_ik.read_design(path, threads=1, classes="IfcPipeSegment").members] == [
        "IfcPipeSegment",
        "IfcFlowSegment",
    ]


def test_what_is_not_linear_is_left_out_with_its_reason_and_in_the_way(tmp_path):
    file = IfcFile()
    plate = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.3, 0.2)
    file.beam(file.extrusion(plate, 0.01), name="plate")
    stub = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.1, 0.1)
    file.beam(file.extrusion(stub, 0.15), name="stub")
    file.beam(name="nothing")
    outline = [(0, 0), (1, 0), (1, 0.1), (0.1, 0.1), (0.1, 1), (0, 1)]
    file.beam(file.box_mesh(*prism(outline, 0.1)), name="frame", representation="Brep")
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert model.members == ()
    assert {one.name: one.reason for one in model.left_out} == {
        "plate": "it is a plate, not linear: 300 x 200 x 10 mm",
        "stub": "it is a stub, not linear: 150 x 100 x 100 mm",
        "nothing": "it has no body",
        "frame": "it is a plate, not linear: 1000 x 1000 x 100 mm",
    }
    assert len(model.obstacles) == 3


def test_a_bar_drawn_from_its_side_is_a_bar(tmp_path):
    file = IfcFile()
    # Ten centimetres thick, drawn in plan and pulled up: the length is in the outline.
    plan = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d((1, 0)), 3.0, 0.2)
    file.beam(file.extrusion(plan, 0.1))
    (member,) = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).members
    assert member.element.length_m == pytest.approx(3)
    assert sorted((member.element.profile.x_dim, member.element.profile.y_dim)) == pytest.approx([0.1, 0.2])
    np.testing.assert_allclose(np.abs(member.element.placement.T_world_element[:3, 2]), [1, 0, 0], atol=1e-9)


def test_a_global_id_that_is_there_twice_names_one_member(tmp_path):
    file = beam_file()
    twin = file.beam(file.extrusion(file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 0.2, 0.3), 4))
    twin.GlobalId = file.products[0].GlobalId
    model = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1)
    assert (len(model.members), [one.reason for one in model.left_out]) == (
        1,
        ["its GlobalId is that of another element"],
    )


def converted(unit, scale, map_unit, eastings, **options):
    file = beam_file(unit=unit, **options) if unit == "metre" else IfcFile(unit=unit, **options)
    if unit != "metre":
        profile = file.new("IfcRectangleProfileDef", "AREA", None, file.frame2d(), 200, 300)
        file.beam(file.extrusion(profile, 4000), extra=(None,))
    metre = file.new("IfcSIUnit", None, "LENGTHUNIT", None, "METRE") if map_unit else None
    crs = file.new("IfcProjectedCRS", "EPSG:25832", None, None, None, None, None, metre)
    # X points 30 degrees north of east.
    file.new("IfcMapConversion", file.context, crs, *eastings, 100.0, np.cos(np.pi / 6), np.sin(np.pi / 6), scale)
    return file


@pytest.mark.parametrize(
    ("unit", "scale", "map_unit"), [("metre", None, True), ("metre", 1.0, False), ("millimetre", 0.001, True),
                                    ("millimetre", None, True), ("millimetre", 0.001, False)]
)  # fmt: skip
def test_the_map_conversion_both_ways(unit, scale, map_unit, tmp_path):
    path = converted(unit, scale, map_unit, (500000.0, 5400000.0)).write(tmp_path / "m.ifc")
    conversion = linear_ik.read_design(path, threads=1).map_conversion
    assert conversion.crs == "EPSG:25832"
    model = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 2]])
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    on_map = np.array([500000.0, 5400000, 100]) + [[0, 0, 0], [10 * c, 10 * s, 0], [-10 * s, 10 * c, 2]]
    np.testing.assert_allclose(conversion.to_map(model), on_map, atol=1e-8)
    np.testing.assert_allclose(conversion.to_model(on_map), model, atol=1e-8)
    # Grid north, 30 degrees left of the model's Y ... seen from the model it leans to its X.
    np.testing.assert_allclose(conversion.direction_to_model((0, 1)), (s, c), atol=1e-12)
    np.testing.assert_allclose(conversion.direction_to_map((s, c)), (0, 1), atol=1e-12)


def test_a_projections_scale_is_kept(tmp_path):
    conversion = linear_ik.read_design(
        converted("metre", 0.9996, True, (0.0, 0.0)).write(tmp_path / "m.ifc"), threads=1
    ).map_conversion
    assert np.linalg.norm(conversion.to_map(np.array([[1000.0, 0, 0]])) - [[0, 0, 100]]) == pytest.approx(999.6)


def test_a_scale_that_contradicts_the_units_is_said(tmp_path):
    model = linear_ik.read_design(converted("millimetre", 1000.0, True, (0, 0)).write(tmp_path / "m.ifc"), threads=1)
    assert "contradicts its units" in model.notes[0]
    np.testing.assert_allclose(np.linalg.det(model.map_conversion.T_map_model), 1)


def test_the_map_conversion_of_ifc2x3(tmp_path):
    file = beam_file("IFC2X3")

    def pset(name, **values):
        kinds = {key: "IfcLabel" if isinstance(value, str) else "IfcReal" for key, value in values.items()}
        wrapped = [
            file.new("IfcPropertySingleValue", key, None, file.f.create_entity(kinds[key], value))
            for key, value in values.items()
        ]
        made = file.rooted("IfcPropertySet", name, None, wrapped)
        file.rooted("IfcRelDefinesByProperties", None, None, [file.project], made)

    pset(
        "ePSet_MapConversion",
        Eastings=500000.0,
        Northings=5400000.0,
        OrthogonalHeight=7.0,
        XAxisAbscissa=0.0,
        XAxisOrdinate=1.0,
        Scale=1.0,
    )
    pset("ePSet_ProjectedCRS", Name="EPSG:25832", MapUnit="METRE")
    conversion = linear_ik.read_design(file.write(tmp_path / "m.ifc"), threads=1).map_conversion
    np.testing.assert_allclose(conversion.to_map(np.array([[1.0, 0, 0]])), [[500000, 5400001, 7]])
    assert conversion.crs == "EPSG:25832"


def test_true_north(tmp_path):
    model = linear_ik.read_design(beam_file(north=(1, 1)).write(tmp_path / "m.ifc"), threads=1)
    assert model.true_north == pytest.approx((np.sqrt(0.5), np.sqrt(0.5)))
    assert linear_ik.read_design(beam_file().write(tmp_path / "n.ifc"), threads=1).true_north is None
