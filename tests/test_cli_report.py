"""`linear-ik report`, `linear-ik tolerances`, and the verdicts of `fit --tolerances`."""

import json

import pytest
from command import fit_to, folder, here

from linear_ik.cli import main
from linear_ik.readers.result_json import read_result
from linear_ik.tolerances import shipped

__all__ = ["folder", "here"]


def test_report_of_a_result_with_its_scan(folder, here, capfd):
    command = ["report", f"{folder}/result.json", "--scan", f"{folder}/scan.ply", "--tolerances", "nsss"]
    assert main([*command, "--loading-state", "unloaded", "-o", "new/r.html"]) == 0
    out, err = capfd.readouterr()
    assert not out and "1: 1 fail" in err and "new/r.html" in err
    page = (here / "new/r.html").read_text()
    assert "7.2.4" in page and "scan points within 50 mm" in page and "unloaded" in page
    assert main(["report", f"{folder}/result.json", "-q", "-o", "new/r.html"]) == 0
    assert capfd.readouterr() == ("", "")
    assert "the scan was not given" in (here / "new/r.html").read_text()


@pytest.mark.parametrize(
    "options, says",
    [
        (["--tolerances", "nss"], "nss: no tolerances of that name"),
        (["--tolerances", "none.yaml"], "none.yaml: cannot be read"),
        (["--tolerances", "nsss", "--loading-state", "wet"], "--loading-state: 'wet'"),
        (["--tolerances", "nsss", "--precamber", "30"], "--precamber: 30"),
        (["--loading-state", "unloaded"], "--loading-state: given without --tolerances"),
        (["--precamber", "0.01"], "--precamber: given without --tolerances"),
    ],
)
@pytest.mark.parametrize("verb", ["report", "fit"])
def test_bad_options_are_one_line(folder, here, capsys, verb, options, says):
    first = [f"{folder}/result.json"] if verb == "report" else [f"{folder}/beam.yaml", f"{folder}/scan.ply"]
    assert main([verb, *first, *options, "-o", "out.x"]) == 2
    out, err = capsys.readouterr()
    assert not out and err.startswith("error: ") and says in err and err.count("\n") == 1
    assert not list(here.iterdir())


def test_report_is_not_written_over_what_it_reads(folder, capsys):
    before = (folder / "result.json").read_bytes()
    assert main(["report", f"{folder}/result.json", "-o", f"{folder}/result.json"]) == 2
    assert "is one of the files that are read" in capsys.readouterr().err
    assert (folder / "result.json").read_bytes() == before
    for wrong in ("none.json", "scan.ply", ""):
        assert main(["report", f"{folder}/{wrong}", "-o", f"{folder}/r.html"]) == 2
    assert main(["report", f"{folder}/result.json", "--scan", "none.ply", "-o", f"{folder}/r.html"]) == 2
    assert "none.ply" in capsys.readouterr().err.splitlines()[-1]
    assert not (folder / "r.html").exists()


def test_no_part_of_a_run_is_written_over(folder, here, capsys):
    run = here / "run"
    (run / "elements").mkdir(parents=True)
    (run / "elements" / "a.json").write_bytes((folder / "result.json").read_bytes())
    (run / "run.json").write_text("{}")
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    names = (
        "run.json",
        "elements.csv",
        "asbuilt.ifc",
        "RUN.json",
        "deviation.e57",
        "elements/b.html",
        "elements/a.json",
    )
    for name in names:
        assert main(["report", "run", "-o", f"run/{name}"]) == 2
        assert "belongs to the results in run" in capsys.readouterr().err
    for name in ("run/elements.csv", "run/run.json"):
        assert main(["compare", "run", "run", "-o", name]) == 2
        assert "belongs to the results in run" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    assert main(["report", "run", "-q", "-o", "run/report.html"]) == 0
    assert main(["compare", "run", "run", "-q", "-o", "run/moved.csv"]) == 0
    (here / "flat").mkdir()
    (here / "flat" / "a.json").write_bytes((folder / "result.json").read_bytes())
    assert main(["report", "flat", "-o", "flat/a.json"]) == 2


def test_a_section_beside_the_element_is_one_line(folder, here, capsys):
    assert main(["report", f"{folder}/result.json", "-o", "r.html", "--section", "99"]) == 2
    out, err = capsys.readouterr()
    assert not out and "--section: 99 (0 to " in err and not (here / "r.html").exists()


def test_fit_judges(folder, here, capfd):
    options = ["--tolerances", "nsss", "--loading-state", "unloaded", "--precamber", "0"]
    assert fit_to(folder, "r.json", *options) == 0
    out, err = capfd.readouterr()
    assert not out and "7.2.4" in err
    (line,) = [line for line in err.splitlines() if line.startswith("verdict")]
    assert line.startswith("verdict    fail: ") and "is outside 3.00 mm" in line
    (verdict,) = json.loads((here / "r.json").read_text())["verdicts"]
    assert verdict["outcome"] == "fail" and verdict["clause"] == "7.2.4" and verdict["value"] - verdict["band"] > 0.003
    assert (verdict["loading_state"], verdict["precamber_m"], verdict["verified_by"] is None) == (
        "unloaded",
        0.0,
        False,
    )
    assert read_result(here / "r.json").status == "converged"
    assert fit_to(folder, "-", *options, "-q") == 0
    assert json.loads(capfd.readouterr().out)["verdicts"][0]["outcome"] == "fail"
    assert fit_to(folder, "plain.json") == 0
    assert "verdicts" not in json.loads((here / "plain.json").read_text())


