"""A small site whose truth is known: a column, two beams, a pipe beside another, a plate, and its scan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import linear_ik
from linear_ik.design_model import DesignModel, LeftOut, Member, Obstacle
from linear_ik.element import Element, Placement
from linear_ik.profile import Circle, IShape, Profile, Rectangle
from linear_ik.scan import Scan
from linear_ik.scene import box_mesh

GUIDS = ("0column0000000000000$_", "1beam000000000000000$_", "2pipe000000000000000$_", "3PIPE000000000000000$_")
ABSENT = "4absent0000000000000$_"
LENGTHS = (2.0, 1.6, 1.5, 1.5)


@dataclass(frozen=True)
class Site:
    """A design, its scan file, and the true nodes by GlobalId."""

    design: DesignModel
    scan: Path
    truth: dict[str, np.ndarray]


def member(guid: str, kind: str, profile: Profile, length: float, location, axis, ref=None) -> Member:
    placement = Placement(location, axis, ref)
    element = Element(guid[1:7], profile, length, 4, placement, start="free")
    return Member(guid, kind, guid[1:7], f"T{guid[0]}", "", element)


def design(with_absent: bool = True) -> DesignModel:
    members = [
        member(GUIDS[0], "IfcColumn", IShape(0.2, 0.2, 0.009, 0.015), 2.0, (0, 0, 0), (0, 0, 1)),
        member(GUIDS[1], "IfcBeam", Rectangle(0.1, 0.2), 1.6, (0.12, 0, 1.8), (1, 0, 0), (0, 1, 0)),
        member(GUIDS[2], "IfcPipeSegment", Circle(0.05), 1.5, (0.5, 1.0, 1.0), (1, 0, 0)),
        member(GUIDS[3], "IfcPipeSegment", Circle(0.05), 1.5, (0.5, 1.13, 1.0), (1, 0, 0)),
    ]
    if with_absent:
        members.append(member(ABSENT, "IfcMember", Rectangle(0.1, 0.1), 1.0, (20, 20, 0), (0, 0, 1)))
    plate = box_mesh((0.11, 0, 1.8), (0.02, 0.16, 0.26))
    left = LeftOut("5plate00000000000000$_", "IfcBeam", "plate", "it is not slender")
    obstacle = Obstacle("6plate00000000000000$_", "IfcPlate", plate.vertices, plate.triangles)
    return DesignModel("site.ifc", "IFC4", 1.0, tuple(members), (left,), (obstacle,))


def site(folder: Path, points: int = 1500, file: str = "scan.ply") -> Site:
    """Write the scan of the site into a folder: bent members, and a floor under them."""
    model, truth, parts = design(), {}, []
    for i, m in enumerate(model.members[:4]):
        bends = [f"2:y:{0.4 + 0.2 * i}", f"4:x:{-0.5 + 0.2 * i}"]
        shift = np.eye(4)
        shift[:3, 3] = (0.004, -0.006, 0.0)
        scan = linear_ik.simulate(m.element, bends=bends, points=points, seed=i, displacement=shift)
        truth[m.guid] = scan.nodes_m
        parts.append(scan.points)
    rng = np.random.default_rng(9)
    parts.append(np.column_stack([rng.uniform(-1, 3, (2000, 2)), 0.001 * rng.standard_normal(2000) - 0.3]))
    points_m = np.concatenate(parts)
    # As a scanner's files are: in no element's order.
    points_m = points_m[rng.permutation(len(points_m))]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file
    linear_ik.write_scan(Scan(points_m), path)
    return Site(model, path, truth)


def only(model: DesignModel, *guids: str) -> DesignModel:
    return replace(model, members=tuple(m for m in model.members if m.guid in guids))
