"""The as-built IFC: bent bodies where the fit says, and everything else as the design has it."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timezone
from pathlib import Path

import ifcopenshell
import ifcopenshell.util.element
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import ifcopenshell.validate
import numpy as np
import pytest
from asbuilt_samples import random_result, result_of
from captured import DATA
from small_ifc import BEAM, COLUMN, TWIN, WALL, tessellated, write_small_ifc

from linear_ik.asbuilt.shape import AsBuiltError, bent_shape, skin
from linear_ik.bim.products import LINEAR_CLASSES, linear_products
from linear_ik.element import Element, Placement
from linear_ik.errors import DesignError, SettingsError
from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc
from linear_ik.profile import Circle, CircleHollow, IShape, Polygon, Rectangle, RectangleHollow, UShape
from linear_ik.result import FitResult

IFC = DATA.parent / "ifc"
FILES = sorted(IFC.glob("*.ifc"))
# What a body consists of, and what says what was measured.
MAY_CHANGE = (
    "IfcRepresentationItem", "IfcRepresentation", "IfcRepresentationMap", "IfcProfileDef", "IfcProductDefinitionShape",
    "IfcRepresentationContext", "IfcPropertySet", "IfcProperty", "IfcRelDefinesByProperties", "IfcOwnerHistory",
    "IfcApplication", "IfcOrganization",
)  # fmt: skip

HEB300 = IShape(0.3, 0.3, 0.011, 0.019, 0.027)
BEAM_ELEMENT = Element("beam", HEB300, 6.0, 10, Placement((1.0, 2.0, 3.0), (0, 1, 0), (0, 0, 1)))
TUBE = Element("column", RectangleHollow(0.2, 0.2, 0.01), 4.0, 8, Placement((0.0, 0.0, 0.0), (0, 0, 1), (1, 0, 0)))
ALL_SCHEMAS = pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])


def farthest_m(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> float:
    """How far the farthest of the points is from a surface."""
    import open3d as o3d

    origin = vertices.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor((vertices - origin).astype(np.float32)), o3d.core.Tensor(triangles.astype(np.uint32))
    )
    return float(scene.compute_distance(o3d.core.Tensor((points - origin).astype(np.float32))).numpy().max())


def as_built(folder: Path, schema: str, results: dict[str, FitResult], **options) -> ifcopenshell.file:
    design = write_small_ifc(folder / "design.ifc", schema)
    return ifcopenshell.open(str(write_asbuilt_ifc(design, results, folder / "out" / "asbuilt.ifc", **options)))


def sheet(model: ifcopenshell.file, guid: str) -> dict:
    return ifcopenshell.util.element.get_psets(model.by_guid(guid)).get("LinearIK_AsBuilt", {})


def body(model: ifcopenshell.file, guid: str):
    (found,) = (r for r in model.by_guid(guid).Representation.Representations if r.RepresentationIdentifier == "Body")
    return found


def others(model: ifcopenshell.file) -> Counter:
    return Counter(e.is_a() for e in model if not any(e.is_a(c) for c in MAY_CHANGE))


# where the bodies are --------------------------------------------------------------------


@ALL_SCHEMAS
@pytest.mark.parametrize("kind", ["extrusions", "triangles"])
def test_bodies_are_where_the_fit_says(tmp_path: Path, schema: str, kind: str) -> None:
    pipe = Element("pipe", CircleHollow(0.1, 0.008), 4.0, 8, TUBE.placement)
    results = {BEAM: random_result(BEAM_ELEMENT, 1), COLUMN: random_result(pipe, 2)}
    model = as_built(tmp_path, schema, results, body=kind)
    for guid, result in results.items():
        vertices, triangles = tessellated(model, guid)
        surface = skin(bent_shape(result))
        assert farthest_m(vertices, *surface) < 0.001
        # Square cuts leave a wedge open at each kink; a mitred mesh leaves nothing.
        assert farthest_m(surface[0], vertices, triangles) < (0.0003 if kind == "triangles" else 0.003)
        axis = next(
            r for r in model.by_guid(guid).Representation.Representations if r.RepresentationIdentifier == "Axis"
        )
        at = ifcopenshell.util.placement.get_local_placement(model.by_guid(guid).ObjectPlacement)
        nodes = np.array([p.Coordinates for p in axis.Items[0].Points]) @ at[:3, :3].T + at[:3, 3]
        np.testing.assert_allclose(nodes / 1000, result.nodes_m, atol=1e-8)


def test_round_sections_are_swept_disks_from_ifc4_on(tmp_path: Path) -> None:
    pipe = Element("pipe", CircleHollow(0.1, 0.008), 4.0, 8, TUBE.placement)
    model = as_built(tmp_path, "IFC4", {COLUMN: random_result(pipe, 2)})
    (disk,) = body(model, COLUMN).Items
    assert disk.is_a("IfcSweptDiskSolid") and (disk.Radius, disk.InnerRadius) == pytest.approx((100, 92))
    old = as_built(tmp_path, "IFC2X3", {COLUMN: random_result(pipe, 2)})
    assert {i.is_a() for i in body(old, COLUMN).Items} == {"IfcExtrudedAreaSolid"} and len(body(old, COLUMN).Items) == 8


@pytest.mark.parametrize(
    "element",
    [
        Element("pole", Circle(0.12), 5.0, 6, profile_end=Circle(0.06)),
        Element("box", RectangleHollow(0.2, 0.3, 0.01), 5.0, 6, profile_end=RectangleHollow(0.1, 0.2, 0.01)),
        Element("arc", UShape(0.2, 0.08, 0.01, 0.012), 1.1, 12, axis_points=((0, 0, 0), (0, 0, 0.6), (0.3, 0, 1.0))),
        Element("off", Polygon([[0.5, 0.1], [0.6, 0.1], [0.75, 0.3], [0.6, 0.18], [0.52, 0.35]]), 3.0, 5),
    ],
    ids=lambda element: element.name,
)  # fmt: skip
def test_the_skin_is_closed_and_no_thicker_than_the_section(element: Element) -> None:
    import trimesh

    vertices, triangles = skin(bent_shape(random_result(element, 3, 0.02)))
    mesh, straight = trimesh.Trimesh(vertices, triangles, process=False), skin(bent_shape(result_of(element)))
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(trimesh.Trimesh(*straight, process=False).volume, rel=0.02)


def test_twisted_segments_keep_their_own_faces() -> None:
    angles = np.zeros((4, 3))
    angles[2, 2] = np.radians(2.0)
    element = Element("twisted", Rectangle(0.1, 0.3), 2.0, 4)
    vertices, _ = skin(bent_shape(result_of(element, angles)))
    turn = np.degrees(np.arctan2(vertices[:, 1], vertices[:, 0])).round(6) % 180
    corner = np.degrees(np.arctan2(0.15, 0.05))
    assert set(turn) == {corner.round(6), (180 - corner).round(6), (corner + 2).round(6), (182 - corner).round(6)}


# what stays ------------------------------------------------------------------------------


@ALL_SCHEMAS
def test_everything_else_is_the_designs(tmp_path: Path, schema: str) -> None:
    model = as_built(tmp_path, schema, {BEAM: random_result(BEAM_ELEMENT, 1), COLUMN: random_result(TUBE, 2)})
    design = ifcopenshell.open(str(tmp_path / "design.ifc"))
    assert {e.GlobalId for e in design.by_type("IfcRoot")} <= {e.GlobalId for e in model.by_type("IfcRoot")}
    assert others(model) == others(design)
    for guid in (TWIN, WALL):
        np.testing.assert_array_equal(tessellated(model, guid)[0], tessellated(design, guid)[0])
    assert model.by_guid(TWIN).Representation.Representations[0].Items[0].is_a("IfcMappedItem")
    assert len(model.by_guid(BEAM).HasOpenings) == 1 and "Openings stay" in sheet(model, BEAM)["Notes"]
    place = ifcopenshell.util.placement.get_local_placement
    for guid in (BEAM, COLUMN):
        np.testing.assert_array_equal(
            place(model.by_guid(guid).ObjectPlacement), place(design.by_guid(guid).ObjectPlacement)
        )
    items = body(model, BEAM).Items
    assert {item.SweptArea.ProfileName for item in items} == {"HEB300"} and len(
        model.by_type("IfcIShapeProfileDef")
    ) == 1
    assert all(item.StyledByItem for item in items)
    (layer,) = model.by_type("IfcPresentationLayerAssignment")
    assert list(layer.AssignedItems) == [body(model, BEAM)]


def test_a_profile_that_is_not_the_elements_is_made_anew(tmp_path: Path) -> None:
    element = Element("beam", Rectangle(0.2, 0.4), 6.0, 10, BEAM_ELEMENT.placement)
    model = as_built(tmp_path, "IFC4", {BEAM: random_result(element, 1)})
    (area,) = {item.SweptArea for item in body(model, BEAM).Items}
    assert area.is_a("IfcRectangleProfileDef") and (area.XDim, area.YDim) == pytest.approx((200, 400))


@ALL_SCHEMAS
def test_the_designed_body_is_kept_on_request(tmp_path: Path, schema: str) -> None:
    results = {BEAM: random_result(BEAM_ELEMENT, 1), COLUMN: random_result(TUBE, 2)}
    model = as_built(tmp_path, schema, results, keep_design=True)
    for guid, designed in ((BEAM, "IfcExtrudedAreaSolid"), (COLUMN, "IfcMappedItem")):
        reference = [
            r for r in model.by_guid(guid).Representation.Representations if r.RepresentationIdentifier == "Reference"
        ]
        assert [item.is_a() for r in reference for item in r.Items] == [designed]
        vertices, _ = tessellated(model, guid)
        assert farthest_m(vertices, *skin(bent_shape(results[guid]))) < 0.001


# what it says ----------------------------------------------------------------------------


@ALL_SCHEMAS
def test_elements_say_what_was_measured(tmp_path: Path, schema: str) -> None:
    angles = np.zeros((10, 3))
    angles[0, 0] = np.radians(0.1)
    results = {BEAM: result_of(BEAM_ELEMENT, angles), COLUMN: result_of(TUBE, status="not_scanned")}
    model = as_built(tmp_path, schema, results)
    said = sheet(model, BEAM)
    assert (said["Status"], said["Shape"]) == ("converged", "as built")
    assert said["EndDisplacement"] == pytest.approx(1000 * 6.0 * np.radians(0.1), rel=1e-3)
    assert said["EndDisplacementBand95"] == pytest.approx(1.96 * 0.5, rel=1e-3)
    assert len(said["NodeDepartures"]) == 11 and said["SegmentsMeasured"] == 10
    assert (sheet(model, COLUMN)["Status"], sheet(model, COLUMN)["Shape"]) == ("not scanned", "as designed")
    assert "not in the scan" in sheet(model, COLUMN)["Reasons"]
    assert (sheet(model, TWIN)["Status"], sheet(model, TWIN)["Shape"]) == ("not fitted", "as designed")
    assert not sheet(model, WALL)
    assert body(model, COLUMN).Items[0].is_a("IfcMappedItem")


def test_the_same_results_make_the_same_file(tmp_path: Path) -> None:
    design, when = write_small_ifc(tmp_path / "design.ifc", "IFC4"), datetime(2026, 1, 2, tzinfo=timezone.utc)
    results = {BEAM: random_result(BEAM_ELEMENT, 1)}
    one, two = (write_asbuilt_ifc(design, results, tmp_path / name, when=when) for name in ("1.ifc", "2.ifc"))
    assert one.read_text().replace("1.ifc", "") == two.read_text().replace("2.ifc", "")


def test_a_second_run_replaces_the_first(tmp_path: Path) -> None:
    results = {BEAM: random_result(BEAM_ELEMENT, 1)}
    as_built(tmp_path, "IFC4", results)
    path, again = tmp_path / "out" / "asbuilt.ifc", random_result(BEAM_ELEMENT, 2)
    model = ifcopenshell.open(str(write_asbuilt_ifc(path, {BEAM: again}, path)))
    assert len([s for s in model.by_type("IfcPropertySet") if s.Name == "LinearIK_AsBuilt"]) == 2  # beam, columns
    assert len(body(model, BEAM).Items) == 10 and len(model.by_type("IfcApplication")) == 2
    assert farthest_m(tessellated(model, BEAM)[0], *skin(bent_shape(again))) < 0.001


def test_the_header_keeps_its_author_and_says_who_changed_the_file(tmp_path: Path) -> None:
    header = as_built(tmp_path, "IFC4", {BEAM: random_result(BEAM_ELEMENT, 1)}).header
    assert header.file_name.preprocessor_version.startswith("linear_ik ") and header.file_name.name == "asbuilt.ifc"


def test_early_names_of_ifc4x3_are_read(tmp_path: Path) -> None:
    design = write_small_ifc(tmp_path / "design.ifc", "IFC4X3")
    text = design.read_text()
    assert "'IFC4X3_ADD2'" in text
    design.write_text("\ufeff" + text.replace("'IFC4X3_ADD2'", "'IFC4X3_RC4'"))
    out = write_asbuilt_ifc(design, {BEAM: random_result(BEAM_ELEMENT, 1)}, tmp_path / "out.ifc")
    assert len(body(ifcopenshell.open(str(out)), BEAM).Items) == 10


# what is wrong ---------------------------------------------------------------------------


def test_bad_input_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    design, out, result = write_small_ifc(tmp_path / "design.ifc", "IFC4"), tmp_path / "out.ifc", result_of(TUBE)
    with pytest.raises(AsBuiltError, match="nobody: no product of .*design.ifc"):
        write_asbuilt_ifc(design, {"nobody": result}, out)
    with pytest.raises(SettingsError, match="extrusions, triangles"):
        write_asbuilt_ifc(design, {COLUMN: result}, out, body="nurbs")
    with pytest.raises(DesignError, match="missing.ifc: no such file"):
        write_asbuilt_ifc(tmp_path / "missing.ifc", {}, out)
    (tmp_path / "no.ifc").write_text("no STEP")
    with pytest.raises(DesignError, match="no.ifc: is not an IFC file"):
        write_asbuilt_ifc(tmp_path / "no.ifc", {}, out)
    moved = result_of(TUBE)
    moved.nodes_m[3:] += 0.01
    with pytest.raises(AsBuiltError, match=f"{COLUMN}: nodes_m: 0.01 m from where the joint angles lead"):
        write_asbuilt_ifc(design, {COLUMN: moved}, out)
    assert not out.exists()


def test_an_element_that_cannot_be_drawn_stays_as_designed_on_request(tmp_path: Path) -> None:
    broken, left = result_of(TUBE), []
    broken.nodes_m[3:] += 0.01
    results = {COLUMN: broken, BEAM: random_result(BEAM_ELEMENT, 1)}
    model = as_built(tmp_path, "IFC4", results, on_left=lambda guid, what: left.append((guid, what)))
    assert [guid for guid, _ in left] == [COLUMN] and "joint angles" in left[0][1]
    assert sheet(model, COLUMN)["Shape"] == "as designed" and "cannot be drawn" in sheet(model, COLUMN)["Notes"]
    assert body(model, COLUMN).Items[0].is_a("IfcMappedItem") and len(body(model, BEAM).Items) == 10


# files of others -------------------------------------------------------------------------

PROFILES = (
    HEB300,
    Rectangle(0.1, 0.3),
    CircleHollow(0.1, 0.01),
    Polygon([[0.1, 0.1], [0.2, 0.1], [0.3, 0.3], [0.12, 0.25]]),
)


def somewhere_near(design: ifcopenshell.file, count: int) -> dict[str, FitResult]:
    """Bent elements at the places of some of a file's members, as far apart in it as possible."""
    unit = ifcopenshell.util.unit.calculate_unit_scale(design)
    every = [product for product, _ in linear_products(design, LINEAR_CLASSES)]
    results = {}
    for i, product in enumerate(every[:: max(1, len(every) // count)][:count]):
        T = np.array(ifcopenshell.util.placement.get_local_placement(product.ObjectPlacement))
        at, axis = unit * T[:3, 3] + [0.1, 0.2, 0.3], T[:3, 0] + 0.2 * T[:3, 1]
        element = Element(f"e{i}", PROFILES[i % 4], 3.0, 6, Placement(tuple(at), tuple(axis), tuple(T[:3, 2])))
        results[product.GlobalId] = random_result(element, i)
    return results


@pytest.mark.skipif(not FILES, reason=f"the design files of others are not in {IFC} (LINEAR_IK_DATA)")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_of_others_keep_all_but_the_fitted_bodies(tmp_path: Path, path: Path) -> None:
    design = ifcopenshell.open(str(path))
    results = somewhere_near(design, 4)
    model = ifcopenshell.open(str(write_asbuilt_ifc(path, results, tmp_path / "out.ifc")))
    assert {e.GlobalId for e in design.by_type("IfcRoot")} <= {e.GlobalId for e in model.by_type("IfcRoot")}
    assert others(model) == others(design)
    for guid, result in results.items():
        assert farthest_m(tessellated(model, guid)[0], *skin(bent_shape(result))) < 0.001
    mapped = [
        p.GlobalId
        for p in design.by_type("IfcElement")
        if p.Representation
        and p.GlobalId not in results
        and any(i.is_a("IfcMappedItem") for r in p.Representation.Representations for i in r.Items)
    ]
    for guid in mapped[:3]:
        np.testing.assert_array_equal(tessellated(model, guid)[0], tessellated(design, guid)[0])


def test_the_file_is_valid(tmp_path: Path) -> None:
    pipe = Element("pipe", CircleHollow(0.1, 0.008), 4.0, 8, TUBE.placement)
    results = {BEAM: random_result(BEAM_ELEMENT, 1), COLUMN: random_result(pipe, 2)}
    as_built(tmp_path, "IFC4", results, keep_design=True)
    messages = {}
    for path in (tmp_path / "design.ifc", tmp_path / "out" / "asbuilt.ifc"):
        logger = ifcopenshell.validate.json_logger()
        ifcopenshell.validate.validate(str(path), logger, express_rules=True)
        messages[path.name] = [str(s.get("message", s)) for s in logger.statements]
    assert messages["asbuilt.ifc"] == messages["design.ifc"] == []
