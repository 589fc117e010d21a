"""Report: what it says, that nothing in it reaches out, and how it works in a real browser."""

from __future__ import annotations

import csv
import json
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime, timezone
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Tab, browser
from PIL import Image
from posed import BEAM, COLUMN, H, bent, posed

import linear_ik
from linear_ik.element import Element, Placement
from linear_ik.errors import SettingsError, ToleranceError
from linear_ik.exports.result_json import write_result
from linear_ik.profile import CircleHollow, IShape
from linear_ik.readers.result_json import ResultError
from linear_ik.report import Run, judged_member, nearby, read_run, render, write_report
from linear_ik.report.cloud import Cloud, T_world_segments
from linear_ik.report.svg import TOP, curve_plot, section_plot
from linear_ik.report.words import elastic_rows, figure_rows, list_row, seen, settings_rows, with_band
from linear_ik.result import FitResult, SegmentResult
from linear_ik.scan import Scan
from linear_ik.simulate import simulate
from linear_ik.tolerances import Conditions, ConditionsOfEach, load_tolerances, material_named

NASTY = "<script>alert(1)</script> \"'&"


def leaning(lean_rad: float, name: str = "column") -> FitResult:
    angles = np.zeros((6, 3))
    angles[0, 1], angles[3, 0] = lean_rad, 0.002
    return posed(Element(name, IShape(0.2, 0.2, 0.009, 0.015), 3.0, 6, COLUMN), angles)


def write_run(folder: Path, count: int = 4) -> Path:
    """A run as `linear-ik fit` of a model leaves it: columns that lean more and more, a beam, one not found."""
    rows = []
    for i in range(count):
        guid = f"0AbC$d_{i:02}"
        result = leaning(0.001 * i, f"Column {i}")
        if i == count - 1:
            unseen = (SegmentResult("not_scanned", 0, 0.0, float("nan")),) * 6
            result = replace(result, status="not_scanned", segments=unseen, reasons=("the element is not in the scan",))
        write_result(result, folder / "elements" / f"{guid}.json")
        row = {"guid": guid, "ifc_class": "IfcColumn", "name": f"Column {i}", "tag": f"C-{i}", "profile": "HEB 200"}
        rows.append({**row, "status": result.status})
    rows.append({**dict.fromkeys(rows[0], ""), "guid": "plate", "name": "Plate", "status": "left out"})
    with (folder / "elements.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    about = {"design": "site.ifc", "settings": {"seed": 0}, "scan": ["a", "b"], "T_model_scan": np.eye(4).tolist()}
    left_out = [{"guid": "rail", "ifc_class": "IfcRailing", "name": "Rail", "reason": "no straight axis"}]
    (folder / "run.json").write_text(json.dumps({**about, "left_out": left_out}))
    return folder


def rendered(folder: Path, scan: Scan | None = None) -> str:
    run = read_run(folder, load_tolerances("aisc303"), Conditions("self_weight"))
    return render(run, scan, made=datetime(2026, 1, 2, 3, 4, tzinfo=timezone.utc))


# what is read -----------------------------------------------------------------------------------


def test_a_run_is_its_results_and_what_its_table_says(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    run = read_run(write_run(tmp_path), load_tolerances("aisc303"), None, lambda i, n: seen.append((i, n)))
    assert [m.tag for m in run.members] == ["C-0", "C-1", "C-2", "C-3"] and seen[-1] == (4, 4)
    assert [m.outcome for m in run.members] == ["pass", "pass", "inconclusive", "inconclusive"]
    (tmp_path / "elements" / "0AbC$d_00.json").rename(tmp_path / "elements" / "zzz.json")
    table = (tmp_path / "elements.csv").read_text().replace("0AbC$d_00", "zzz")
    (tmp_path / "elements.csv").write_text(table)
    assert [m.tag for m in read_run(tmp_path).members] == ["C-0", "C-1", "C-2", "C-3"]  # the table's order
    assert [row["name"] for row in run.unfitted] == ["Plate", "Rail"] and run.T_results_scan is None
    assert run.about == {"design": "site.ifc", "settings.seed": "0", "scan": "a, b"}
    assert run.members[0].versions["python"] and run.members[0].profile == "HEB 200"


def test_the_class_of_the_table_says_which_clauses_are_for_a_member(tmp_path: Path) -> None:
    """A leaning pipe is no column; what a person states of it goes before what the table says."""
    folder, aisc = write_run(tmp_path, 3), load_tolerances("aisc303")
    table = (folder / "elements.csv").read_text().replace("IfcColumn", "IfcPipeSegment")
    (folder / "elements.csv").write_text(table)
    run = read_run(folder, aisc)
    assert [m.outcome for m in run.members] == ["not_applicable"] * 3
    assert "this is an IfcPipeSegment" in render(run)
    each = ConditionsOfEach(named={"C-1": Conditions(ifc_class="IfcColumn")})
    assert [m.outcome for m in read_run(folder, aisc, each).members] == ["not_applicable", "pass", "not_applicable"]


def test_a_result_alone_and_a_folder_of_results(tmp_path: Path) -> None:
    write_result(leaning(0.001, "my column"), tmp_path / "r.json")
    for source in (tmp_path / "r.json", tmp_path):
        (member,) = read_run(source).members
        assert (member.key, member.name, member.tag, member.outcome) == ("r", "my column", "", "")
    assert read_run(tmp_path / "r.json").title == "my column" and read_run(tmp_path).title == tmp_path.name


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("elements/a.json", "{", "no JSON"),
        ("elements/a.json", "{}", "schema"),
        ("elements.csv", "name,tag\nx,y\n", "no column guid"),
        ("elements.csv", b"\xff\xfeguid", "cannot be read"),
        ("run.json", "[", "cannot be read"),
        ("run.json", "[]", "no set of keys"),
        ("run.json", '{"T_model_scan": [1, 2]}', "4 x 4"),
    ],
)
def test_wrong_files_are_named(tmp_path: Path, name: str, content: str | bytes, says: str) -> None:
    write_run(tmp_path, 2)
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ResultError, match=says) as error:
        read_run(tmp_path)
    assert Path(name).name in str(error.value)


