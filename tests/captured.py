"""Elements of the captured scans, from the design placements in the data folder's README."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import linear_ik
from linear_ik.element import Element, Placement, PlacementTolerance
from linear_ik.profile import Circle, IShape, Profile, Rectangle
from linear_ik.scan import Scan

DATA = Path(os.environ.get("LINEAR_IK_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "scans"
needs_captured_scans = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the captured scans are not in {DATA} (LINEAR_IK_DATA)"
)

WIRE_RADIUS_M = 0.004
# Picked from the points: from near the trunk outwards.
WIRE_M = (
    (0.452, -0.133, 0.322),
    (0.409, -0.145, 0.320),
    (0.370, -0.172, 0.320),
    (0.331, -0.184, 0.322),
    (0.311, -0.167, 0.331),
    (0.289, -0.149, 0.331),
    (0.250, -0.130, 0.327),
    (0.2245, -0.124, 0.321),
    (0.2015, -0.113, 0.320),
)
# The grid of its points is 1/64 m in x and 1/32 m in y, and its post some 0.1 m thick at the base.
POST_M = (
    (-9.835, 0.015, -5.40),
    (-10.03, -0.005, -0.25),
    (-10.035, 0.0, 0.12),
    (-10.09, 0.03, 0.24),
    (-10.17, 0.07, 0.30),
    (-10.31, 0.14, 0.345),
    (-10.48, 0.22, 0.36),
)
STEEL, PUMP = "steel_joint.txt", "pump.e57"
FILE_OF = {
    "heb340": STEEL,
    "hea140": STEEL,
    "timber_000A": "timber_000A.ply",
    "timber_000Z": "timber_000Z.ply",
    "pipe_west": PUMP,
    "pipe_east": PUMP,
    "wire": "wire_harness.txt",
    "lamppost": "lamppost.pcd",
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
    if name == "wire":
        return _along(name, Circle(WIRE_RADIUS_M), WIRE_M, 14, PlacementTolerance(0.01, 2.0))
    if name == "lamppost":
        return _along(name, Circle(0.05), POST_M, 20, PlacementTolerance(), Circle(0.03))
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


def _along(
    name: str, profile: Profile, points, segments: int, tolerance: PlacementTolerance, end: Profile | None = None
) -> Element:
    """An element along a polyline in the scan's coordinates."""
    world = np.array(points)
    placement = Placement(tuple(world[0]), tuple(world[1] - world[0]))
    local = (world - world[0]) @ placement.T_world_element[:3, :3]
    return Element(
        name,
        profile,
        float(np.linalg.norm(np.diff(local, axis=0), axis=1).sum()),
        segments,
        placement,
        start="free",
        placement_tolerance=tolerance,
        profile_end=end,
        axis_points=tuple(map(tuple, local)),
    )
