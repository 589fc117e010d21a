"""What the geometry kernel gets wrong, put in words that it gets right, before it is asked.

ifcopenshell 0.9 applies the operator of an IfcDerivedProfileDef twice when it sweeps the
profile: what is mirrored twice is not mirrored at all. In the model in memory such a
profile's place is taken by its outline, point by point.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.profiles import ProfileReader
from linear_ik.errors import DesignError

Array = npt.NDArray[np.float64]


def replace_derived_profiles(model: Any, profiles: ProfileReader, unit_m: float) -> None:
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
