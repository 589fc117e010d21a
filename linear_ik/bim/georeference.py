"""Where a model is on the map: IfcMapConversion, its IFC2X3 predecessor, true north, units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from linear_ik.design_model import MapConversion
from linear_ik.errors import DesignError

LARGEST_SCALE_ERROR = 0.01  # map projections stretch by 0.04 %, heights by 0.1 %


def length_unit_m(path: Path, model: Any) -> float:
    """Return one of the file's length units in metres.

    Raises:
        DesignError: said of the file: it has no length unit, or one of no size.
    """
    import ifcopenshell.util.unit as units

    if units.get_project_unit(model, "LENGTHUNIT") is None:
        raise DesignError(path, "does not say its length unit", "an IfcUnitAssignment with a LENGTHUNIT")
    unit = float(units.calculate_unit_scale(model))
    if not (np.isfinite(unit) and unit > 0):
        raise DesignError(path, f"has a length unit of {unit} m", "a unit above 0")
    return unit


def angle_unit_rad(model: Any) -> float:
    """Return one of the file's plane angle units in radians; radians where it names none."""
    import ifcopenshell.util.unit as units

    if units.get_project_unit(model, "PLANEANGLEUNIT") is None:
        return 1.0
    return float(units.calculate_unit_scale(model, "PLANEANGLEUNIT"))


def true_north(model: Any) -> tuple[float, float] | None:
    """Return the direction of north in the model's plane, unit length, or None."""
    for context in model.by_type("IfcGeometricRepresentationContext", include_subtypes=False):
        if context.TrueNorth:
            x, y = context.TrueNorth.DirectionRatios[:2]
            length = float(np.hypot(x, y))
            if length > 0:
                return x / length, y / length
    return None


def map_conversion(model: Any, unit_m: float) -> tuple[MapConversion | None, tuple[str, ...]]:
    """Return the map conversion of a model or None, and what is odd about it.

    IFC's scale s takes numbers in project units to numbers in map units, so that in metres the
    factor is s u_map / u_model. Only map projections and heights make it other than 1, by less
    than a thousandth: where it is far from 1, the file mixes up its units, and 1 is meant.
    """
    import ifcopenshell.util.geolocation as geolocation

    try:
        p = geolocation.get_helmert_transformation_parameters(model)
        crs, map_unit_m = _crs(model)
    except (AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        return None, (f"its map conversion cannot be read: {error}",)
    if p is None:
        return None, ()
    notes: list[str] = []
    if map_unit_m is None:
        map_unit_m, note = _map_unit_left_out(p, unit_m)
        notes += note
    factor = p.scale * map_unit_m / unit_m
    if abs(factor - 1) > LARGEST_SCALE_ERROR:
        if p.scale != 1:
            notes.append(f"the scale {p.scale:g} of its map conversion contradicts its units: a metre is kept a metre")
        factor = 1.0
    cosine, sine = np.array([p.xaa, p.xao]) / np.hypot(p.xaa, p.xao)
    T = np.eye(4)
    T[:3, :3] = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) * (
        factor * np.array([p.factor_x, p.factor_y, p.factor_z])
    )
    T[:3, 3] = np.array([p.e, p.n, p.h]) * map_unit_m
    if not np.isfinite(T).all() or abs(np.linalg.det(T)) < 1e-9:
        return None, ("its map conversion is none: it has no finite inverse",)
    return MapConversion(T, crs), tuple(notes)


def _crs(model: Any) -> tuple[str, float | None]:
    """Return the name of the map's coordinate system and one of its length units in metres, None where not said."""
    import ifcopenshell.util.element as elements
    import ifcopenshell.util.unit as units

    if model.schema == "IFC2X3":
        pset = elements.get_pset(model.by_type("IfcProject")[0], "ePSet_ProjectedCRS") or {}
        return str(pset.get("Name") or ""), _named_unit_m(pset.get("MapUnit"))
    crs = next(iter(model.by_type("IfcCoordinateReferenceSystem")), None)
    if crs is None:
        return "", None
    unit = getattr(crs, "MapUnit", None)
    return str(crs.Name or ""), None if unit is None else float(units.get_unit_scale(unit))


def _map_unit_left_out(p: Any, unit_m: float) -> tuple[float, list[str]]:
    """Return the unit of a map whose file doesn't name it: the project's, unless that makes no sense."""
    in_metres = abs(p.scale / unit_m - 1) <= LARGEST_SCALE_ERROR
    # In the project's millimetres such a place would be beside the origin of the map.
    beside = unit_m < 0.1 and abs(p.scale - 1) <= LARGEST_SCALE_ERROR and 1e5 <= np.hypot(p.e, p.n) < 1e5 / unit_m
    if beside:
        return 1.0, ["its map conversion names no unit; metres are taken, not the project's"]
    return (1.0 if in_metres else unit_m), []


def _named_unit_m(name: object) -> float | None:
    """Return the metres of a unit that is written out, as in IFC2X3's property sets."""
    if name is None:
        return None
    text = str(name).upper().replace("_", " ")
    if "SURVEY" in text:
        return 1200 / 3937
    if "FOOT" in text or "FEET" in text:
        return 0.3048
    return 0.001 if text.startswith("MILLI") else 1.0
