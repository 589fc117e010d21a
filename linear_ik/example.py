"""The embedded example: a steel column, bumped and partly hidden, scanned from two sides."""

from __future__ import annotations

from pathlib import Path

from linear_ik.element import Element
from linear_ik.element_file import load_element
from linear_ik.scene import box_mesh, floor
from linear_ik.simulate import SimulatedScan
from linear_ik.virtual_scanner import scan_virtually

ELEMENT_FILE = Path(__file__).parent / "data" / "h_column.yaml"
# A bump at 1 m of height and an end that leans back: degrees of joints 3 to 6.
BENDS = ("3:x:1.5", "4:y:2.0", "5:x:-2.2", "6:y:-1.0")
STATIONS = ((0.5, -1.0, 1.6), (6.5, -1.5, 1.6))
POINTS = 12_000
RANGE_NOISE_M = 0.0015


def example_element() -> Element:
    """Return the column as designed."""
    return load_element(ELEMENT_FILE)


def example_element_text() -> str:
    """Return the column's element file, comments included."""
    return ELEMENT_FILE.read_text(encoding="utf-8")


def example_scan() -> SimulatedScan:
    """Return two stations' scan of the bent column on its floor, a crate in front of it.

    The stations never see its back; 1.5 mm range noise and 1 % mixed pixels.
    """
    crate = box_mesh(center=(3.4, 1.9, 0.3), size=(0.8, 0.5, 0.6))
    return scan_virtually(
        example_element(),
        stations=STATIONS,
        bends=BENDS,
        points=POINTS,
        range_noise_m=RANGE_NOISE_M,
        others=(floor((4.0, 2.5, 0.0)), crate),
    )