def test_nothing_to_report(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.json"):
        with pytest.raises(ResultError):
            read_run(path)


# what it says -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "band", "text"),
    [
        (0.0131, 0.0035, "13.1 ± 3.5 mm"),
        (-0.0131, 0.00035, "-13.10 ± 0.35 mm"),
        (0.0131, 0.00004, "13.10 ± 0.04 mm"),
        (0.0131, 0.000004, "13.100 ± 0.004 mm"),
        (0.0131, None, "13.1 mm, band not known"),
        (None, None, "not known"),
    ],
)
def test_figures_are_as_exact_as_their_bands(value: float, band: float, text: str) -> None:
    assert with_band(value, band, "mm", 1e3) == text


def test_every_figure_has_its_band_or_a_reason() -> None:
    for result in (leaning(0.002), posed(Element("pipe", CircleHollow(0.05, 0.004), 3.0, 6, BEAM), np.zeros((6, 3)))):
        for row in figure_rows(judged_member(result).deviations):
            assert "±" in row["text"] or (row["text"] == "none" and row["note"]), row


def test_what_was_not_scanned_is_said_in_metres() -> None:
    result = leaning(0.0)
    kinds = ["measured"] * 2 + ["not_scanned"] * 3 + ["inferred"]
    parts = [replace(s, status=kind) for s, kind in zip(result.segments, kinds, strict=True)]
    said = seen(replace(result, segments=tuple(parts)))
    assert said[:2] == ["1.00 to 2.50 m: not scanned", "2.50 to 3.00 m: inferred from what lies on both sides"]
    plot = curve_plot(judged_member(result).deviations.offset_m, 3.0, "offset", tuple(parts))
    assert plot.count('class="not_scanned"') == 3 and plot.count('class="inferred"') == 1


def test_the_page_says_what_matters(tmp_path: Path) -> None:
    page = rendered(write_run(tmp_path))
    text = re.sub(r"<[^>]+>", " ", page)
    for what in (
        *(
            "7.13.1.1",
            "AISC 303-16",
            "verified by linear_ik",
            "self weight",
            "not stated",
            "LOA",
            "Plate",
            "left out",
            "no straight axis",
            "signature",
            f"with linear_ik {linear_ik.__version__}",
        ),
        *("site.ifc", "version of numpy", "2026-01-02 03:04 UTC", "the element is not in the scan"),
    ):
        assert what in text, what
    assert "fail" in text and "the scan was not given" in text


