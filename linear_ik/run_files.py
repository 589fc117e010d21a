"""Run files: the names of what a model run's folder holds, for the run that writes it and the verbs that read it."""

from __future__ import annotations

ELEMENTS = "elements"  # a folder with a result of each element
ASBUILT, PLY, LAZ, TABLE, REPORT = "asbuilt.ifc", "deviation.ply", "deviation.laz", "elements.csv", "run.json"
OUTPUTS = (ASBUILT, PLY, LAZ, TABLE, REPORT)
STATE = "run_state"  # a folder with what the run needs to go on
