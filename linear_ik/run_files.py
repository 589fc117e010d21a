"""Run files: the names of what a model run's folder holds, for the run that writes it and the verbs that read it."""

from __future__ import annotations

from pathlib import Path

from linear_ik.errors import LinearIkError

ELEMENTS = "elements"  # a folder with a result of each element
ASBUILT, PLY, LAZ, TABLE, REPORT = "asbuilt.ifc", "deviation.ply", "deviation.laz", "elements.csv", "run.json"
OUTPUTS = (ASBUILT, PLY, LAZ, TABLE, REPORT)
STATE = "run_state"  # a folder with what the run needs to go on
UNFINISHED = "unfinished"  # in there, from the moment a run changes results until all its files are written


def check_finished(folder: Path) -> None:
    """Refuse the folder of a run, or its folder of results, where some of them may be preliminary or missing.

    Raises:
        LinearIkError: the run was interrupted, or is still at work.
    """
    run = folder.parent if folder.name == ELEMENTS else folder
    if (run / STATE / UNFINISHED).exists():
        raise LinearIkError(folder, "the run in it was not finished", "run linear-ik fit again: it goes on")
