"""Element files: what they may say, and what they get told when they say it wrong."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from samples import SAMPLES

from linear_ik.element import Element, Placement, PlacementTolerance
from linear_ik.element_file import element_from_mapping, element_to_mapping, load_element
from linear_ik.errors import ElementError
from linear_ik.profile import Circle, Polygon, Rectangle

CONTRACT = """\
name: cantilever
profile: {type: rectangle, x_dim: 0.1, y_dim: 0.3}
length: 2.5
segments: 10
placement: {location: [0, 0, 0], axis: [0, 0, 1], ref_direction: [1, 0, 0]}   # axis = from start to end
start: fixed            # fixed | pinned | roller | free
end: free
joint_limit_deg: 45     # or a list [x, y, z]
placement_tolerance: {translation_m: 0.02, rotation_deg: 1}
end_tolerance_m: 0.003
density_kg_m3: 7850
"""


def load(folder: Path, content: str | bytes) -> Element:
    path = folder / "beam.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return load_element(path)


def message(folder: Path, content: str | bytes) -> str:
    with pytest.raises(ElementError) as caught:
        load(folder, content)
    line = str(caught.value)
    assert caught.value.subject == str(folder / "beam.yaml")
    assert line.startswith(f"{folder / 'beam.yaml'}: ") and "\n" not in line and len(line) < 500
    return line.removeprefix(f"{folder / 'beam.yaml'}: ")


def test_the_contracts_file(tmp_path: Path) -> None:
    assert load(tmp_path, CONTRACT) == Element(
        name="cantilever",
        profile=Rectangle(0.1, 0.3),
        length_m=2.5,
        segments=10,
        placement=Placement((0, 0, 0), (0, 0, 1), (1, 0, 0)),
        start="fixed",
        end="free",
        joint_limit_deg=45,
        placement_tolerance=PlacementTolerance(0.02, 1),
        end_tolerance_m=0.003,
        density_kg_m3=7850,
    )


def test_only_name_profile_and_length_are_needed(tmp_path: Path) -> None:
    element = load(tmp_path, "name: pipe\nprofile: {type: circle, radius: 0.1}\nlength: 3\n")
    assert element == Element("pipe", Circle(0.1), 3.0)


def test_json_is_read_too_even_with_tabs(tmp_path: Path) -> None:
    mapping = yaml.safe_load(CONTRACT)
    assert load(tmp_path, json.dumps(mapping, indent="\t")) == load(tmp_path, CONTRACT)
    assert load(tmp_path, "{name: a, profile: {type: circle, radius: 0.1}, length: 1e0}").length_m == 1.0


def test_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    assert load(tmp_path, "\ufeff" + CONTRACT.replace("\n", "\r\n")) == load(tmp_path, CONTRACT)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e1", 10.0), ("1E-1", 0.1), ("1e+1", 10.0), (".5", 0.5), ("5.", 5.0), ("+2.5e-01", 0.25), ("010", 10.0)],
)
def test_numbers_are_those_of_yaml_1_2_and_json(tmp_path: Path, text: str, value: float) -> None:
    assert load(tmp_path, CONTRACT.replace("length: 2.5", f"length: {text}")).length_m == value


@pytest.mark.parametrize("name", ["no", "on", "2024-01-01", "1:30", "1_000", "Träger 7/Ä", "a: b"])
def test_names_stay_text(tmp_path: Path, name: str) -> None:
    text = json.dumps(name) if ": " in name else name
    assert load(tmp_path, CONTRACT.replace("cantilever", text)).name == name


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        # keys
        ("length:", "lenght:", "lenght: unknown key (did you mean length?)"),
        ("length:", "Length:", "Length: unknown key (did you mean length?)"),
        ("length:", "span:", "span: unknown key (one of name, profile, length"),
        ("x_dim:", "xdim:", "profile.xdim: unknown key (did you mean x_dim?)"),
        ("axis: [0", "direction: [0", "placement.direction: unknown key (did you mean ref_direction?)"),
        ("rotation_deg:", "rotation:", "placement_tolerance.rotation: unknown key (did you mean rotation_deg?)"),
        ("end: free", "3: free", "3': unknown key"),
        ("end: free", "<<: {end: free}", "unknown key"),
        ("name: cantilever\n", "", "key name is missing (needed: name, profile, length)"),
        ("length: 2.5\n", "", "key length is missing"),
        ("profile: {type: rectangle, x_dim: 0.1, y_dim: 0.3}\n", "", "key profile is missing"),
        ("type: rectangle, ", "", "profile: key type is missing (one of rectangle,"),
        (", y_dim: 0.3", "", "profile: key y_dim is missing (needed: x_dim, y_dim)"),
        ("end: free", "start: free", "line 7, column 1: key start is there twice"),
        ("x_dim: 0.1,", "x_dim: 0.1, x_dim: 0.2,", "key x_dim is there twice"),
        ("end: free", "? [1]\n: free", "a key that is no text"),
        # profiles
        ("rectangle", "rectangel", "profile.type: unknown profile rectangel (did you mean rectangle?)"),
        ("rectangle", "RectangleHollow", "(did you mean rectangle_hollow?)"),
        ("rectangle", "pentagram", "profile.type: unknown profile pentagram (one of rectangle, rectangle_hollow,"),
        ("rectangle", "7", "profile.type: unknown profile 7 (one of"),
        ("rectangle", "rectangle_hollow", "profile: key wall_thickness is missing"),
        ("{type: rectangle, x_dim: 0.1, y_dim: 0.3}", "rectangle", "profile: 'rectangle' is not a set of keys"),
        ("y_dim: 0.3", "y_dim: -0.3", "profile.y_dim: -0.3 (metres"),
        ("y_dim: 0.3", "y_dim: .nan", "profile.y_dim: nan (metres"),
        ("y_dim: 0.3", "y_dim: 300", "profile.y_dim: 300 (metres"),
        ("y_dim: 0.3", "y_dim: 30 cm", "profile.y_dim: '30 cm' is not a number"),
        (
            "{type: rectangle, x_dim: 0.1, y_dim: 0.3}",
            "{type: circle_hollow, radius: 0.1, wall_thickness: 0.2}",
            "profile.wall_thickness: 0.2 (less than the radius, 0.1)",
        ),
        (
            "{type: rectangle, x_dim: 0.1, y_dim: 0.3}",
            "{type: polygon, outline: [[0, 0], [1, 1], [0, 1], [1, 0]]}",
            "profile.outline: Self-intersection",
        ),
        (
            "{type: rectangle, x_dim: 0.1, y_dim: 0.3}",
            "{type: polygon, outline: [[0, 0], ['1', 1], [0, 1]]}",
            "profile.outline[1]: '1' is not a number",
        ),
        ("{type: rectangle, x_dim: 0.1, y_dim: 0.3}", "{type: polygon}", "profile: key outline is missing"),
        (
            "{type: rectangle, x_dim: 0.1, y_dim: 0.3}",
            "{type: polygon, outline: [[0, 0], [1, 0], [0, 1]], radius: 3}",
            "profile.radius: unknown key",
        ),
        # numbers
        ("2.5", "-1", "length: -1 (a number above 0"),
        ("2.5", "0", "length: 0 (a number above 0"),
        ("2.5", ".inf", "length: inf"),
        ("2.5", "-.Inf", "length: -inf"),
        ("2.5", ".NaN", "length: nan"),
        ("2.5", "1e999", "length: inf"),
        ("2.5", "", "length: has no value (a number)"),
        ("2.5", "'2.5'", "length: '2.5' is not a number (a number without quotes)"),
        ("2.5", "2,5", "length: '2,5' is not a number"),
        ("2.5", "2:30", "length: '2:30' is not a number"),
        ("2.5", "true", "length: True is not a number"),
        ("2.5", "[2.5]", "length: [2.5] is not a number"),
        ("2.5", "{m: 2.5}", "length: {'m': 2.5} is not a number"),
        ("2.5", "9" * 400, "a number of 400 digits"),
        ("2.5", "9" * 5000, "a number of 5000 digits"),
        ("2.5", "x" * 5000, "length: 'xxx"),
        ("segments: 10", "segments: 100000000", "segments: 100000000 (1 to 500)"),
        ("segments: 10", "segments: 1e8", "segments: 100000000 (1 to 500)"),
        ("segments: 10", "segments: 0", "segments: 0 (1 to 500)"),
        ("segments: 10", "segments: 2.5", "segments: 2.5 (a whole number"),
        ("segments: 10", "segments: ten", "segments: 'ten' is not a number"),
        ("segments: 10", "segments: .nan", "segments: nan"),
        ("deg: 45", "deg: 0", "joint_limit_deg: 0 (a number above 0 and up to 180)"),
        ("deg: 45", "deg: [45, 45]", "joint_limit_deg: [45, 45] is not a list of three (one number, or three"),
        ("deg: 45", "deg: [45, 45, a]", "joint_limit_deg: 'a' is not a number"),
        ("deg: 45", "deg: {x: 45}", "joint_limit_deg: {'x': 45} is not a number"),
        ("end_tolerance_m: 0.003", "end_tolerance_m: -0.003", "end_tolerance_m: -0.003"),
        ("density_kg_m3: 7850", "density_kg_m3: steel", "density_kg_m3: 'steel' is not a number"),
        ("translation_m: 0.02", "translation_m: -1", "placement_tolerance.translation_m: -1"),
        # placement
        ("axis: [0, 0, 1]", "axis: [0, 0, 0]", "placement.axis: [0.0, 0.0, 0.0] has no length"),
        ("[1, 0, 0]", "[0, 0, -2]", "placement.ref_direction: [0.0, 0.0, -2.0] is parallel to axis"),
        ("[1, 0, 0]", "[1, 0]", "placement.ref_direction: [1, 0] is not a list of three (three numbers [x, y, z])"),
        ("[1, 0, 0]", "x", "placement.ref_direction: 'x' is not a list of three"),
        ("[1, 0, 0]", "[1, 0, null]", "placement.ref_direction: has no value"),
        ("location: [0, 0, 0]", "location: [0, 0, .nan]", "placement.location: nan"),
        ("location: [0, 0, 0]", "location: [0, 0, 1e300]", "placement.location: 1e+300"),
        # texts
        ("cantilever", "12", 'name: 12 is not text (text; put it in quotes: "12")'),
        ("cantilever", "", "name: has no value (text)"),
        ("cantilever", "' '", "name: ' ' (a name of at least one character)"),
        ("cantilever", "[a]", "name: ['a'] is not text"),
        ("start: fixed", "start: fxed", "start: 'fxed' (one of fixed, pinned, roller, free)"),
        ("end: free", "end: 3", "end: 3 is not text"),
        ("end: free", "end: false", "end: False is not text"),
        # YAML's dangers
        ("cantilever", "!!python/object/apply:os.system [echo]", "python/object/apply:os.system is not used"),
        ("cantilever", "!!python/name:os.system ''", "python/name:os.system is not used"),
        ("cantilever", "!!binary aGVsbG8=", "tag tag:yaml.org,2002:binary is not used"),
        ("cantilever", "*a", "alias *a is not used"),
        ("deg: 45", "deg: " + "[" * 10_000 + "]" * 10_000, "nested too deeply"),
        ("deg: 45", "deg: [45, 45", "line "),
        ("deg: 45", "deg: 45\n  end: free", "line "),
        ("start: fixed", "\tstart: fixed", "line 6, column 1: "),
        ("start: fixed", "--- \nstart: fixed", "found another document"),
    ],
)
def test_a_wrong_file_is_told_what_is_wrong(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert CONTRACT.count(old) >= 1
    assert said in message(tmp_path, CONTRACT.replace(old, new, 1))


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefghi", "bcdefghij", strict=True)
)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "is empty"),
        (" \n\n", "is empty"),
        ("# only a comment\n", "None is not a set of keys"),
        ("42", "42 is not a set of keys"),
        ("- a\n- b\n", "['a', 'b'] is not a set of keys"),
        ("solid steel", "'solid steel' is not a set of keys"),
        (b"\x00\x01\x02\x03", "is not YAML"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "is not text: byte 0 is not UTF-8"),
        (CONTRACT.encode("utf-16"), "is not text: byte 0 is not UTF-8"),
        (CONTRACT.replace("cantilever", "Träger").encode("latin-1"), "is not text: byte 8 is not UTF-8"),
        (CONTRACT + "# " + "x" * 300_000, "is larger than 256 kB"),
        (BOMB, "alias *a is not used"),
        ('{"a":' * 40_000, "is nested too deeply"),
        ('{"name": "a", "name": "b"}', "key name is there twice"),
        ('{"name": "a", "length": NaN, "profile": {"type": "circle", "radius": 1}}', "length: nan"),
        ('{"name": "a", "length": ' + "9" * 5000 + "}", "a number of 5000 digits"),
        ('{"name": "a",', "line 1"),
        ("{" * 200_000, "nested too deeply"),
        ("[" * 200_000, "nested too deeply"),
        ("- " * 100_000, "nested too deeply"),
    ],
    ids=lambda v: repr(v[:20]),
)
def test_what_is_no_element_file_is_refused(tmp_path: Path, content: str | bytes, said: str) -> None:
    assert said in message(tmp_path, content)


@pytest.mark.parametrize(
    ("path", "said"), [("", "is a folder"), ("nothing.yaml", "no such file"), ("a\0b", "cannot be read")]
)
def test_what_is_no_file_is_refused(tmp_path: Path, path: str, said: str) -> None:
    with pytest.raises(ElementError, match=said):
        load_element(tmp_path / path)


def test_an_endless_file_is_refused() -> None:
    if not os.path.exists("/dev/zero"):
        pytest.skip("this system has no /dev/zero")
    with pytest.raises(ElementError, match="larger than"):
        load_element("/dev/zero")


@pytest.mark.parametrize("mapping", [None, [], "name", {1: 2}, {None: 1}, {"name": "a"}, {("a",): 1}])
def test_mappings_are_checked_as_files_are(mapping: object) -> None:
    with pytest.raises(ElementError):
        element_from_mapping(mapping)  # type: ignore[arg-type]


def test_an_error_names_the_key_of_the_file_not_the_field() -> None:
    with pytest.raises(ElementError) as caught:
        element_from_mapping({"name": "a", "profile": {"type": "circle", "radius": 0.1}, "length": -2})
    assert caught.value.subject == "length" and caught.value.what == "-2"


def test_pyyaml_itself_is_left_as_it_was(tmp_path: Path) -> None:
    load(tmp_path, CONTRACT)
    assert yaml.safe_load("a: on\nb: 1e-3\nc: 010\nd: &x 1\ne: *x\n") == {
        "a": True,
        "b": "1e-3",
        "c": 8,
        "d": 1,
        "e": 1,
    }


@pytest.mark.parametrize("profile", SAMPLES.values(), ids=SAMPLES.keys())
def test_every_profile_comes_back(tmp_path: Path, profile: object) -> None:
    element = Element("a", profile, 3.0)  # type: ignore[arg-type]
    assert load(tmp_path, yaml.safe_dump(element_to_mapping(element))) == element
    assert load(tmp_path, json.dumps(element_to_mapping(element))) == element


vector = st.tuples(*[st.floats(-1e6, 1e6)] * 3)
text = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1, max_size=200).filter(
    str.strip
)
dimension = st.floats(1e-4, 50)
profiles = st.one_of(
    st.builds(Rectangle, dimension, dimension),
    st.builds(Circle, dimension),
    st.builds(
        lambda s, x, y: Polygon([[x, y], [x + s, y], [x, y + s]]),
        st.floats(0.01, 50),
        st.floats(-9, 9),
        st.floats(-9, 9),
    ),
)
elements = st.builds(
    Element,
    name=text,
    profile=profiles,
    length_m=st.floats(0.1, 1e5),
    segments=st.integers(1, 500),
    placement=st.builds(
        Placement,
        vector,
        st.sampled_from([(0.0, 0.0, 1.0), (0.1, -3.0, 1e-5)]),
        st.sampled_from([None, (1.0, 0.0, 0.0), (1e-3, 2.0, 2.0)]),
    ),
    start=st.sampled_from(["fixed", "pinned", "roller", "free"]),
    end=st.sampled_from(["free", "roller", "pinned", "fixed"]),
    joint_limit_deg=st.one_of(st.floats(1e-9, 180), st.tuples(*[st.floats(1e-9, 180)] * 3)),
    placement_tolerance=st.builds(PlacementTolerance, st.floats(0, 10), st.floats(0, 180)),
    end_tolerance_m=st.floats(1e-9, 1),
    density_kg_m3=st.floats(1e-3, 1e5),
)


@given(element=elements)
def test_round_trip(element: Element, tmp_path_factory: pytest.TempPathFactory) -> None:
    mapping = element_to_mapping(element)
    assert element_from_mapping(mapping) == element
    folder = tmp_path_factory.getbasetemp()
    assert load(folder, yaml.safe_dump(mapping, allow_unicode=True)) == element
    assert load(folder, json.dumps(mapping)) == element


@given(content=st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_any_content_is_an_element_or_an_element_error(
    content: bytes | str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    with pytest.raises(ElementError):
        load(tmp_path_factory.getbasetemp(), data)


junk = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=8,
)


@given(key=st.sampled_from(sorted(yaml.safe_load(CONTRACT))), value=junk)
def test_any_value_of_a_key_is_taken_or_refused_by_name(key: str, value: object) -> None:
    mapping = {**yaml.safe_load(CONTRACT), key: value}
    try:
        element_from_mapping(mapping)
    except ElementError as error:
        assert error.subject.startswith(key)