def test_own_weight_is_stated_by_options(folder, here, capsys):
    """Of fit and report alike; what is wrong is named by its option, what is missing in the verdict."""
    base = ["report", f"{folder}/result.json", "-o", "r.html", "--tolerances", "nsss", "--loading-state", "self_weight"]
    for options, said in (
        (["--supports", "hinged"], "--supports: 'hinged' (one of simple, clamped"),
        (["--material", "11"], "--material: '11' (one of steel, or E in GPa and kg/m3"),
        (["--material", "-11,420"], "--material: '-11,420'"),
    ):
        assert main([*base, *options]) == 2 and said in capsys.readouterr().err
        assert not (here / "r.html").exists()
    for option in ("--supports=simple", "--material=steel"):
        assert main(["report", f"{folder}/result.json", "-o", "r.html", option]) == 2
        assert f"{option.split('=')[0]}: given without --tolerances" in capsys.readouterr().err
    assert main([*base, "--supports", "simple", "--material", "11,420"]) == 0
    assert "simply supported, E 11 GPa, 420 kg/m3" in (here / "r.html").read_text()


def test_fit_says_where_no_clause_applies(folder, here, capfd):
    assert fit_to(folder, "r.json", "--tolerances", "iso13920e", "--loading-state", "loaded") == 0
    assert "inconclusive" in capfd.readouterr().err
    (here / "own.yaml").write_text(
        "title: t\nedition: e\nclauses:\n"
        "  - {clause: c, title: t, figure: sag, applies_to: not_vertical, limit: 1 mm, verified_by: me}\n"
    )
    assert fit_to(folder, "r.json", "--tolerances", "own.yaml") == 0
    assert "no clause of own applies" in capfd.readouterr().err


def test_report_with_conditions_of_each(folder, here, capsys):
    (here / "c.yaml").write_text("elements: {beam: {loading_state: unloaded}}")
    command = ["report", f"{folder}/result.json", "--conditions", "c.yaml", "-o", "r.html", "--section", "1.1"]
    assert main([*command, "--tolerances", "nsss"]) == 0
    assert "1 fail" in capsys.readouterr().err and "section at 1.10 m" in (here / "r.html").read_text()
    (here / "r.html").unlink()
    assert main(command) == 2
    (here / "c.yaml").write_text("elements: {column: {}}")
    assert main([*command, "--tolerances", "nsss"]) == 2
    err = capsys.readouterr().err.splitlines()
    assert "--conditions: given without --tolerances" in err[0] and "no element 'column'" in err[1]
    assert not (here / "r.html").exists()


def test_tolerances_can_be_listed_and_copied(folder, here, capsys):
    assert main(["tolerances"]) == 0
    out = capsys.readouterr().out
    assert [line.split()[0] for line in out.splitlines()] == list(shipped())
    assert main(["tolerances", "nsss"]) == 0
    (here / "copy.yaml").write_text(capsys.readouterr().out.replace("L/1000", "L/2"))
    assert main(["report", f"{folder}/result.json", "--tolerances", "copy.yaml", "--loading-state", "unloaded",
                 "-o", "r.html"]) == 0  # fmt: skip
    assert "1 pass" in capsys.readouterr().err
    assert main(["tolerances", "nss"]) == 2
    assert "one of aisc303" in capsys.readouterr().err


def test_the_most_frequent_reason_is_said(folder, here, capfd):
    """Of several clauses, figures apart; of a run's members in the summary of the report."""
    clause = "  - {clause: c, title: t, figure: %s, limit: %s, unloaded: %s, verified_by: me}\n"
    rows = [("bow", "1 m", "true"), ("departure", "1 mm", "false"), ("end_displacement", "2 mm", "false")]
    (here / "own.yaml").write_text("title: t\nedition: e\nclauses:\n" + "".join(clause % row for row in rows))
    assert fit_to(folder, "r.json", "--tolerances", "own.yaml") == 0
    err = capfd.readouterr().err
    (line,) = [line for line in err.splitlines() if line.startswith("verdict")]
    assert line.startswith("verdict    fail: ") and line.endswith("(2 of 2 clauses)") and "is outside 1.00 mm" in line
    assert main(["report", "r.json", "--tolerances", "own.yaml", "-o", "r.html"]) == 0
    lines = capfd.readouterr().err.splitlines()
    (line,) = [line for line in lines if line.startswith("fail         most often: ")]
    assert "is outside 1.00 mm" in line and line.endswith("(2 of 2 verdicts)")
    assert any(line.startswith("inconclusive most often: holds for the unloaded member") for line in lines)
