"""Screenshots of what the package shows a person, by headless Chromium."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import small_frame
from browser import CHROMIUM, Tab, browser
from PIL import Image

from linear_ik.cli import main as linear_ik

DRAWN_S = 3.0  # software rendering takes its time
ARM = """
name: arm
profile: {type: rectangle, x_dim: 0.1, y_dim: 0.2}
length: 2.0
segments: 5
"""
LONG = """
name: long beam
profile: IPE300
length: 12.0
placement: {location: [0, 0, 3], axis: [1, 0, 0], ref_direction: [0, 1, 0]}
start: free
"""
SAG = ("--bend", "1:x:0.21", "--bend", "4:x:-0.14", "--bend", "6:x:-0.14", "--bend", "8:x:-0.14")
BENDS = ("--bend", "2:x:-25", "--bend", "4:y:-20")


def pages(figures: Path) -> list[Path]:
    """Run the commands of the start pages, open what they wrote, and take the pictures.

    Args:
        figures: folder of the pictures.
    """
    if CHROMIUM is None:
        raise SystemExit("error: chromium: not installed (Debian: apt-get install chromium)")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small_frame.main(folder)
        design, scan = folder / "design.ifc", folder / "scan_2024.ply"
        run("fit", design, scan, "--workers", 1, "-q", "-o", folder / "built")
        tolerances = ("--tolerances", "aisc303", "--loading-state", "self_weight")
        run("report", folder / "built", "--scan", scan, *tolerances, "-q", "-o", folder / "report.html")
        run("demo", "-o", folder / "demo")
        element, scan = folder / "arm.yaml", folder / "arm.ply"
        element.write_text(ARM, encoding="utf-8")
        run("simulate", element, *BENDS, "--points", 6000, "-o", scan)
        run("fit", element, scan, "-q", "--record", folder / "recording.html", "-o", folder / "result.json")
        long = own_weight(folder)
        with browser(folder / "profile") as tab:
            return [
                played(tab, folder / "demo" / "view.html", figures / "view.png", 1.0),
                played(tab, folder / "recording.html", figures / "recording.png", 0.25, pairs=True),
                report(tab, folder / "report.html", figures / "report_1280.png", 1280, 1500, "C2"),
                report(tab, folder / "report.html", figures / "report_390.png", 390, 540),
                plots(tab, long, figures / "own_weight.png"),
            ]


def own_weight(folder: Path) -> Path:
    """Make the report of the engineer's page of a long beam under its own weight."""
    element, scan, result = (folder / name for name in ("long.yaml", "long.ply", "long.json"))
    element.write_text(LONG, encoding="utf-8")
    run("simulate", element, *SAG, "--points", 12_000, "--noise", 0.0015, "--seed", 3, "-o", scan)
    run("fit", element, scan, "-q", "-o", result)
    stated = ("--loading-state", "self_weight", "--supports", "simple", "--material", "steel")
    run("report", result, "--tolerances", "nsss", *stated, "-q", "-o", folder / "long.html")
    return folder / "long.html"


def run(*arguments: object) -> None:
    """Run a verb of the command line; it has said what was wrong."""
    code = linear_ik([str(part) for part in arguments])
    if code:
        raise SystemExit(code)


def played(tab: Tab, page: Path, picture: Path, share: float, pairs: bool = False) -> Path:
    """Take a picture of the viewer's page where a share of its iterations are over, with its pairs or without."""
    tab.open(page.as_uri(), 1280, 720)
    time.sleep(DRAWN_S)
    if pairs:
        tab.ask("document.querySelector('#player label input').click()")
    tab.ask(
        f"{{ const s = document.querySelector('#player input'); s.value = Math.round({share} * s.max);"
        " s.dispatchEvent(new Event('input')); }"
    )
    time.sleep(DRAWN_S)
    # In all its colours: those of small marks are lost otherwise, or the ground's shades.
    Image.open(tab.shot(picture)).convert("RGB").save(picture, optimize=True)
    return picture


def report(tab: Tab, page: Path, picture: Path, width: int, height: int, tag: str = "") -> Path:
    """Take a picture of the report's list, or of the page of the element with a tag."""
    tab.open(page.as_uri(), width, height)
    if tag:
        tab.ask(f"[...document.querySelectorAll('#list a')].find((a) => a.textContent === '{tag}').click()")
    time.sleep(DRAWN_S)
    return small(tab.shot(picture))


def plots(tab: Tab, page: Path, picture: Path) -> Path:
    """Take a picture of the first two plots of a report of one element."""
    tab.open(page.as_uri() + "#/long", 760, 900)
    time.sleep(DRAWN_S)
    top, bottom = tab.ask(
        "[0, 1].map((i) => document.querySelectorAll('article.open svg.plot')[i].closest('figure')"
        ".getBoundingClientRect()).map((box, i) => (i ? box.bottom : box.top) + window.scrollY)"
    )
    with Image.open(tab.shot(picture, whole=True)) as whole:
        whole.crop((0, round(top), 760, round(bottom))).save(picture)
    return small(picture)


def small(picture: Path) -> Path:
    """Write a picture anew with 256 colours, which a report does not miss."""
    Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)
    return picture
