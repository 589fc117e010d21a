"""Bad input, through the command and through Python: exit 2, one line that names the file, nothing written."""

import hashlib
import math
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import linear_ik
from linear_ik.cli import main

GOOD = """\
name: beam
profile: {type: rectangle, x_dim: 0.1, y_dim: 0.3}
length: 2.5
segments: 10
placement: {location: [0, 0, 0], axis: [0, 0, 1], ref_direction: [1, 0, 0]}
"""
SLOWEST_S = 10.0


def edited(old, new):
    assert old in GOOD
    return GOOD.replace(old, new).encode()


RECTANGLE = "{type: rectangle, x_dim: 0.1, y_dim: 0.3}"
ELEMENTS = {
    "empty": (b"", "empty"),
    "blank": (b"\n  \n# nothing\n", ""),
    "binary": (os.urandom(3000), ""),
    "nulls": (b"\0" * 500, ""),
    "truncated": (GOOD[:70].encode(), ""),
    "list": (b"[1, 2, 3]", ""),
    "text": (b"a beam of 2.5 m", ""),
    "number": (b"42", ""),
    "deep": (b"[" * 50_000, ""),
    "bomb": (b"a: &a [x,x,x,x,x,x,x,x,x]\n" + b"".join(
        b"%c: &%c [*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c,*%c]\n" % (c + 1, c + 1, *[c] * 9) for c in range(97, 106)), ""),
    "large": (GOOD.encode() + b"# " + b"x" * 10_000_000, "larger"),
    "python tag": (b"name: !!python/object/apply:os.system ['touch hacked']\n", "tag"),
    "object tag": (b"!!python/object:linear_ik.element.Element {}\n", "tag"),
    "binary tag": (edited("name: beam", "name: !!binary aGVsbG8="), "tag"),
    "key twice": (edited("length: 2.5", "length: 2.5\nlength: 3.5"), "twice"),
    "no length": (edited("length: 2.5\n", ""), "length"),
    "no profile": (edited(f"profile: {RECTANGLE}\n", ""), "profile"),
    "unknown key": (edited("segments: 10", "segmnets: 10"), "did you mean segments"),
    "unknown profile": (edited("rectangle,", "rectangel,"), "did you mean rectangle"),
    "unknown dimension": (edited("x_dim", "xdim"), "did you mean x_dim"),
    "unknown placement key": (edited("axis:", "axes:"), "did you mean axis"),
    "unknown start": (GOOD.encode() + b"start: fixd\n", "fixed"),
    "unknown end": (GOOD.encode() + b"end: 3\n", "end"),
    "length as text": (edited("length: 2.5", "length: long"), "length"),
    "length quoted": (edited("length: 2.5", "length: '2.5'"), "without quotes"),
    "length with a unit": (edited("length: 2.5", "length: 2.5 m"), "length"),
    "length negative": (edited("length: 2.5", "length: -2.5"), "length"),
    "length zero": (edited("length: 2.5", "length: 0"), "length"),
    "length nan": (edited("length: 2.5", "length: .nan"), "length"),
    "length infinite": (edited("length: 2.5", "length: .inf"), "length"),
    "length in light years": (edited("length: 2.5", "length: 1e300"), "length"),
    "length true": (edited("length: 2.5", "length: true"), "length"),
    "length null": (edited("length: 2.5", "length:"), "length"),
    "segments 10^8": (edited("segments: 10", "segments: 100000000"), "1 to 500"),
    "segments of 5000 digits": (edited("segments: 10", "segments: " + "9" * 5000), ""),
    "segments zero": (edited("segments: 10", "segments: 0"), "1 to 500"),
    "segments negative": (edited("segments: 10", "segments: -3"), "1 to 500"),
    "segments half": (edited("segments: 10", "segments: 2.5"), "whole number"),
    "axis zero": (edited("axis: [0, 0, 1]", "axis: [0, 0, 0]"), "axis"),
    "axis parallel": (edited("ref_direction: [1, 0, 0]", "ref_direction: [0, 0, -2]"), "parallel"),
    "axis of two": (edited("axis: [0, 0, 1]", "axis: [0, 1]"), "axis"),
    "axis nan": (edited("axis: [0, 0, 1]", "axis: [0, 0, .nan]"), "axis"),
    "location far": (edited("location: [0, 0, 0]", "location: [1e30, 0, 0]"), "location"),
    "location as text": (edited("location: [0, 0, 0]", "location: origin"), "location"),
    "side negative": (edited("x_dim: 0.1", "x_dim: -0.1"), "x_dim"),
    "side in millimetres": (edited("y_dim: 0.3", "y_dim: 300"), "y_dim"),
    "limit zero": (GOOD.encode() + b"joint_limit_deg: 0\n", "joint_limit_deg"),
    "limit beyond": (GOOD.encode() + b"joint_limit_deg: 181\n", "joint_limit_deg"),
    "limit of two": (GOOD.encode() + b"joint_limit_deg: [10, 10]\n", "joint_limit_deg"),
    "box filled": (edited(RECTANGLE, "{type: rectangle_hollow, x_dim: 0.1, y_dim: 0.3, wall_thickness: 0.05}"), "wall"),
    "pipe filled": (edited(RECTANGLE, "{type: circle_hollow, radius: 0.05, wall_thickness: 0.06}"), "wall_thickness"),
    "web too thick": (
        edited(RECTANGLE, "{type: i_shape, overall_width: 0.1, overall_depth: 0.2, web_thickness: 0.2, "
                          "flange_thickness: 0.01}"), "web_thickness"),
    "flange too thick": (
        edited(RECTANGLE, "{type: u_shape, depth: 0.2, flange_width: 0.1, web_thickness: 0.01, flange_thickness: 0.1}"),
        "flange_thickness"),
    "polygon crossing": (edited(RECTANGLE, "{type: polygon, outline: [[0, 0], [1, 1], [1, 0], [0, 1]]}"), "outline"),
    "polygon flat": (edited(RECTANGLE, "{type: polygon, outline: [[0, 0], [1, 0], [2, 0]]}"), "outline"),
    "profile as text": (edited(RECTANGLE, "rectangle"), "profile"),
}  # fmt: skip