def test_a_verdict_says_what_it_is_about(tmp_path: Path) -> None:
    """A bent column stands plumb: that is no pass of the column."""
    column = Element("c", H, 4.0, 8, COLUMN)
    angles = bent(column, 0, 0.005)
    angles[0, 0] -= angles[1:, 0].sum() / 2  # its ends above each other
    bowed = judged_member(
        posed(column, angles),
        load_tolerances("aisc303"),
        Conditions("unloaded"),
        about={"ifc_class": "IfcColumn"},
    )
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", render(Run("r", (bowed,)))))
    assert bowed.outcome == "pass" and bowed.deviations.bow_m.value > 0.009
    assert "Verdict pass: plumb. Fit" in text and "pass: plumbconverged" in text
    assert "Bridges: plumb. Nothing else was judged." in text
    both = judged_member(
        bowed.result, load_tolerances("nsss"), Conditions("unloaded"), about={"ifc_class": "IfcColumn"}
    )
    assert list_row(both)["judged"] == "straightness" and both.outcome == "fail"


def test_settings_are_those_that_a_reader_wants(tmp_path: Path) -> None:
    folder = write_run(tmp_path)
    said = {"design": "site.ifc", "options": {"contest": True, "segments": None, "reach_m": 0.15}}
    said["deviation"] = {"inputs": "be135bfe", "lowest_m": -0.01859802729359231, "low": [487123.45612345]}
    (folder / "run.json").write_text(json.dumps(said))
    run = read_run(folder)
    shown = {"options.reach_m": "0.15", "deviation.lowest_m": "-0.018598", "deviation.low": "487123.456"}
    assert run.about == {"design": "site.ifc", **shown}
    assert run.title == f"site.ifc as built: {tmp_path.name}"
    assert not [name for name, text in settings_rows(run.members[0]) if text in ("", "not given")]


def test_limits_are_drawn_where_they_are_near() -> None:
    beam = posed(Element("b", H, 4.0, 8, BEAM), bent(Element("b", H, 4.0, 8, BEAM), 1, 0.002))
    member = judged_member(beam, load_tolerances("nsss"), Conditions("unloaded", 0.0))
    page = render(Run("r", (member,)))
    assert page.count('<path class="limit"') == 2


def test_limits_that_do_not_hold_are_not_drawn() -> None:
    beam = posed(Element("b", H, 4.0, 8, BEAM), bent(Element("b", H, 4.0, 8, BEAM), 1, 0.002))
    member = judged_member(beam, load_tolerances("nsss"), Conditions("unloaded", 0.0))
    for changes in ({"outcome": "not_applicable"}, {"verified_by": None, "outcome": "inconclusive"}):
        changed = replace(member, verdicts=tuple(replace(v, **changes) for v in member.verdicts))
        assert 'class="limit"' not in render(Run("r", (changed,)))


def test_figures_and_verdicts_are_against_one_shape() -> None:
    """Specified with a precamber of 15 mm and built straight: 15 mm off, in the figures as in the verdict."""
    member = judged_member(
        posed(Element("b", H, 6.0, 10, BEAM), np.zeros((10, 3))), load_tolerances("nsss"), Conditions("unloaded", 0.015)
    )
    assert member.verdicts[0].value == member.deviations.bow_m.value == pytest.approx(0.015)
    assert "15.0" in figure_rows(member.deviations)[0]["text"]


