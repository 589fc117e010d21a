"""Sections by name: the table against areas as manufacturers print them, names as people write them."""

import pytest

import linear_ik
from linear_ik.element_file import element_from_mapping
from linear_ik.errors import ElementError
from linear_ik.profile import Circle, CircleHollow, IShape, LShape, Rectangle, RectangleHollow, UShape
from linear_ik.rolled_sections import SERIES
from linear_ik.section import section_properties
from linear_ik.section_names import section

# cm2, from the tables of EN 10365 and its forerunners: another column than those that the package keeps.
AREAS_CM2 = {
    "IPE": "7.64 10.3 13.2 16.4 20.1 23.9 28.5 33.4 39.1 45.9 53.8 62.6 72.7 84.5 98.8 116 134 156",
    "HEA": "21.2 25.3 31.4 38.8 45.3 53.8 64.3 76.8 86.8 97.3 112.5 124.4 133.5 142.8 159.0 178.0 197.5 211.8 226.5 "
    "241.6 260.5 285.8 320.5 346.8",
    "HEB": "26.0 34.0 43.0 54.3 65.3 78.1 91.0 106.0 118.4 131.4 149.1 161.3 170.9 180.6 197.8 218.0 238.6 254.1 270.0 "
    "286.3 306.4 334.2 371.3 400.0",
    "HEM": "53.2 66.4 80.6 97.1 113.3 131.3 149.4 199.6 219.6 240.2 303.1 312.0 315.8 318.8 325.8 335.4 344.3 354.4 "
    "363.7 373.7 383.0 404.3 423.6 444.2",
    "UPE": "10.1 12.5 15.4 18.4 21.7 25.1 29.0 33.9 38.5 44.8 56.6 67.8 77.9 91.9",
    "UPN": "11.0 13.5 17.0 20.4 24.0 28.0 32.2 37.4 42.3 48.3 53.3 58.8 75.8 77.3 80.4 91.5",
}
SIZES = [(series, size) for series, table in SERIES.items() for size in table]


@pytest.mark.parametrize("series", SERIES)
def test_the_table_has_the_areas_that_are_printed(series):
    printed = [float(a) for a in AREAS_CM2[series].split()]
    assert len(printed) == len(SERIES[series])
    for size, area in zip(SERIES[series], printed, strict=True):
        # Three figures are printed. The flanges of UPN slope and their edges are round.
        tolerance = 0.03 if series == "UPN" else 0.006
        assert section_properties(section(f"{series}{size}")).area_m2 * 1e4 == pytest.approx(area, rel=tolerance), size


def test_the_depth_of_a_series_grows():
    for table in SERIES.values():
        assert [d[0] for d in table.values()] == sorted(d[0] for d in table.values())


@pytest.mark.parametrize("name", ["HEB340", "heb 340", "HE 340 B", "HE340B", "HE-B 340", "HEB_340"])
def test_a_wide_flange_however_it_is_written(name):
    assert section(name) == IShape(0.3, 0.34, 0.012, 0.0215, 0.027)


@pytest.mark.parametrize(
    ("name", "profile"),
    [
        ("IPE200", IShape(0.1, 0.2, 0.0056, 0.0085, 0.012)),
        ("UPE200", UShape(0.2, 0.08, 0.006, 0.011, 0.013)),
        ("UNP 200", UShape(0.2, 0.075, 0.0085, 0.0115, 0.0115)),
        ("CHS 168.3x5", CircleHollow(0.16830 / 2, 0.005)),
        ("chs168,3×5.0", CircleHollow(0.16830 / 2, 0.005)),
        ("SHS 100x6", RectangleHollow(0.1, 0.1, 0.006)),
        ("SHS100x100x6", RectangleHollow(0.1, 0.1, 0.006)),
        ("RHS 200x100x8", RectangleHollow(0.1, 0.2, 0.008)),
        ("L 100x10", LShape(0.1, 0.1, 0.01)),
        ("L150*100*12", LShape(0.15, 0.1, 0.012)),
        ("FL 100x10", Rectangle(0.01, 0.1)),
        ("SQ 30", Rectangle(0.03, 0.03)),
        ("RD 20", Circle(0.01)),
        ("Ø20", Circle(0.01)),
    ],
)
def test_names_that_say_their_dimensions(name, profile):
    assert section(name) == profile


@pytest.mark.parametrize(
    "name", ["", "HEB", "HEB 345", "IPE200x5", "XYZ 100", "CHS 100", "CHS 10x9", "L" * 1000, "ü", "\n"]
)
def test_a_name_that_is_none(name):
    with pytest.raises(ElementError, match="^profile: "):
        section(name)


def test_a_size_that_is_missing_names_its_neighbours():
    with pytest.raises(ElementError, match="HEB340"):
        section("HEB 345")


def test_an_element_file_takes_a_name(tmp_path):
    (tmp_path / "beam.yaml").write_text("name: beam\nprofile: HEB340\nlength: 5\n")
    element = linear_ik.load_element(tmp_path / "beam.yaml")
    assert element.profile == section("HEB340")
    assert element_from_mapping(linear_ik.element_to_mapping(element)) == element


def test_a_wrong_name_in_an_element_file_is_one_line(tmp_path):
    (tmp_path / "beam.yaml").write_text("name: beam\nprofile: HEB341\nlength: 5\n")
    with pytest.raises(
        ElementError,
        match=r"beam.yaml: profile: unknown section 'HEB341' \(.*HEB340, .*or another of HEB100 to HEB1000",
    ):
        linear_ik.load_element(tmp_path / "beam.yaml")
    with pytest.raises(ElementError, match="^profile_end: unknown section"):
        element_from_mapping({"name": "b", "length": 1, "profile": "RD 20", "profile_end": "nothing"})