PLY = "ply\nformat {} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
NAN = struct.pack("<3d", math.nan, math.nan, math.nan)
POINT = struct.pack("<3d", 0.05, 0.1, 1.0)
BINARY = "binary_little_endian"
SCANS = {
    "empty.ply": (b"", "empty"),
    "header_only.ply": (PLY.format(BINARY, 0).encode(), ""),
    "short.ply": (PLY.format(BINARY, 1000).encode() + POINT * 10, ""),
    "lies.ply": (PLY.format(BINARY, 10**12).encode() + POINT * 10, ""),
    "negative.ply": (PLY.format(BINARY, -5).encode() + POINT * 10, ""),
    "no_number.ply": (PLY.format(BINARY, "many").encode() + POINT * 10, ""),
    "short_text.ply": (PLY.format("ascii", 3).encode() + b"0 0 0\n0 0 1\n", ""),
    "words.ply": (PLY.format("ascii", 2).encode() + b"0 0 0\nzero zero one\n", ""),
    "endless_header.ply": (b"ply\nformat ascii 1.0\n" + b"comment x\n" * 1000, ""),
    "nan.ply": (PLY.format(BINARY, 200).encode() + NAN * 200, "no point with finite"),
    "random.ply": (os.urandom(5000), ""),
    "nan.xyz": (b"nan nan nan\n" * 50, "no point with finite"),
    "words.xyz": (b"these are\nno points\n", ""),
    "empty.xyz": (b"", "empty"),
    "random.pcd": (os.urandom(5000), ""),
    "random.las": (b"LASF" + os.urandom(5000), ""),
    "random.e57": (b"ASTM-E57" + os.urandom(5000), ""),
    "scan.plyy": (PLY.format(BINARY, 1).encode() + POINT, ".ply"),
    "scan": (b"0 0 0\n", "extension"),
    "beam.ifc": (b"ISO-10303-21;\nHEADER;\n", ""),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with good files and an older result that must survive."""
    monkeypatch.chdir(tmp_path)
    Path("good.yaml").write_text(GOOD)
    random = np.random.default_rng(0)
    linear_ik.write_scan(linear_ik.Scan(random.uniform([-0.05, 0.15, 0], [0.05, 0.15, 2.5], (300, 3))), "good.ply")
    Path("old.out").write_text("an older result")
    return tmp_path


def contents(folder):
    return {str(p.relative_to(folder)): p.is_file() and hashlib.sha256(p.read_bytes()).digest()
            for p in sorted(folder.rglob("*"))}  # fmt: skip


def refused(here, capfd, arguments, named, said=""):
    """Run the command and check everything that the contract says of bad input."""
    before, start = contents(here), time.perf_counter()
    code = main([str(a) for a in arguments])
    out, err = capfd.readouterr()
    assert code == 2, err
    assert err.startswith(f"error: {named}: ") and err.endswith(")\n") and "(" in err
    assert err.count("\n") == 1 and len(err) < 500 and "Traceback" not in err
    assert said in err and not out
    assert contents(here) == before
    assert time.perf_counter() - start < SLOWEST_S
    return err


@pytest.mark.parametrize("case", ELEMENTS)
def test_elements(case, here, capfd):
    content, said = ELEMENTS[case]
    Path("bad.yaml").write_bytes(content)
    for arguments in (
        ["fit", "bad.yaml", "good.ply", "-o", "old.out"],
        ["urdf", "bad.yaml", "-o", "new/beam.urdf"],
        ["simulate", "bad.yaml", "-o", "new/scan.ply"],
        ["view", "bad.yaml", "good.ply", "--html", "old.out"],
    ):
        refused(here, capfd, arguments, "bad.yaml", said)
    with pytest.raises(linear_ik.LinearIkError) as caught:
        linear_ik.load_element("bad.yaml")
    assert caught.value.subject == "bad.yaml" and said in str(caught.value)


@pytest.mark.parametrize("name", SCANS)
def test_scans(name, here, capfd):
    content, said = SCANS[name]
    Path(name).write_bytes(content)
    for arguments in (
        ["fit", "good.yaml", name, "-o", "old.out"],
        ["fit", "good.yaml", "good.ply", name, "-o", "new/result.json", "--glb", "new/beam.glb"],
        ["view", name, "--html", "old.out"],
    ):
        refused(here, capfd, arguments, name, said)
    with pytest.raises(linear_ik.LinearIkError) as caught:
        linear_ik.read_scan(name)
    assert caught.value.subject == name and said in str(caught.value)


@pytest.mark.parametrize("name", ["absent.yaml", "folder", "folder/", "good.ply/below.yaml", "n" * 300, "/dev/zero"])
def test_what_is_no_element_file(name, here, capfd):
    Path("folder").mkdir()
    refused(here, capfd, ["fit", name, "good.ply", "-o", "old.out"], str(Path(name)))
    refused(here, capfd, ["urdf", name, "-o", "new/beam.urdf"], str(Path(name)))


@pytest.mark.parametrize("name", ["absent.ply", "folder.ply", "good.yaml/below.ply", "n" * 300 + ".ply", "/dev/zero"])
def test_what_is_no_scan_file(name, here, capfd):
    Path("folder.ply").mkdir()
    refused(here, capfd, ["fit", "good.yaml", name, "-o", "old.out"], name)
    refused(here, capfd, ["view", "good.yaml", name, "--html", "new/page.html"], name)


def test_a_scan_in_the_designs_place(here, capfd):
    for swapped in (["fit", "good.ply", "hall.ifc", "-o", "old.out"], ["align", "good.ply", "hall.ifc", "-o", "T.txt"]):
        refused(here, capfd, swapped, "good.ply", "is a scan; the design comes first (the design, then its scans)")


def test_a_folder_or_a_text_in_a_scans_place(here, capfd):
    Path("scans").mkdir()
    Path("text.e57").write_text("no scan")
    refused(here, capfd, ["fit", "good.yaml", "scans", "-o", "old.out"], "scans", "is a folder (a scan file: .asc, ")
    said = refused(here, capfd, ["fit", "good.yaml", "text.e57", "-o", "old.out"], "text.e57", "is no E57 file")
    assert "begin with ASTM-E57" in said


def test_a_pipe_that_nobody_writes_to(here, capfd):
    os.mkfifo("pipe.ply")
    before = sorted(os.listdir())
    assert main(["fit", "good.yaml", "pipe.ply", "-o", "old.out"]) == 2
    assert capfd.readouterr().err.startswith("error: pipe.ply: ") and sorted(os.listdir()) == before


def test_a_name_that_was_nearly_right(here, capfd):
    assert "good.ply?" in refused(here, capfd, ["fit", "good.yaml", "god.ply", "-o", "old.out"], "god.ply")


@pytest.mark.parametrize("content", [b"", b"{", b'{"schema": "linear_ik/result/9"}', b'{"schema": 1, "status": []}'])
def test_results(content, here, capfd):
    Path("bad.json").write_bytes(b'"schema"' + content if not content else content)
    refused(here, capfd, ["view", "bad.json", "--html", "old.out"], "bad.json")


@pytest.mark.parametrize(
    "arguments, named, said",
    [
        (["--range-noise", "0"], "--range-noise", "1e-06"),
        (["--range-noise", "nan"], "--range-noise", "nan"),
        (["--max-iterations", "0"], "--max-iterations", "1"),
        (["--max-iterations", "100000000"], "--max-iterations", ""),
        (["--search", "allways"], "--search", "always"),
        (["--solver", "osqpp"], "--solver", "osqp"),
    ],
)
def test_settings_of_a_fit(arguments, named, said, here, capfd):
    refused(here, capfd, ["fit", "good.yaml", "good.ply", "-o", "old.out", *arguments], named, said)


@pytest.mark.parametrize(
    "arguments, named, said",
    [
        (["--bend", "8:y"], "--bend", "segment:axis:degrees"),
        (["--bend", "11:y:5"], "--bend", "1 to 10"),
        (["--bend", "0:y:5"], "--bend", ""),
        (["--bend", "3:w:5"], "--bend", ""),
        (["--bend", "3:y:nan"], "--bend", ""),
        (["--bend", "3:y:50"], "--bend", "45"),
        (["--points", "0"], "--points", "1"),
        (["--points", "100000000000"], "--points", ""),
        (["--noise", "-0.001"], "--noise", "0"),
        (["--noise", "inf"], "--noise", ""),
        (["--seed", "-1"], "--seed", "0"),
        (["--missing", "+z"], "--missing", "+x"),
        (["--missing", "+x", "--missing", "-x", "--missing", "+y", "--missing", "-y"], "--missing", "face"),
    ],
)
def test_settings_of_a_simulation(arguments, named, said, here, capfd):
    command = ["simulate", "good.yaml", "-o", "new.ply", "--truth", "new.json", *arguments]
    refused(here, capfd, command, named, said)


@pytest.mark.parametrize("name", ["scan.e57", "scan.las", "scan", "scan.json"])
def test_scan_formats_that_are_not_written(name, here, capfd):
    refused(here, capfd, ["simulate", "good.yaml", "-o", name], name, ".ply")


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: linear_ik.Rectangle(0.1, -0.3), "y_dim"),
        (lambda: linear_ik.Rectangle(0.1, math.nan), "y_dim"),
        (lambda: linear_ik.Rectangle("0.1", 0.3), "x_dim"),
        (lambda: linear_ik.CircleHollow(0.05, 0.06), "wall_thickness"),
        (lambda: linear_ik.Polygon([[0, 0], [1, 1]]), "outline"),
        (lambda: linear_ik.Placement(axis=(0, 0, 0)), "placement.axis"),
        (lambda: linear_ik.Placement(axis=(0, 0, 1), ref_direction=(0, 0, 1)), "parallel"),
        (lambda: linear_ik.Element("b", linear_ik.Circle(0.1), 2.5, segments=10**8), "segments"),
        (lambda: linear_ik.Element("b", "circle", 2.5), "profile"),
        (lambda: linear_ik.Element("b", linear_ik.Circle(0.1), math.inf), "length"),
        (lambda: linear_ik.Scan(np.full((5, 3), np.nan)), "no point"),
        (lambda: linear_ik.Scan(np.zeros((0, 3))), "no point"),
        (lambda: linear_ik.Scan(np.zeros((5, 2))), "points"),
        (lambda: linear_ik.Scan([["a", "b", "c"]]), "points"),
        (lambda: linear_ik.FitSettings(max_step_rad=0), "max_step_rad"),
        (lambda: linear_ik.FitSettings(search="sometimes"), "auto"),
        (lambda: linear_ik.element_from_mapping({"name": "b"}), "missing"),
        (lambda: linear_ik.element_from_mapping([1]), "element"),
        (lambda: linear_ik.read_scan(), "no files"),
        (lambda: linear_ik.read_result("absent.json"), "absent.json"),
    ],
)
def test_python_says_the_same(make, said):
    with pytest.raises(linear_ik.LinearIkError) as caught:
        make()
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "element, scan, named",
    [
        (ELEMENTS["binary"][0], None, "bad.yaml"),
        (ELEMENTS["python tag"][0], None, "bad.yaml"),
        (ELEMENTS["segments 10^8"][0], None, "bad.yaml"),
        (None, SCANS["lies.ply"][0], "bad.ply"),
        (None, SCANS["nan.ply"][0], "bad.ply"),
        (None, SCANS["random.ply"][0], "bad.ply"),
        (None, None, "bad.ply"),
    ],
)
def test_the_real_process(element, scan, named, here):
    Path("bad.yaml").write_bytes(GOOD.encode() if element is None else element)
    if scan is not None:
        Path("bad.ply").write_bytes(scan)
    elif element is None:
        Path("bad.ply").mkdir()
    before = contents(here)
    scan_name = "bad.ply" if named == "bad.ply" else "good.ply"
    command = [sys.executable, "-m", "linear_ik", "fit", "bad.yaml", scan_name, "-o", "old.out", "--urdf", "new/b.urdf"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: {named}: ") and done.stderr.count("\n") == 1
    assert contents(here) == before