def test_elastic_sag_and_imperfection_stand_apart() -> None:
    """12 m of 0.1 x 0.2 m steel, straight as scanned: 29.7 mm of sag stand beside as much imperfection, upwards."""
    beam = posed(Element("b", H, 12.0, 8, BEAM), np.zeros((8, 3)), 1e-6)
    steel = Conditions("self_weight", 0.0, "simple", material_named("steel"))
    member = judged_member(beam, load_tolerances("nsss"), steel)
    assert member.elastic is not None and member.elastic.largest_m == pytest.approx(0.02969, abs=1e-5)
    assert member.deviations.bow_m.value == pytest.approx(0.0, abs=1e-9)
    assert member.imperfection.bow_m.value == pytest.approx(0.02969, abs=1e-5)
    assert member.imperfection.camber_m.value == pytest.approx(0.02969, abs=1e-5)
    rows = {row["label"]: row for row in elastic_rows(member)}
    sag = rows["elastic sag of own weight, computed: largest offset from the chord"]
    assert sag["text"] == "29.7 ± 1.5 mm" and "simply supported, steel" in sag["note"] and "EN 1993-1-1" in sag["note"]
    assert rows["imperfection: bow without it"]["text"] == "29.7 ± 1.5 mm"
    assert rows["imperfection: sweep without it"]["text"].startswith("0.0")
    page = render(Run("r", (member,)))
    assert page.count('class="line elastic ') == 2 and "imperfection: w(s) without the elastic sag" in page
    for what in ("<dt>as scanned</dt>", "<dt>elastic sag</dt>", "<dt>imperfection</dt>"):
        assert what in page, what
    # The limit is drawn with the curve that it holds for, once above and once below.
    assert page.count('<path class="limit"') == 2
    assert page.index("imperfection: w(s)") < page.index('<path class="limit"') < page.index("offset from the design,")
    plain = render(Run("r", (judged_member(beam, load_tolerances("nsss"), Conditions("self_weight")),)))
    assert "elastic sag</dt>" not in plain and 'class="line elastic' not in plain


def test_ticks_stay_on_the_plot() -> None:
    for top_m in (0.0161, 0.0099, 0.0021, 0.05):
        angles = np.zeros((6, 3))
        angles[0, 1], angles[3, 1] = -top_m / 1.5, 2 * top_m / 1.5
        member = judged_member(posed(Element("c", H, 3.0, 6, COLUMN), angles))
        plot = curve_plot(member.deviations.offset_m, 3.0, "w", member.result.segments)
        assert min(float(y) for y in re.findall(r'class="grid" d="M\d+ ([\d.]+)H', plot)) >= TOP


def test_a_band_that_is_not_known_is_left_out_and_said() -> None:
    member = judged_member(leaning(0.002))
    curve = member.deviations.offset_m
    assert curve_plot(curve, 3.0, "w", member.result.segments).count('class="band') == 2
    band = curve.band.copy()
    band[3, 0] = np.nan
    plot = curve_plot(replace(curve, band=band), 3.0, "w", member.result.segments)
    assert plot.count('class="band x"') == 2 and plot.count('class="band y"') == 1
    assert "band not known at 1 of 7 places" in plot
    unknown = replace(member.deviations, offset_between_m=replace(curve, band=np.full_like(curve.band, np.inf)))
    page = render(Run("r", (replace(member, deviations=unknown),)))
    assert "band not known at 7 of 7 places" in page and "without the 95 % bands that are not known" in page


def test_a_result_is_that_of_the_globalid_in_it(tmp_path: Path) -> None:
    """Not of its file's name: that may be another where file systems take no difference between A and a."""
    folder = write_run(tmp_path, 3)
    old, new = folder / "elements" / "0AbC$d_00.json", folder / "elements" / "0AbC$d_00~1.json"
    new.write_text(json.dumps({**json.loads(old.read_text()), "guid": "0AbC$d_00"}))
    old.unlink()
    run = read_run(folder)
    assert [(m.key, m.tag) for m in run.members][0] == ("0AbC$d_00", "C-0") and len(run.members) == 3
    assert [row["guid"] for row in run.unfitted] == ["plate", "rail"]


def test_names_are_escaped_and_nothing_is_fetched(tmp_path: Path) -> None:
    result = leaning(0.001, NASTY)
    about = {"tag": NASTY, "ifc_class": NASTY, "profile": NASTY}
    member = judged_member(replace(result, reasons=(NASTY,)), load_tolerances("nsss"), key=NASTY, about=about)
    page = render(Run(NASTY, (member,), ({"guid": NASTY, "status": NASTY},), {NASTY: NASTY}))

    class Tags(HTMLParser):
        scripts, sources = 0, []

        def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
            Tags.scripts += tag == "script"
            Tags.sources += [v for k, v in attributes if k in ("src", "href", "action", "data", "srcset")]
            assert not [k for k, _ in attributes if k.startswith("on")]

    Tags().feed(page)
    assert Tags.scripts == 2 and "alert(1)</script>" not in page
    assert all(source.startswith(("#", "data:,")) for source in Tags.sources)
    assert "default-src 'none'" in page  # the browser is told so too
    for outside in ("http://", "https://", "@import", "url(", "fetch(", "XMLHttpRequest", '<link rel="style'):
        assert outside not in page


