"""A small frame of steel tubes: its design as IFC, and scans of it in two years, with known movements between them.

`python examples/small_frame.py FOLDER` writes design.ifc, scan_2024.ply and scan_2026.ply: two columns, a beam between
them and a pipe below it. In the second scan the head of column C2 has moved by 8 mm.
"""

import sys
from pathlib import Path

import ifcopenshell
import numpy as np
from ifcopenshell.api.context import add_context
from ifcopenshell.api.geometry import add_profile_representation, assign_representation, edit_object_placement
from ifcopenshell.api.root import create_entity
from ifcopenshell.api.unit import assign_unit

import linear_ik
from linear_ik.scene import element_mesh, floor

SQUARE, ROUND, CENTRE = (0.2, 0.2, 0.01), (0.057, 0.0036), ((0.0, 0.0), (1.0, 0.0))
# class, tag, start, axis, local X, length; degrees of single joints in 2024, and what came on top until 2026.
MEMBERS = (
    ("IfcColumn", "C1", (0.0, 0.0, 0.0), (0, 0, 1), (0, 1, 0), 2.6, ("4:y:0.6", "8:y:-0.8"), ()),
    ("IfcColumn", "C2", (3.2, 0.0, 0.0), (0, 0, 1), (0, 1, 0), 2.6, ("5:x:0.6",), ("2:y:0.2",)),
    ("IfcBeam", "B1", (0.12, 0.0, 2.45), (1, 0, 0), (0, 1, 0), 2.96, ("2:x:0.2", "9:x:-0.3"), ()),
    ("IfcPipeSegment", "P1", (0.05, 0.4, 2.0), (1, 0, 0), (0, 1, 0), 3.0, ("5:y:1.5", "7:y:-1.5"), ()),
)
STATIONS = ((-1.5, -2.5, 1.5), (4.5, -2.0, 1.4), (1.5, 3.0, 0.6))


def write_design(path: Path) -> None:
    """Write the frame as IFC4, in metres."""
    file = ifcopenshell.file(schema="IFC4")
    create_entity(file, "IfcProject", name="small frame")
    assign_unit(file, length={"is_metric": True, "raw": "METERS"})
    context = add_context(file, "Model")
    body = add_context(file, "Model", "Body", "MODEL_VIEW", context)
    at = file.createIfcAxis2Placement2D(file.createIfcCartesianPoint(CENTRE[0]), file.createIfcDirection(CENTRE[1]))
    steel = file.createIfcRectangleHollowProfileDef("AREA", "SHS 200x10", at, *SQUARE)
    pipe = file.createIfcCircleHollowProfileDef("AREA", "114.3 x 3.6", at, *ROUND)
    for kind, tag, start, axis, x, length, *_ in MEMBERS:
        member = create_entity(file, kind, name=tag)
        member.Tag = tag
        T = np.eye(4)
        T[:3] = np.column_stack([x, np.cross(axis, x), axis, start])
        edit_object_placement(file, member, T)
        profile = pipe if kind == "IfcPipeSegment" else steel
        assign_representation(file, member, add_profile_representation(file, body, profile, length))
    file.write(str(path))


def scan_frame(design: linear_ik.DesignModel, moved: bool, seed: int) -> linear_ik.Scan:
    """Return what a scanner sees from three places: the members, in each other's way, and the floor."""
    bends = [row[6] + (row[7] if moved else ()) for row in MEMBERS]
    elements = [next(m.element for m in design.members if m.tag == row[1]) for row in MEMBERS]
    bodies = [element_mesh(element, bend) for element, bend in zip(elements, bends, strict=True)]
    parts = []
    for i, (element, bend) in enumerate(zip(elements, bends, strict=True)):
        others = [floor((1.5, 0.0, 0.0)), *bodies[:i], *bodies[i + 1 :]]
        scan = linear_ik.scan_virtually(
            element, stations=STATIONS, bends=bend, points=2500, others=others, seed=4 * seed + i
        )
        parts.append(scan.points[(scan.segment != 0) | (np.abs(scan.points[:, 2]) < 0.01)])
    return linear_ik.Scan(np.concatenate(parts))


def main(folder: Path) -> None:
    """Write the design and both scans."""
    folder.mkdir(parents=True, exist_ok=True)
    write_design(folder / "design.ifc")
    design = linear_ik.read_design(folder / "design.ifc")
    for seed, year in ((1, 2024), (2, 2026)):
        scan = scan_frame(design, moved=year == 2026, seed=seed)
        linear_ik.write_scan(scan, folder / f"scan_{year}.ply")
        print(f"{folder}/scan_{year}.ply: {len(scan.points):,} points")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
