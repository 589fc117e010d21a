"""A small steel frame: from its IFC design and a scan to an as-built IFC and a report.

Run it with `python examples/frame_to_asbuilt.py FOLDER`.
"""

import sys
from pathlib import Path

import small_frame

import linear_ik
from linear_ik.report import read_run, write_report
from linear_ik.tolerances import Conditions, ConditionsOfEach


def main(folder: Path) -> None:
    """Make the frame, fit it, judge it, write the report."""
    small_frame.main(folder)
    found = linear_ik.fit_model(
        folder / "design.ifc",
        [folder / "scan_2024.ply"],
        folder / "asbuilt",
        options=linear_ik.ModelFitOptions(workers=0),
    )
    print(f"{found.fitted} of {len(found.rows)} elements fitted: {found.counts}")
    known = ConditionsOfEach(Conditions(loading_state="self_weight"))
    run = read_run(folder / "asbuilt", linear_ik.load_tolerances("aisc303"), known)
    for member in run.members:
        status = member.result.status
        print(f"{member.tag}: {status}, AISC 303: {member.outcome}")
    write_report(run, folder / "report.html", linear_ik.read_scan(folder / "scan_2024.ply"))
    built = linear_ik.read_design(folder / "asbuilt" / "asbuilt.ifc")
    kept = {m.guid for m in built.members} | {left.guid for left in built.left_out}
    same = all(row.member.guid in kept for row in found.rows)
    print(f"asbuilt.ifc keeps every GlobalId: {same}")
    print(f"report: {folder / 'report.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
