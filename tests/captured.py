"""Elements of the captured scans, from the design placements in the data folder's README."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import linear_ik
from linear_ik.element import Element, Placement
from linear_ik.profile import Circle, IShape, Profile, Rectangle
from linear_ik.scan import Scan

DATA = Path(os.environ.get("LINEAR_IK_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "scans"
needs_captured_scans = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the captured scans are not in {DATA} (LINEAR_IK_DATA)"
)

STEEL, PUMP = "steel_joint.txt", "pump.e57"
FILE_OF = {
    "heb340": STEEL,
    "hea140": STEEL,
    "timber_000A": "timber_000A.ply",
    "timber_000Z": "timber_000Z.ply",
    "pipe_west": PUMP,
    "pipe_east": PUMP,
}


@cache
def scan_of(name: str) -> Scan:
    """The scan that a member is in, among whatever else."""
    return linear_ik.read_scan(DATA / FILE_OF[name])


def element_of(name: str) -> Element:
    """A member as designed, its start free."""
    if name == "heb340":
        profile: Profile = IShape(overall_width=0.3, overall_depth=0.34, web_thickness=0.012, flange_thickness=0.0215)
        return _between(name, profile, (-0.6947, 19.1172, 6.8640), (-0.6942, 17.9161, 6.8850), y=(0.0, 0.0, 1.0))
    if name == "hea140":
        profile = IShape(overall_width=0.14, overall_depth=0.133, web_thickness=0.0055, flange_thickness=0.0085)
        return _between(
            name, profile, (-0.6883, 17.8783, 6.1950), (-0.7010, 18.5444, 6.7483), y=(-0.006, 0.639, -0.769)
        )
    if name == "pipe_west":
        return _between(name, Circle(0.0881), (-1.1005, -1.9523, 0.20), (-1.0978, -1.9500, 1.15))
    if name == "pipe_east":
        return _between(name, Circle(0.0891), (0.5885, -3.2545, 0.50), (0.5942, -3.2524, 1.30))
    design = json.loads((DATA / "timber_design.json").read_text(encoding="utf-8"))[name]
    width, height = np.array(design["section_mm"]) / 1000
    return _between(
        name, Rectangle(width, height), design["axis_start_m"], design["axis_end_m"], x=design["width_direction"]
    )


def _between(name: str, profile: Profile, start, end, x=None, y=None) -> Element:
    axis = np.subtract(end, start)
    if y is not None:
        x = np.cross(y, axis)
    placement = Placement(tuple(start), tuple(axis), None if x is None else tuple(x))
    return Element(name, profile, float(np.linalg.norm(axis)), placement=placement, start="free")
