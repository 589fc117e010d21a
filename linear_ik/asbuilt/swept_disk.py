"""Swept disk: a bent tube or bar as one IfcSweptDiskSolid along a smooth line, in any schema."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.asbuilt.directrix import Directrix, smooth_directrix
from linear_ik.asbuilt.draft import Draft
from linear_ik.profile import Circle, CircleHollow

Array = npt.NDArray[np.float64]


def swept_disk(draft: Draft, nodes_m: Array, section: Circle | CircleHollow) -> Any:
    """Return an IfcSweptDiskSolid along nodes [N+1][3] of the product's own coordinates."""
    line = smooth_directrix(nodes_m, section.radius)
    sizes = {"Radius": draft.length(section.radius)}
    if isinstance(section, CircleHollow):
        sizes["InnerRadius"] = draft.length(section.radius - section.wall_thickness)
    if draft.schema != "IFC2X3":
        return draft.make("IfcSweptDiskSolid", Directrix=_indexed(draft, line), **sizes)
    # The whole of a composite curve; IFC2X3 wants it said.
    whole = {"StartParam": 0.0, "EndParam": _range(draft, line)}
    return draft.make("IfcSweptDiskSolid", Directrix=_composite(draft, line), **whole, **sizes)


def _indexed(draft: Draft, line: Directrix) -> Any:
    pieces = [
        draft.make("IfcArcIndex" if arc else "IfcLineIndex", wrappedValue=tuple(i + 1 for i in run))
        for run, arc in zip(line.runs, line.arcs, strict=True)
    ]
    points = draft.make("IfcCartesianPointList3D", CoordList=[draft.lengths(p) for p in line.points_m])
    return draft.make("IfcIndexedPolyCurve", Points=points, Segments=pieces, SelfIntersect=False)


def _composite(draft: Draft, line: Directrix) -> Any:
    points = [draft.point(p) for p in line.points_m]
    pieces: list[Any] = []
    for run, arc in zip(line.runs, line.arcs, strict=True):
        last = len(pieces) == len(line.runs) - 1
        pieces.append(
            draft.make(
                "IfcCompositeCurveSegment",
                # Corners are inside a polyline: one piece goes over into the next without one.
                Transition="DISCONTINUOUS" if last else "CONTSAMEGRADIENT",
                SameSense=True,
                ParentCurve=(
                    _trimmed_circle(draft, line.points_m[list(run)], points[run[0]], points[run[-1]])
                    if arc
                    else draft.make("IfcPolyline", Points=[points[i] for i in run])
                ),
            )
        )
    return draft.make("IfcCompositeCurve", Segments=pieces, SelfIntersect=False)


def _trimmed_circle(draft: Draft, through: Array, start: Any, end: Any) -> Any:
    centre, radius, x, z, angle = _circle(through)
    position = draft.make(
        "IfcAxis2Placement3D", Location=draft.point(centre), Axis=draft.direction(z), RefDirection=draft.direction(x)
    )
    circle = draft.make("IfcCircle", Position=position, Radius=draft.length(radius))
    at = [draft.make("IfcParameterValue", wrappedValue=v) for v in (0.0, angle / draft.unit_rad)]
    return draft.make(
        "IfcTrimmedCurve",
        BasisCurve=circle,
        Trim1=[at[0], start],
        Trim2=[at[1], end],
        SenseAgreement=True,
        # A point is as exact on a circle of kilometres as on one of millimetres.
        MasterRepresentation="CARTESIAN",
    )


def _range(draft: Draft, line: Directrix) -> float:
    """Return how far the parameter of a composite curve runs: one a leg of a polyline, the angle of an arc."""
    return sum(
        _circle(line.points_m[list(run)])[4] / draft.unit_rad if arc else float(len(run) - 1)
        for run, arc in zip(line.runs, line.arcs, strict=True)
    )


def _circle(through: Array) -> tuple[Array, float, Array, Array, float]:
    """Return the circle of an arc [3][3]: centre, radius, directions to its start and of its axis, its angle."""
    start, middle, end = through
    chord, rise = (end - start) / 2, middle - (start + end) / 2
    half, sagitta = float(np.linalg.norm(chord)), float(np.linalg.norm(rise))
    radius = (half**2 + sagitta**2) / (2 * sagitta)
    inward = -rise / sagitta
    centre = middle + radius * inward
    z = np.cross(rise, chord)
    x = start - centre
    return centre, radius, x / np.linalg.norm(x), z / np.linalg.norm(z), 4 * float(np.arctan2(sagitta, half))
