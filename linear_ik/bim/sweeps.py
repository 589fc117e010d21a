"""Swept solids -> Sweep: the section and the line that IFC writes down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.bim.curves import arc_points, directrix
from linear_ik.bim.placed_profile import PlacedProfile, carried
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.solids import Solid, placement_m
from linear_ik.bim.sweep import Sweep, into, line_frame, seated
from linear_ik.errors import DesignError
from linear_ik.profile import Circle, CircleHollow, Polygon, Profile

Array = npt.NDArray[np.float64]

SAME_MIDDLE_M = 1e-3


@dataclass(frozen=True, eq=False)
class SweepReader:
    """Reads the swept solids of one file.

    Attributes:
        profiles: reads their sections.
        unit_m: one of the file's length units.
        angle_rad: one of its angle units.
    """

    profiles: ProfileReader
    unit_m: float
    angle_rad: float

    def read(self, solid: Solid) -> Sweep | None:
        """Return what a solid sweeps, or None where it is of another kind.

        Raises:
            DesignError: a swept solid whose section or line cannot be read.
        """
        kind = solid.item.is_a()
        if kind in ("IfcExtrudedAreaSolid", "IfcExtrudedAreaSolidTapered"):
            return self._extruded(solid)
        if kind == "IfcRevolvedAreaSolid":
            return self._revolved(solid)
        if kind in ("IfcSweptDiskSolid", "IfcSweptDiskSolidPolygonal"):
            return self._disk(solid)
        return None

    def _extruded(self, solid: Solid) -> Sweep:
        item = solid.item
        A = solid.T_product_item @ placement_m(item.Position, self.unit_m)
        along = (
            A[:3, :3]
            @ np.array(item.ExtrudedDirection.DirectionRatios)
            / np.linalg.norm(item.ExtrudedDirection.DirectionRatios)
        )
        along *= item.Depth * self.unit_m
        if not np.linalg.norm(along) > 0:
            raise DesignError("its extrusion", "has no depth")
        T_line = line_frame(A[:3, 3], along, A[:3, 0])
        start = self._on_plane(self.profiles.read(item.SweptArea), A, T_line)
        length_m = float(np.linalg.norm(along))
        if not item.is_a("IfcExtrudedAreaSolidTapered"):
            return Sweep(seated(T_line, start), start.profile, length_m)
        end = self._on_plane(self.profiles.read(item.EndSweptArea), A, T_line)
        T_start, first, last = self._tapered(T_line, start, end)
        return Sweep(T_start, first, length_m, None if first == last else last)

    def _on_plane(self, placed: PlacedProfile, A: Array, T_line: Array) -> PlacedProfile:
        """Return a profile of the plane XY of ``A`` [4][4] as it is seen along a line, in its frame's XY."""
        # Drawn at a slant or stretched by a map, it is the outline of a right section.
        linear = (T_line[:3, :3].T @ A[:3, :2])[:2]
        moved = carried(placed, linear, np.zeros(2))
        return self.profiles.drawn(placed.outline() @ linear.T) if moved is None else moved

    def _tapered(self, T_line: Array, start: PlacedProfile, end: PlacedProfile) -> tuple[Array, Profile, Profile]:
        same_kind = type(start.profile) is type(end.profile) and np.abs(start.R - end.R).max() < 1e-6
        if same_kind and np.linalg.norm(start.t_m - end.t_m) < SAME_MIDDLE_M:
            return seated(T_line, start), start.profile, end.profile
        # One side stays flat: sections with their middles on a line are none of these, but their outlines are.
        first, last = ((p.outline() - start.t_m) @ start.R for p in (start, end))
        return seated(T_line, start), Polygon(first), Polygon(last)  # type: ignore[arg-type]

    def _revolved(self, solid: Solid) -> Sweep:
        item = solid.item
        A = solid.T_product_item @ placement_m(item.Position, self.unit_m)
        hub = np.array(item.Axis.Location.Coordinates, dtype=np.float64) * self.unit_m
        axis = item.Axis.Axis.DirectionRatios if item.Axis.Axis is not None else (0.0, 0.0, 1.0)
        angle = item.Angle * self.angle_rad
        placed = self.profiles.read(item.SweptArea)
        # In the plane of the section: its middle goes around the axis.
        points = arc_points(np.append(placed.t_m, 0.0), hub, np.array(axis, dtype=np.float64), angle)
        points = points @ A[:3, :3].T + A[:3, 3]
        # The first chord leans to the arc's inside by half a step; the section is square to the arc.
        normal = A[:3, 2] if (points[1] - points[0]) @ A[:3, 2] > 0 else -A[:3, 2]
        T_line = line_frame(points[0], normal, A[:3, 0])
        moved = self._on_plane(PlacedProfile(placed.profile, placed.R, np.zeros(2)), A, T_line)
        return _along(points, seated(T_line, moved), moved.profile)

    def _disk(self, solid: Solid) -> Sweep:
        item = solid.item
        points = directrix(item, self.unit_m)
        T = solid.T_product_item
        scale = float(abs(np.linalg.det(T[:3, :3])) ** (1 / 3))
        radius = item.Radius * self.unit_m * scale
        profile: Profile = Circle(radius)
        if item.InnerRadius:
            profile = CircleHollow(radius, radius - item.InnerRadius * self.unit_m * scale)
        points = points @ T[:3, :3].T + T[:3, 3]
        return _along(points, line_frame(points[0], points[1] - points[0], np.array([1.0, 0.0, 0.0])), profile)


def _along(points: Array, T_start: Array, profile: Profile) -> Sweep:
    """Return a sweep along a polyline [P][3] of the product's coordinates; straight where the polyline is."""
    axis = into(T_start, points)
    axis -= axis[0]
    length_m = float(np.linalg.norm(np.diff(axis, axis=0), axis=1).sum())
    if np.linalg.norm(axis[:, :2], axis=1).max() < 1e-6:
        return Sweep(T_start, profile, length_m)
    return Sweep(T_start, profile, length_m, axis_m=axis)
