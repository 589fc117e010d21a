"""Two epochs: what moved, what did not, and how often that is wrong."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from asbuilt_samples import result_of

import linear_ik
from linear_ik.cli import main
from linear_ik.compare import CompareError, adjust, compare
from linear_ik.comparison_table import comparison_lines
from linear_ik.element import Element, Placement
from linear_ik.errors import SettingsError
from linear_ik.exports.result_json import write_result
from linear_ik.profile import Rectangle
from linear_ik.result import FitResult

SIGMA = 0.0005


@cache
def design(i: int, segments: int = 10) -> FitResult:
    """A member found as designed."""
    return result_of(member(i, segments), sigma_m=SIGMA)


def member(i: int, segments: int = 10) -> Element:
    """One of a grid of columns, beams and braces."""
    axis = ((0, 0, 1), (1, 0, 0), (0, 0.6, 0.8))[i % 3]
    return Element(f"M{i}", Rectangle(0.1, 0.3), 4.0, segments, Placement((5.0 * (i % 7), 6.0 * (i // 7), i % 4), axis))


@pytest.fixture(scope="module")
def straight() -> FitResult:
    return result_of(member(0), sigma_m=SIGMA)


def fits(count: int, rng: np.random.Generator, smooth: bool = True, segments: int = 10, sigma: float = SIGMA) -> dict:
    """Fits of members that are as designed, with the noise that their covariances state.

    The noise of the nodes of an element is drawn together: alike in neighbours where ``smooth``.
    """
    out, share = {}, np.linspace(0, 1, segments + 1)
    between = np.exp(-(((share[:, None] - share) / 0.3) ** 2)) if smooth else np.eye(segments + 1)
    L = np.linalg.cholesky(between + 1e-9 * np.eye(segments + 1))
    R, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    axes = R * (sigma * np.array([1.0, 2.0, 10.0]))  # as different by direction as covariances are
    for i in range(count):
        result = design(i % 210, segments)
        noise = L @ rng.standard_normal((segments + 1, 3)) @ axes.T
        covariance = np.tile(axes @ axes.T, (segments + 1, 1, 1))
        out[f"G{i:04d}"] = replace(result, nodes_m=result.nodes_m + noise, nodes_covariance_m2=covariance)
    return out


def moved_by(result: FitResult, displacement: np.ndarray) -> FitResult:
    return replace(result, nodes_m=result.nodes_m + displacement)


# how often it is wrong -------------------------------------------------------------------


@pytest.mark.parametrize("smooth", [True, False], ids=["alike neighbours", "independent nodes"])
def test_false_alarms_are_as_rare_as_stated(smooth: bool) -> None:
    rng = np.random.default_rng(1)
    result = compare(fits(700, rng, smooth), fits(700, rng, smooth), correction="none", relevant_m=1.0)
    share = np.mean([m.verdict == "moved" for m in result.elements])
    # 5 % and three standard deviations of a count of 700; with independent nodes Sidak is exact.
    assert share <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 700)
    if not smooth:
        assert share >= 0.05 - 3 * np.sqrt(0.05 * 0.95 / 700)


def test_among_many_elements_a_false_alarm_is_as_rare_as_stated() -> None:
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(30):
        result = compare(fits(30, rng, False), fits(30, rng, False), relevant_m=1.0)
        wrong += any(m.verdict == "moved" for m in result.elements)
    # Of 30 buildings 1.5 are expected; more than 5 come less than once in 100 times.
    assert wrong <= 5


@pytest.mark.parametrize(("count", "sag_m"), [(1, 0.003), (200, 0.005)])
def test_a_real_movement_is_found(count: int, sag_m: float) -> None:
    """3 mm in a single element; among 200 the corrections ask for more."""
    rng = np.random.default_rng(3)
    before, after = (
        {f"G{i}": moved_by(design(i), SIGMA * rng.standard_normal((11, 3))) for i in range(1, count + 1)} for _ in "ab"
    )
    sag = np.zeros((11, 3))
    sag[:, 2] = -sag_m * np.sin(np.pi * np.linspace(0, 1, 11))
    after["G1"] = moved_by(after["G1"], sag)  # a beam along x
    result = compare(before, after)
    assert [m.key for m in result.elements if m.verdict == "moved"] == ["G1"]
    found = result.elements[0]
    assert found.key == "G1" and 3 <= found.largest <= 7
    assert abs(found.across_m[found.largest] - sag_m) < 4 * np.sqrt(2) * SIGMA
    assert found.largest_band_m == pytest.approx(1.96 * np.sqrt(2) * SIGMA, rel=0.01)
    assert abs(found.along_m).max() < 5 * np.sqrt(2) * SIGMA


def test_a_slide_along_the_axis_is_told_from_a_bend(straight: FitResult) -> None:
    after = moved_by(straight, np.tile([0.001, 0.0, 0.005], (11, 1)))
    (m,) = compare(straight, after).elements
    np.testing.assert_allclose(m.along_m, 0.005, atol=1e-12)
    np.testing.assert_allclose(m.across_m, 0.001, atol=1e-12)


def test_corrections_are_those_of_the_books() -> None:
    p = np.array([0.04, 0.01, 0.03, 0.005])
    np.testing.assert_allclose(adjust(p, "holm"), [0.06, 0.03, 0.06, 0.02])
    np.testing.assert_allclose(adjust(p, "fdr"), [0.04, 0.02, 0.04, 0.02])
    np.testing.assert_array_equal(adjust(p, "none"), p)


def test_segments_may_differ_between_the_epochs() -> None:
    sag = np.zeros((11, 3))
    sag[:, 0] = 0.004 * np.linspace(0, 1, 11)
    before = result_of(member(0, 4), sigma_m=SIGMA)
    same, bent = result_of(member(0, 10), sigma_m=SIGMA), moved_by(result_of(member(0, 10), sigma_m=SIGMA), sag)
    (unmoved,), (m,) = compare(before, same).elements, compare(before, bent).elements
    assert unmoved.verdict == "not moved" and unmoved.largest_m < 1e-9
    assert m.verdict == "moved" and len(m.nodes_m) == 11
    np.testing.assert_allclose(m.displacement_m, sag, atol=1e-9)


# what it does not know -------------------------------------------------------------------


def test_a_design_that_runs_the_other_way_in_the_second_epoch_is_no_movement() -> None:
    there = Element("b", Rectangle(0.1, 0.2), 3.0, 10, Placement((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    back = replace(there, placement=Placement((3, 0, 0), (-1, 0, 0), (0, 1, 0)))
    angles = np.zeros((10, 3))
    angles[[0, 7], 0] = 0.002, -0.003
    before = result_of(there, angles, sigma_m=SIGMA)
    # The same shape, node for node, told from its other end; its last segment nobody saw.
    unseen = (replace(before.segments[0], status="inferred"),)
    after = replace(
        result_of(back, sigma_m=SIGMA), nodes_m=before.nodes_m[::-1], segments=unseen + before.segments[1:]
    )  # fmt: skip
    (m,) = compare({"g": before}, {"g": after}).elements
    assert m.verdict == "not moved where seen" and m.largest_m < 1e-9
    assert m.seen.tolist() == [True] * 10 + [False]
    assert m.reasons == ("Its design runs the other way in the second epoch.",)
    (m,) = compare({"g": before}, {"g": moved_by(after, np.tile([0, 0.02, 0], (11, 1)))}).elements
    assert m.verdict == "moved" and m.across_m == pytest.approx(np.full(11, 0.02), abs=1e-4)


def test_a_design_that_was_moved_is_named_and_the_scans_are_compared() -> None:
    here = Element("b", Rectangle(0.1, 0.2), 3.0, 10, Placement((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    for offset, length_m, said in (
        ((0, 0.05, 0), 3.0, ["Its design was moved, by up to 50 mm at its ends."]),
        ((10, 0, 0), 3.0, ["Its design was moved, by up to 10000 mm at its ends."]),
        ((0, 0, 0), 3.2, ["Designed 3.000 m long, then 3.200 m."]),
        ((0, 0, 0), 3.0, []),
    ):
        there = replace(here, placement=Placement(offset, (1, 0, 0), (0, 1, 0)), length_m=length_m)
        after = replace(result_of(there, sigma_m=SIGMA), nodes_m=result_of(here).nodes_m)
        (m,) = compare({"g": result_of(here, sigma_m=SIGMA)}, {"g": after}).elements
        assert (m.verdict, list(m.reasons)) == ("not moved", said)


def test_what_was_not_seen_is_inconclusive(straight: FitResult) -> None:
    gone = replace(straight, status="not_scanned")
    doubtful = moved_by(
        replace(straight, status="uncertain", reasons=("Only one side was seen.",)), np.full((11, 3), 0.01)
    )
    wide = replace(straight, nodes_covariance_m2=straight.nodes_covariance_m2 * 400)
    before = dict.fromkeys(("gone", "doubtful", "wide", "sure", "dropped"), straight)
    after = {"gone": gone, "doubtful": doubtful, "wide": wide, "sure": straight, "new": straight}
    by_key = {m.key: m for m in compare(before, after).elements}
    assert {k: m.verdict for k, m in by_key.items()} == {
        "gone": "inconclusive", "doubtful": "inconclusive", "wide": "inconclusive", "sure": "not moved",
        "dropped": "inconclusive", "new": "inconclusive",
    }  # fmt: skip
    assert "Not in the scan of the second epoch." in by_key["gone"].reasons
    assert "second epoch says uncertain: Only one side was seen." in by_key["doubtful"].reasons[0]
    assert by_key["doubtful"].p_value < 1e-6
    assert "The first epoch has no result." in by_key["new"].reasons
    assert "27.7 mm: more than 10 mm" not in by_key["wide"].reasons and "more than 10 mm" in by_key["wide"].reasons[0]


def test_a_place_along_the_axis_that_nobody_sees_does_not_hide_a_bend(straight: FitResult) -> None:
    """The covariance says it already: wide along the member, narrow across it."""
    along = np.outer([0, 0, 1.0], [0, 0, 1.0]) * 0.03**2
    slid = replace(
        straight,
        status="uncertain",
        reasons=("the scan does not show where the element lies along its axis: as designed, to 60 mm (95 %)",),
        reason_codes=("place_not_shown",),
        nodes_covariance_m2=straight.nodes_covariance_m2 + along,
    )
    (still,) = compare(slid, moved_by(slid, np.tile([0.0, 0.0, 0.02], (11, 1)))).elements
    (bent,) = compare(slid, moved_by(slid, np.tile([0.01, 0.0, 0.02], (11, 1)))).elements
    # 2 cm along the axis are within the band: nobody may say that it did not move.
    assert (still.verdict, bent.verdict) == ("not moved where seen", "moved")
    assert still.along_band_m == pytest.approx(1.96 * np.sqrt(2 * (0.03**2 + SIGMA**2)), rel=1e-3)
    assert still.limits == ("Along the axis a movement below 83.2 mm would not be seen.",) and not bent.limits
    assert "along its axis" in bent.reasons[0]
    (narrow,) = compare(slid, slid, relevant_m=0.1).elements
    assert narrow.verdict == "not moved" and "83.2 mm" in narrow.limits[0]


def test_only_codes_say_which_doubts_the_covariance_carries(straight: FitResult) -> None:
    """Results written before there were codes, and codes that nobody knows yet, are in doubt; notes are none."""
    place = "the scan does not show where the element lies along its axis: as designed, to 60 mm (95 %)"
    size = "the section measures 100.5 x 200.0 mm where 100.0 x 200.0 mm was designed"
    said = {
        (): (place,),
        ("place_not_shown", "section_size"): (place, size),
        ("place_not_shown", "of_tomorrow"): (place, ""),
    }
    before = {codes: replace(straight, status="uncertain", reasons=r, reason_codes=codes) for codes, r in said.items()}
    verdicts = {m.key: m.verdict for m in compare(before, dict.fromkeys(before, straight)).elements}
    assert verdicts == {
        (): "inconclusive",
        ("place_not_shown", "section_size"): "not moved",
        ("place_not_shown", "of_tomorrow"): "inconclusive",
    }


def test_parts_that_were_not_measured_are_not_tested(straight: FitResult) -> None:
    def partly(hidden: int) -> FitResult:
        segments = [
            replace(s, status="inferred" if k < hidden else "measured") for k, s in enumerate(straight.segments)
        ]
        reason = f"segments 1 to {hidden} inferred from the neighbours only"
        codes = ("segments_inferred",)
        return replace(straight, status="uncertain", reasons=(reason,), reason_codes=codes, segments=tuple(segments))

    start, end = np.zeros((11, 3)), np.zeros((11, 3))
    start[:3, 0], end[8:, 0] = 0.01, 0.01
    (hidden,) = compare(partly(3), moved_by(straight, start)).elements
    (shown,) = compare(partly(3), moved_by(straight, end)).elements
    (most,) = compare(partly(8), straight).elements
    assert (hidden.verdict, shown.verdict, most.verdict) == ("not moved where seen", "moved", "inconclusive")
    assert hidden.limits[1] == "3 of 11 nodes not tested." and hidden.not_tested == 3
    assert hidden.seen.tolist() == [False] * 3 + [True] * 8 and shown.largest >= 8
    assert "Only 27 % of it was measured" in most.reasons[-1]


def test_held_nodes_without_variance_are_no_alarm() -> None:
    result = result_of(member(0), sigma_m=SIGMA)
    covariance = result.nodes_covariance_m2.copy()
    covariance[0] = 0.0
    held = replace(result, nodes_covariance_m2=covariance)
    (m,) = compare(held, moved_by(held, np.full((11, 3), 1e-9))).elements
    assert m.verdict == "not moved" and m.p_value > 0.9


# the registration ------------------------------------------------------------------------


def test_a_common_shift_is_reported_and_can_be_removed() -> None:
    rng = np.random.default_rng(4)
    before, after = fits(60, rng, sigma=0.0002), fits(60, rng, sigma=0.0002)
    turn = np.array([0.0, 0.0, 2e-4])
    for key, result in after.items():
        shift = np.array([0.004, -0.002, 0.001]) + np.cross(turn, result.nodes_m - [15.0, 25.0, 2.0])
        after[key] = moved_by(result, shift)
    for key in list(after)[::10]:
        after[key] = moved_by(after[key], np.array([0.0, 0.02, 0.02]))
    result = compare(before, after)
    assert result.shift is not None and result.shift.p_value < 1e-6
    expected = np.array([0.004, -0.002, 0.001]) + np.cross(turn, result.shift.centre_m - [15.0, 25.0, 2.0])
    sigma = np.sqrt(np.diag(result.shift.covariance))
    assert (np.abs(result.shift.translation_m - expected) < 4 * sigma[:3]).all()
    assert (np.abs(result.shift.rotation_rad - turn) < 4 * sigma[3:]).all()
    assert any("registration? --remove-shift" in line for line in comparison_lines(result))
    cleared = compare(before, after, remove_shift=True)
    assert {m.key for m in cleared.elements if m.verdict == "moved"} == set(list(after)[::10])


def test_no_shift_is_claimed_where_there_is_none() -> None:
    rng = np.random.default_rng(5)
    p = [compare(fits(12, rng), fits(12, rng)).shift.p_value for _ in range(100)]
    # One in a hundred is stated; five come less than once in 200 times.
    assert np.mean(np.array(p) < 0.01) <= 0.04


# files and the command -------------------------------------------------------------------


def epoch(folder: Path, results: dict[str, FitResult]) -> Path:
    for key, result in results.items():
        write_result(result, folder / "elements" / f"{key}.json")
    return folder


def test_the_command_prints_a_table_and_writes_files(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    rng = np.random.default_rng(6)
    before, after = fits(5, rng, sigma=0.0002), fits(5, rng, sigma=0.0002)
    after["G0003"] = moved_by(after["G0003"], np.full((11, 3), 0.02))
    after["G0001"] = replace(after["G0001"], status="not_scanned")
    folders = [str(epoch(tmp_path / "2024", before)), str(epoch(tmp_path / "2026", after))]
    assert main(["compare", *folders, "-o", str(tmp_path / "new" / "c.csv")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("1 of 5 moved, 3 not moved, 1 inconclusive\n") and "Sidak" in out
    assert "registration? --remove-shift" not in out and "follow it; not taken out\n" in out
    assert "  moved: by more than both scans' uncertainty explains\n" in out and " <0.001" in out
    after_head = out.split(" p\n")[1]
    assert [line.split()[0] for line in after_head.splitlines()] == ["moved", "not", "not", "not", "inconclusive"]
    rows = list(csv.DictReader((tmp_path / "new" / "c.csv").open()))
    assert rows[0]["key"] == "G0003" and float(rows[0]["largest_m"]) == pytest.approx(0.0346, abs=0.005)
    sure = next(row for row in rows if row["verdict"] == "not moved")
    assert 0.001 < float(sure["unseen_along_m"]) < 0.01 and (sure["nodes"], sure["nodes_not_tested"]) == ("11", "0")
    assert out.count("Along the axis a movement below ") == 3
    assert rows[-1]["unseen_along_m"] == "" and rows[-1]["status_after"] == "not_scanned" and rows[-1]["p_value"] == ""
    assert main(["compare", *folders, "-q", "-o", str(tmp_path / "c.json")]) == 0
    assert capsys.readouterr().out == ""
    whole = json.loads((tmp_path / "c.json").read_text())
    assert whole["elements"][0]["verdict"] == "moved" and len(whole["elements"][0]["displacement_m"]) == 11


def test_elements_are_called_by_their_tags(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    rng = np.random.default_rng(7)
    before, after = fits(5, rng, sigma=0.0002), fits(5, rng, sigma=0.0002)
    before["G0003"] = replace(before["G0003"], element=replace(before["G0003"].element, name="M2"))
    for of in (before, after):
        of["G0001"] = replace(of["G0001"], status="not_scanned")
    folders = [epoch(tmp_path / "2024", before), epoch(tmp_path / "2026", after)]
    tags = {key: f"B{i}" for i, key in enumerate(sorted(after))} | {"G0003": "B2"}
    rows = [f"{key},IfcBeam,{tag}" for key, tag in tags.items()]
    (folders[1] / "elements.csv").write_text("\n".join(["guid,ifc_class,tag", *rows]) + "\n")
    table = tmp_path / "c.csv"
    assert main(["compare", *map(str, folders), "--remove-shift", "-o", str(table)]) == 0
    out = capsys.readouterr().out
    assert "; taken out of the figures below\n" in out
    assert "0 inconclusive, 1 absent in both" in out.splitlines()[0] and "\nabsent in both  " in out
    names = {line[16:].split("  ")[0].strip() for line in out.split(" p\n")[1].splitlines()}
    assert {"B0 M0", "B2 M2 G0002", "B2 M2 G0003"} <= names, names
    found = {row["key"]: row for row in csv.DictReader(table.open())}
    assert (found["G0004"]["tag"], found["G0004"]["ifc_class"]) == ("B4", "IfcBeam")
    assert found["G0001"]["verdict"] == "absent in both"


def test_results_are_matched_by_the_globalid_in_them(tmp_path: Path, straight: FitResult) -> None:
    for epoch_name, stem in (("a", "G"), ("b", "g~1")):
        write_result(straight, tmp_path / epoch_name / "elements" / f"{stem}.json", {"guid": "g"})
    (m,) = compare(tmp_path / "a", tmp_path / "b").elements
    assert (m.key, m.verdict) == ("g", "not moved")
    write_result(straight, tmp_path / "b" / "elements" / "other.json", {"guid": "g"})
    with pytest.raises(CompareError, match="second result of g"):
        compare(tmp_path / "a", tmp_path / "b")


def test_single_results_of_any_name_are_compared(tmp_path: Path, straight: FitResult, capsys) -> None:
    files = [write_result(straight, tmp_path / name) for name in ("before.json", "after.json")]
    assert main(["compare", *map(str, files)]) == 0
    assert "0 of 1 moved, 1 not moved" in capsys.readouterr().out
    gone = write_result(replace(straight, status="not_scanned"), tmp_path / "gone.json")
    assert main(["compare", str(files[0]), str(gone)]) == 3


def test_bad_input_is_one_line(tmp_path: Path, straight: FitResult, capsys: pytest.CaptureFixture) -> None:
    one, empty = epoch(tmp_path / "one", {"A": straight}), tmp_path / "empty"
    other = epoch(tmp_path / "other", {"B": straight})
    empty.mkdir()
    for arguments, said in (
        ([one, empty], f"{empty}: holds no elements/*.json"),
        ([one, other], "no element in common"),
        ([one, one, "--remove-shift"], "--remove-shift: too few elements"),
        ([one, one, "--level", "2"], "--level: 2 (between 0 and 1)"),
        ([one, one, "--correction", "x"], "--correction: 'x' (one of holm, fdr, none)"),
        ([one, one, "-o", tmp_path / "c.xlsx"], "unknown extension '.xlsx'"),
        ([one, tmp_path / "none"], "cannot be read"),
    ):
        assert main(["compare", *map(str, arguments)]) == 2
        captured = capsys.readouterr()
        assert said in captured.err and captured.err.startswith("error: ") and not captured.out
    with pytest.raises(CompareError):
        linear_ik.compare({"A": straight}, {"B": straight})
    with pytest.raises(SettingsError):
        linear_ik.compare(straight, straight, relevant_m=0.0)