def test_a_report_is_written_whole(tmp_path: Path) -> None:
    steps: list[int] = []
    run = read_run(write_run(tmp_path, 2))
    path = write_report(run, tmp_path / "new" / "r.html", None, (), lambda i, n: steps.append(i))
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>") and steps == [1, 2]


def test_members_without_a_chord_have_a_page() -> None:
    result = leaning(0.0)
    nodes = result.nodes_m.copy()
    nodes[-1] = nodes[0]
    page = render(Run("r", (judged_member(replace(result, nodes_m=nodes), load_tolerances("nsss")),)))
    assert "its ends coincide" in page


@pytest.mark.parametrize("segments", [1, 2, 200])
def test_any_number_of_segments(segments: int) -> None:
    element = Element("e", H, 4.0, segments, BEAM)
    page = render(Run("r", (judged_member(posed(element, np.zeros((segments, 3)))),)), Scan(np.zeros((5, 3))))
    assert len(page) < 400_000


# the scan's points --------------------------------------------------------------------------------


def test_points_near_a_member_and_no_others() -> None:
    far = Placement((7e5, 5e6, 100.0), axis=(1.0, 0.2, 0.1))
    element = Element("e", H, 3.0, 6, far)
    scan = simulate(element, bends=["3:y:8"], points=3000, noise_m=0.001, seed=3)
    result = posed(element, scan.joint_angles_rad)
    rng = np.random.default_rng(0)
    clutter = scan.points[:500] + 0.3
    beyond = scan.nodes_m[-1] + rng.uniform(0.02, 0.05, (50, 1)) * (scan.nodes_m[-1] - scan.nodes_m[-2]) / 0.5
    cloud = Cloud(np.concatenate([scan.points, clutter, beyond, rng.uniform(-50, 50, (2000, 3)) + far.location]))
    near = cloud.near(result, T_world_segments(result))
    assert 2900 < len(near.points) < 3060
    assert np.quantile(near.distance_m, 0.95) < 0.0025
    # Where on the member: the chain's node is as far along as its number says.
    at = near.s_m / element.segment_length_m
    start = result.nodes_m[:-1][near.segment]
    along = np.einsum("ij,ij->i", near.points - start, (result.nodes_m[1:] - result.nodes_m[:-1])[near.segment]) / 0.25
    np.testing.assert_allclose(np.clip(along, 0, 1), at - near.segment, atol=1e-6)


def test_a_scan_in_pieces_shows_what_the_whole_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    element = Element("e", H, 3.0, 6, BEAM)
    points = simulate(element, points=3000, noise_m=0.001, seed=3).points
    far = posed(Element("far", H, 3.0, 6, replace(BEAM, location=(0.0, 0.0, 0.0))), np.zeros((6, 3)))
    gone = replace(far, status="not_scanned")
    run = Run("r", tuple(judged_member(r) for r in (posed(element, np.zeros((6, 3))), far, gone)))
    whole, pieces = (nearby(run, [Scan(part) for part in parts]) for parts in ([points], np.array_split(points, 7)))
    for near in (whole, pieces):
        assert len(near.of_members[0].points) > 2900 and len(near.of_members[1].points) == 0
        assert near.of_members[2] is None
    np.testing.assert_allclose(np.sort(whole.of_members[0].s_m), np.sort(pieces.of_members[0].s_m))
    assert render(run, whole).count("scan points within 50 mm") >= 1
    # Many points: a bounded choice, from all of the pieces.
    monkeypatch.setattr("linear_ik.report.cloud.MOST_POINTS", 700)
    few = nearby(run, [Scan(part) for part in np.array_split(points[np.argsort(points[:, 0])], 7)]).of_members[0]
    assert len(few.points) == 700 and min(np.histogram(few.s_m, 6, (0.0, 3.0))[0]) > 80


def test_stray_points_at_the_end_of_the_world_hide_nothing() -> None:
    element = Element("e", H, 3.0, 6, BEAM)
    points = simulate(element, points=1000, noise_m=0.0).points
    result = posed(element, np.zeros((6, 3)))
    for strays in ([[-9e7, -9e7, -9e7]], [[9e7, 9e7, 9e7]], [[-9e7, 9e7, 0.0], [9e7, -9e7, 0.0]]):
        near = Cloud(np.concatenate([strays, points])).near(result, T_world_segments(result))
        assert len(near.points) == 1000


