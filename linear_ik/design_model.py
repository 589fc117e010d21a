"""DesignModel: the linear elements of a building as designed, and what else stands there.

Made from an IFC file by `linear_ik.bim`, or by hand; the fit of a whole model needs nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Member:
    """A linear element of the model.

    Attributes:
        guid: IFC's GlobalId; names its files.
        ifc_class: such as IfcBeam; an IfcFlowSegment of IFC2X3 is called by what its type says
            it is, such as IfcPipeSegment.
        name: IFC's Name; may be empty.
        tag: the mark that drawings use (IFC's Tag, else the Name); may be empty.
        profile_name: such as HEB340; may be empty.
        element: the design in the model's coordinates, metres.
        remark: a plain sentence on what of the body is not in the element; empty where nothing is.
    """

    guid: str
    ifc_class: str
    name: str
    tag: str
    profile_name: str
    element: Element
    remark: str = ""


@dataclass(frozen=True)
class LeftOut:
    """A product of a linear class that is not fitted.

    Attributes:
        guid: IFC's GlobalId; empty where the file has none.
        ifc_class: such as IfcBeam.
        name: IFC's Name; may be empty.
        reason: a plain sentence.
    """

    guid: str
    ifc_class: str
    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Another body of the design: its points are not a member's.

    Plates, bolts, fittings, slabs, walls, and the members that were left out.

    Attributes:
        guid: IFC's GlobalId; empty where the file has none.
        ifc_class: such as IfcPlate.
        vertices_m: [V][3] in the model's coordinates.
        triangles: [T][3] rows of ``vertices_m``.
    """

    guid: str
    ifc_class: str
    vertices_m: Array
    triangles: Triangles


@dataclass(frozen=True, eq=False)
class MapConversion:
    """From the model's coordinates to a map's (IfcMapConversion).

    Attributes:
        T_map_model: [4][4], metres to metres, the map unit and the scale included.
        crs: name of the coordinate reference system, such as EPSG:25832; may be empty.
    """

    T_map_model: Array
    crs: str

    def to_map(self, points_m: Array) -> Array:
        """Return points [P][3] of the model's coordinates in the map's."""
        return np.asarray(points_m @ self.T_map_model[:3, :3].T + self.T_map_model[:3, 3])

    def to_model(self, points_m: Array) -> Array:
        """Return points [P][3] of the map's coordinates in the model's."""
        # Subtracted first: the rest is then small, and keeps its digits.
        return np.asarray(np.linalg.solve(self.T_map_model[:3, :3], (points_m - self.T_map_model[:3, 3]).T).T)

    def direction_to_map(self, direction: tuple[float, float]) -> tuple[float, float]:
        """Return a direction in the model's plane, such as its true north, on the map; unit length."""
        return _unit(self.T_map_model[:2, :2] @ np.asarray(direction))

    def direction_to_model(self, direction: tuple[float, float]) -> tuple[float, float]:
        """Return a direction on the map, such as its grid north (0, 1), in the model's plane; unit length."""
        return _unit(np.linalg.solve(self.T_map_model[:2, :2], np.asarray(direction)))


@dataclass(frozen=True, eq=False)
class DesignModel:
    """What a design file says of linear elements. Metres, the model's own coordinates.

    Attributes:
        source: the file's name, for messages.
        schema: as the file says it, such as IFC2X3.
        length_unit_m: one of the file's length units, in metres.
        members: what is to be fitted, in the file's order.
        left_out: products of a linear class that are not, each with its reason.
        obstacles: the other bodies.
        map_conversion: None where the file has none.
        true_north: direction of north in the model's plane (x, y), unit length; None where not stated.
        notes: plain sentences on what is odd about the file.
    """

    source: str
    schema: str
    length_unit_m: float
    members: tuple[Member, ...]
    left_out: tuple[LeftOut, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    map_conversion: MapConversion | None = None
    true_north: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()


def _unit(vector: Array) -> tuple[float, float]:
    x, y = vector / np.hypot(*vector)
    return float(x), float(y)
