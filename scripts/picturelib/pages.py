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
SETTLE_S = 0.5


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
        element, column = folder / "demo" / "element.yaml", folder / "demo" / "scan.ply"
        record = ("--record", folder / "recording.html")
        run("fit", element, column, "-q", *record, "-o", folder / "result.json")
        with browser(folder / "profile") as tab:
            return [
                shot(tab, folder / "demo" / "view.html", figures / "view.png", 1000, 640),
                recording(tab, folder / "recording.html", figures / "recording.png"),
                shot(tab, folder / "report.html", figures / "report_1280.png", 1280, 1500, "e3"),
                shot(tab, folder / "report.html", figures / "report_390.png", 390, 844),
            ]


def run(*arguments: object) -> None:
    """Run a verb of the command line; it has said what was wrong."""
    code = linear_ik([str(part) for part in arguments])
    if code:
        raise SystemExit(code)


def shot(tab: Tab, page: Path, picture: Path, width: int, height: int, part: str = "") -> Path:
    """Take a picture of a page as it opens, or from one of its parts on."""
    tab.open(page.as_uri() + (f"#{part}" if part else ""), width, height)
    time.sleep(DRAWN_S)
    return small(tab.shot(picture))


def recording(tab: Tab, page: Path, picture: Path) -> Path:
    """Take a picture of a recording in its middle."""
    tab.open(page.as_uri(), 1000, 640)
    time.sleep(DRAWN_S)
    tab.ask(
        "{ const s = document.querySelector('#player input'); s.value = Math.round(s.max / 3);"
        " s.dispatchEvent(new Event('input')); }"
    )
    time.sleep(SETTLE_S)
    return small(tab.shot(picture))


def small(picture: Path) -> Path:
    """Write a picture anew with 256 colours, which pages do not miss."""
    Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)
    return picture
