"""What the geometry kernel gets wrong, put in words that it gets right, before it is asked.

ifcopenshell 0.9 applies the operator of an IfcDerivedProfileDef twice when it sweeps the
profile: what is mirrored twice is not mirrored at all. In the model in memory such a
profile's place is taken by its outline, point by point. It makes nothing of a disk swept
along a polyline with rounded corners, so the corners become points; and it takes angles
for degrees where the file names no unit for them, which means radians. For a product without
a GlobalId it waits for ever, with an empty one it does not. It draws all representations of
a product, sketches and reserved spaces too, and does not tell which is the body.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.broken import BROKEN
from linear_ik.bim.curves import directrix
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.solids import body_representations
from linear_ik.errors import DesignError

Array = npt.NDArray[np.float64]


def mend(model: Any, profiles: ProfileReader, unit_m: float) -> None:
    """Change a model in memory so that the kernel draws it as it is meant; ``profiles`` reads what was there."""
    _replace_derived_profiles(model, profiles, unit_m)
    _draw_rounded_corners(model, unit_m)
    _leave_out_impossible_tubes(model)
    _say_radians(model)
    _name_emptily(model)


def leave_one_body(products: Iterable[Any]) -> dict[int, str]:
    """Leave each product the body that is read alone; return by id what is to be said of those that had several."""
    chosen: list[tuple[Any, Any]] = []
    remarks: dict[int, str] = {}
    for product in products:
        try:
            found = body_representations(product)
        except BROKEN:
            # Whoever reads the member says so.
            continue
        if found:
            chosen.append((product.Representation, found[0]))
        if len(found) > 1:
            remarks[product.id()] = f"read from one of the {len(found)} representations of its body"
    # What several products share is changed when all have been looked at.
    for shape, body in chosen:
        if len(shape.Representations) > 1:
            shape.Representations = [body]
    return remarks


def _draw_rounded_corners(model: Any, unit_m: float) -> None:
    if model.schema == "IFC2X3":
        return
    for disk in model.by_type("IfcSweptDiskSolidPolygonal"):
        if not disk.FilletRadius:
            continue
        try:
            points = directrix(disk, unit_m)
        except (DesignError, *BROKEN):
            continue
        made = [model.create_entity("IfcCartesianPoint", tuple(float(v) for v in point / unit_m)) for point in points]
        disk.Directrix, disk.FilletRadius = model.create_entity("IfcPolyline", made), None
        disk.StartParam = disk.EndParam = None


def _leave_out_impossible_tubes(model: Any) -> None:
    """Make tubes with a bore of no size full: the kernel would end the process."""
    for disk in model.by_type("IfcSweptDiskSolid"):
        bore = disk.InnerRadius
        if bore is not None and disk.Radius is not None and not 0 < bore < disk.Radius:
            disk.InnerRadius = None


def _name_emptily(model: Any) -> None:
    for product in model.by_type("IfcProduct"):
        if product.GlobalId is None:
            product.GlobalId = ""


def _say_radians(model: Any) -> None:
    import ifcopenshell.util.unit as units

    assignment = units.get_unit_assignment(model)
    if assignment is not None and units.get_project_unit(model, "PLANEANGLEUNIT") is None:
        radian = model.create_entity("IfcSIUnit", None, "PLANEANGLEUNIT", None, "RADIAN")
        assignment.Units = [*assignment.Units, radian]


def _replace_derived_profiles(model: Any, profiles: ProfileReader, unit_m: float) -> None:
    """Let every swept area that is derived be its outline; ``profiles`` goes on reading what was there."""
    for derived in list(model.by_type("IfcDerivedProfileDef")):
        try:
            placed = profiles.read(derived)
        except DesignError:
            # Whoever reads the member says so.
            continue
        rings = [placed.outline()]
        if (hole := placed.profile.hole()) is not None:
            rings.append(hole @ placed.R.T + placed.t_m)
        curves = [_polyline(model, ring / unit_m) for ring in rings]
        kind = "IfcArbitraryProfileDefWithVoids" if len(curves) > 1 else "IfcArbitraryClosedProfileDef"
        holes = (curves[1:],) if len(curves) > 1 else ()
        outline = model.create_entity(kind, derived.ProfileType, derived.ProfileName, curves[0], *holes)
        profiles.stand_in(outline, derived)
        for user in list(model.get_inverse(derived)):
            for name in ("SweptArea", "EndSweptArea"):
                if getattr(user, name, None) == derived:
                    setattr(user, name, outline)


def _polyline(model: Any, ring: Array) -> Any:
    points = [model.create_entity("IfcCartesianPoint", (float(x), float(y))) for x, y in ring]
    return model.create_entity("IfcPolyline", [*points, points[0]])
