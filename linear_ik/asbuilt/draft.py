"""Draft: an open IFC file that is being changed, with what is made once and used often."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.georeference import angle_unit_rad, length_unit_m
from linear_ik.bim.solids import placement_m

Array = npt.NDArray[np.float64]

DIRECTION_DIGITS = 12
LENGTH_DIGITS = 9  # of a metre: rounding noise would make a file twice as long


class Draft:
    """A file's entities, its units and frames, and short-hands for new entities.

    Attributes:
        model: the ifcopenshell file.
        schema: IFC2X3, IFC4 or IFC4X3.
        unit_m: one of the file's length units in metres.
        unit_rad: one of its angle units in radians.
        profiles: profile entities made so far, by what they show.
    """

    def __init__(self, model: Any, path: Path) -> None:
        """Take an open file.

        Raises:
            DesignError: said of ``path``: no length unit.
        """
        self.model = model
        self.schema = str(model.schema)
        self.unit_m, self.unit_rad = length_unit_m(path, model), angle_unit_rad(model)
        self._digits = LENGTH_DIGITS + round(math.log10(self.unit_m))
        self.profiles: dict[object, Any] = {}
        self._placements: dict[int, Array] = {}
        self._owners: dict[int, Any] = {}
        self._subcontexts: dict[tuple[int, str], Any] = {}
        self._up: Any = None

    def make(self, ifc_class: str, **attributes: Any) -> Any:
        """Return a new entity."""
        return self.model.create_entity(ifc_class, **attributes)

    # geometry ------------------------------------------------------------------------

    def point(self, metres: Sequence[float] | Array) -> Any:
        """Return an IfcCartesianPoint."""
        return self.make("IfcCartesianPoint", Coordinates=self.lengths(metres))

    def lengths(self, metres: Sequence[float] | Array) -> tuple[float, ...]:
        """Return lengths in the file's unit."""
        return tuple(round(float(v) / self.unit_m, self._digits) + 0.0 for v in metres)

    def length(self, metres: float) -> float:
        """Return one length in the file's unit."""
        return self.lengths([metres])[0]

    def direction(self, unit: Array) -> Any:
        """Return an IfcDirection."""
        return self.make("IfcDirection", DirectionRatios=tuple(round(float(v), DIRECTION_DIGITS) + 0.0 for v in unit))

    def up(self) -> Any:
        """Return the direction +Z."""
        if self._up is None:
            self._up = self.direction(np.array([0.0, 0.0, 1.0]))
        return self._up

    # frames --------------------------------------------------------------------------

    def T_model_product(self, product: Any) -> Array:  # noqa: N802 (T_target_source)
        """Return an object's placement [4][4] in the model's coordinates, metres."""
        return self._frame(product.ObjectPlacement)

    def _frame(self, placement: Any) -> Array:
        if placement is None:
            return np.eye(4)
        key = placement.id()
        if key not in self._placements:
            if placement.is_a("IfcLocalPlacement") and placement.RelativePlacement.is_a("IfcAxis2Placement3D"):
                parent = self._frame(placement.PlacementRelTo)
                T = parent @ placement_m(placement.RelativePlacement, self.unit_m)
            else:
                import ifcopenshell.util.placement

                T = np.array(ifcopenshell.util.placement.get_local_placement(placement), dtype=np.float64)
                T[:3, 3] *= self.unit_m
            self._placements[key] = np.asarray(T)
        return self._placements[key]

    def subcontext(self, context: Any, identifier: str, view: str) -> Any:
        """Return the subcontext of that name of a representation's context, made where there is none."""
        parent = context.ParentContext if context.is_a("IfcGeometricRepresentationSubContext") else context
        key = (parent.id(), identifier)
        if key not in self._subcontexts:
            found = [s for s in parent.HasSubContexts if s.ContextIdentifier == identifier]
            self._subcontexts[key] = (
                found[0]
                if found
                else self.make(
                    "IfcGeometricRepresentationSubContext",
                    ContextIdentifier=identifier,
                    ContextType=parent.ContextType,
                    ParentContext=parent,
                    TargetView=view,
                )
            )
        return self._subcontexts[key]

    # who did it ----------------------------------------------------------------------

    def owner_history(self, product: Any) -> Any:
        """Return the owner history of what is added to a product: its own user, this application, now.

        None where the product has none, as IFC4 allows, or one that names no user.
        """
        user = getattr(product.OwnerHistory, "OwningUser", None)
        if user is None:
            return None
        if user.id() not in self._owners:
            self._owners[user.id()] = self.make(
                "IfcOwnerHistory",
                OwningUser=user,
                OwningApplication=self._application(),
                LastModifiedDate=int(time.time()),  # IFC4 asks for it beside a change
                ChangeAction="ADDED",
                CreationDate=int(time.time()),
            )
        return self._owners[user.id()]

    def _application(self) -> Any:
        from importlib.metadata import version

        number = version("linear_ik")
        for application in self.model.by_type("IfcApplication"):
            # Name and version are unique in a file.
            if application.ApplicationFullName == "linear_ik" and application.Version == number:
                return application
        return self.make(
            "IfcApplication",
            ApplicationDeveloper=self.make("IfcOrganization", Name="linear_ik"),
            Version=number,
            ApplicationFullName="linear_ik",
            ApplicationIdentifier=f"linear_ik {number}",
        )