def test_a_scan_in_other_coordinates_is_moved_to_the_results(tmp_path: Path) -> None:
    folder = write_run(tmp_path, 2)
    T = np.eye(4)
    T[:3, 3] = (100.0, -50.0, 3.0)
    (folder / "run.json").write_text(json.dumps({"T_model_scan": T.tolist()}))
    found = linear_ik.read_result(folder / "elements" / "0AbC$d_00.json")
    points = simulate(found.element, joint_angles_rad=found.joint_angles_rad, points=1000).points
    assert "1,000 scan points" in rendered(folder, Scan(points - T[:3, 3]))
    assert "0 scan points" in rendered(folder, Scan(points))


def test_sections_are_where_they_are_asked_for() -> None:
    member = judged_member(leaning(0.002))
    for asked, shown in (((2.9, 0.4), ["0.40", "2.90"]), ((), ["0.75", "1.50", "2.25"])):
        page = render(Run("r", (member,)), None, asked)
        assert re.findall(r"section at ([\d.]+) m", page) == shown


def test_a_section_on_no_member_is_an_error_and_on_some_members_is_not() -> None:
    short = posed(Element("short", H, 1.0, 2, BEAM), np.zeros((2, 3)))
    run = Run("r", (judged_member(leaning(0.002)), judged_member(short)))
    page = render(run, None, (2.5,))
    assert re.findall(r"section at ([\d.]+) m", page) == ["2.50"]
    assert "None of the places asked for is on this element, which is 1.00 m long." in page
    for wrong in (9.0, -0.1, float("nan")):
        with pytest.raises(SettingsError, match="0 to 3.000 m"):
            render(run, None, (0.4, wrong))


def test_conditions_of_each(tmp_path: Path) -> None:
    folder, nsss = write_run(tmp_path, 3), load_tolerances("nsss")
    each = {"C-0": Conditions("unloaded"), "0AbC$d_01": Conditions("loaded")}
    run = read_run(folder, nsss, ConditionsOfEach(Conditions("self_weight"), each))
    assert [m.verdicts[0].loading_state for m in run.members] == ["unloaded", "loaded", "self_weight"]
    for known in ("plate", "Plate", "rail", "Rail"):  # without a result, but of the building
        read_run(folder, nsss, ConditionsOfEach(named={known: Conditions()}))
    with pytest.raises(ToleranceError, match="no element 'C-9'"):
        read_run(folder, nsss, ConditionsOfEach(named={"C-9": Conditions()}))


def test_sections_show_the_points_of_their_slice() -> None:
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    svg = section_plot(square, square + 0.01, np.array([[0.1, 0.0], [0.0, 0.105]]), np.array([0.0, 0.004]), 0.005)
    assert 'class="dots d0"' in svg and 'class="dots d4"' in svg and "100 mm" in svg
    # X to the right, Y up: the second point is above the first, and left of it.
    found = (re.search(rf'dots {d}" d="M([\d.]+) ([\d.]+)h0', svg) for d in ("d0", "d4"))
    (x0, y0), (x1, y1) = (map(float, one.groups()) for one in found)
    assert x1 < x0 and y1 < y0


def test_size_and_time_of_fifty(tmp_path: Path) -> None:
    """Under 8 MB, and (CPU, this process) under 10 s, with 5,000 points of each."""
    members, clouds = [], []
    for i in range(50):
        element = Element(f"e{i}", IShape(0.3, 0.3, 0.011, 0.019, 0.027), 5.0, 10, Placement((8.0 * i, 0.0, 0.0)))
        scan = simulate(element, bends=["3:y:0.2", "6:x:0.1"], points=5000, seed=i)
        members.append(posed(element, scan.joint_angles_rad))
        clouds.append(scan.points)
    cloud, profile = Scan(np.concatenate(clouds)), load_tolerances("aisc303")
    started = time.process_time()
    run = Run("fifty", tuple(judged_member(m, profile, key=str(i)) for i, m in enumerate(members)))
    page = render(run, cloud)
    assert time.process_time() - started < 10.0
    assert len(page.encode()) < 8e6


# in a browser -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Tab, str]]:
    """The page of a run with its scan, open in a browser without a network."""
    if CHROMIUM is None:
        pytest.skip("no Chromium (Debian: apt-get install chromium)")
    folder = write_run(tmp_path_factory.mktemp("run"), 5)
    found = linear_ik.read_result(folder / "elements" / "0AbC$d_03.json")
    scan = simulate(found.element, joint_angles_rad=found.joint_angles_rad, points=4000, noise_m=0.001)
    (folder / "report.html").write_text(rendered(folder, Scan(scan.points)), encoding="utf-8")
    with browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened, (folder / "report.html").as_uri()
        # The tests themselves read the canvas, which Chromium has an opinion on.
        assert [text for text in opened.complaints if not text.startswith("Canvas2D: ")] == []
        assert all(url.startswith(("file:", "data:")) for url in opened.requests)


TAGS = "[...document.querySelectorAll('#list tbody tr')].filter(r => !r.hidden).map(r => r.cells[0].textContent).join()"
CANVAS = """(() => {
  const c = document.querySelector('article.open canvas');
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let grey = 0, green = 0, blue = 0;
  for (let i = 0; i < d.length; i += 4) if (d[i + 3] > 20) {
    if (d[i + 1] > d[i] + 25 && d[i + 1] > d[i + 2] + 25) green++;
    else if (d[i + 2] > d[i] + 80 && d[i + 2] > d[i + 1] + 40) blue++;
    else if (Math.abs(d[i] - d[i + 1]) < 25) grey++;
  }
  return [grey, green, blue];
})()"""


def test_list_search_filter_and_sort(tab: tuple[Tab, str]) -> None:
    page, url = tab
    page.open(url)
    assert page.ask(TAGS) == "C-0,C-1,C-2,C-3,C-4"
    page.ask("document.getElementById('search').focus()")
    page.send("Input.insertText", text="c-3 heb")
    assert page.ask(TAGS) == "C-3" and page.ask("document.getElementById('shown').textContent") == "1 shown"
    page.ask("search.value = ''; search.dispatchEvent(new Event('input'))")
    page.ask("verdict.value = 'fail'; verdict.dispatchEvent(new Event('change'))")
    assert page.ask(TAGS) == "C-3"
    page.ask("verdict.value = ''; verdict.dispatchEvent(new Event('change'))")
    head = "[...document.querySelectorAll('#list th')].find(h => h.textContent.startsWith('Plumb'))"
    page.ask(f"{head}.querySelector('button').focus()")
    page.press("Enter", 13, "\r")
    page.press("Enter", 13, "\r")
    assert page.ask(f"{head}.getAttribute('aria-sort')") == "descending"
    assert page.ask(TAGS) == "C-3,C-2,C-1,C-0,C-4"  # what has no figure comes last


def opened(page: Tab, heading: str) -> bool:
    return bool(page.wait(f"document.querySelector('article.open h2')?.textContent === '{heading}'"))


def test_an_element_opens_and_the_way_back(tab: tuple[Tab, str], tmp_path: Path) -> None:
    page, url = tab
    page.open(url)
    page.ask("[...document.querySelectorAll('#list a')].find(a => a.textContent === 'C-3').click()")
    assert opened(page, "C-3: Column 3")
    assert page.ask("location.hash") == "#/0AbC%24d_03" and not page.ask("document.getElementById('run').offsetHeight")
    grey, green, blue = page.ask(CANVAS)
    assert grey > 300 and green > 2000 and blue > 100
    picture = np.asarray(Image.open(page.shot(tmp_path / "page.png", whole=True)).convert("RGB"))
    assert (picture < 250).any(axis=2).mean() > 0.05
    page.ask("document.querySelector('article.open [rel=next]').click()")
    assert opened(page, "C-4: Column 4")
    assert page.ask(CANVAS)[1] == 0  # not found, so there is no after
    page.ask("history.back()")
    assert opened(page, "C-3: Column 3")
    page.ask("history.back()")
    assert page.wait("document.getElementById('run').offsetHeight > 0")
    page.open(url + "#/0AbC$d_01")
    assert opened(page, "C-1: Column 1")


def test_the_view_turns_by_keyboard_and_shows_what_is_asked(tab: tuple[Tab, str]) -> None:
    page, url = tab
    page.open(url + "#/0AbC$d_03")
    page.ask("document.querySelector('article.open canvas').focus()")
    sum_of = "document.querySelector('article.open canvas').toDataURL()"
    before = page.ask(sum_of)
    page.press("ArrowLeft", 37)
    turned = page.ask(sum_of)
    assert turned != before
    page.ask("{ const s = document.querySelector('article.open [data-times]'); s.value = '20'; "
             "s.dispatchEvent(new Event('change')); }")  # fmt: skip
    assert page.ask(sum_of) != turned
    for what, colour in (("points", 2), ("after", 1)):
        page.ask(f"document.querySelector('article.open [data-show={what}]').click()")
        assert page.ask(CANVAS)[colour] == 0


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_cut_off(tab: tuple[Tab, str], width: int) -> None:
    page, url = tab
    for place in ("", "#/0AbC$d_03"):
        page.open(url + place, width, 800)
        assert page.ask("document.documentElement.scrollWidth") <= width
    page.open(url, width, 800)
    beyond = page.ask("(s => s.scrollWidth - s.clientWidth)(document.querySelector('.scroll'))")
    assert beyond <= 2 if width == 1280 else beyond > 100


def test_a_phone_reaches_every_column(tab: tuple[Tab, str]) -> None:
    """The list moves sideways below its heads and beside its tags; a figure's note stands below it."""
    page, url = tab
    page.open(url, 390, 800)
    where = """[...document.querySelectorAll('#list th')].map(h => {
      document.querySelector('.scroll').scrollLeft = h.offsetLeft - 60;
      const cells = [h, [...document.querySelectorAll('#list tbody tr')][3].cells[h.cellIndex]];
      const tag = document.querySelector('#list td.tag').getBoundingClientRect();
      return [h.textContent, tag.left >= 0 && tag.right < 200, ...cells.map(c => {
        const r = c.getBoundingClientRect();
        return r.width > 10 && r.right <= 391 && r.left >= 0;
      })];
    })"""
    reached = page.ask(where)
    assert {"Status", "Plumb, mm", "Off design, mm", "LOA"} <= {name for name, *_ in reached}
    assert [row for row in reached if not all(row[1:])] == []
    assert page.ask("window.scrollX") == 0
    page.open(url + "#/0AbC$d_03", 390, 800)
    notes = page.ask("""[...document.querySelectorAll('article.open .figures .note')].filter(n => n.textContent)
      .map(n => n.getBoundingClientRect()).map(r => r.height > 10 && r.left >= 0 && r.right <= 390)""")
    assert len(notes) >= 5 and all(notes)


def test_text_stands_out_from_its_ground(tab: tuple[Tab, str]) -> None:
    """WCAG 2.1 AA: 4.5 to 1."""
    page, url = tab
    contrast = """(() => {
      const light = c => { const v = c.match(/[\\d.]+/g).slice(0, 3).map(x => x / 255)
        .map(x => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
        return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]; };
      const ground = e => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor;
        if (!/, 0\\)$/.test(c)) return c; } return 'rgb(255, 255, 255)'; };
      let worst = 21, where = '';
      for (const e of document.querySelectorAll('main *')) {
        if (e.closest('svg, script') || ![...e.childNodes].some(n => n.nodeType === 3 && n.data.trim())) continue;
        const [a, b] = [light(getComputedStyle(e).color), light(ground(e))].sort((p, q) => q - p);
        if ((a + 0.05) / (b + 0.05) < worst) { worst = (a + 0.05) / (b + 0.05); where = e.textContent; }
      }
      return [worst, where];
    })()"""
    page.open(url)
    worst, where = page.ask(contrast)
    assert worst >= 4.5, where
    assert page.ask("[...document.querySelectorAll('th')].every(h => h.scope)")
    assert page.ask("[...document.querySelectorAll('input, select')].every(c => c.closest('label'))")


def test_it_prints(tab: tuple[Tab, str], tmp_path: Path) -> None:
    page, url = tab
    page.open(url)
    whole = page.pdf(tmp_path / "all.pdf").read_bytes()
    page.open(url + "#/0AbC$d_03")
    one = page.pdf(tmp_path / "one.pdf").read_bytes()
    sheets = [len(re.findall(rb"/Type /Page\b", data)) for data in (whole, one)]
    assert 1 <= sheets[1] <= 4 and sheets[0] >= 1 + 5
