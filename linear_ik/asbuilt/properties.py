"""Properties: what the property set LinearIK_AsBuilt says of an element. Lengths in the file's unit."""

from __future__ import annotations

import math
import uuid
from collections import Counter
from collections.abc import Iterable
from datetime import datetime
from importlib.metadata import version
from typing import Any

from linear_ik.asbuilt.draft import Draft
from linear_ik.deviation import Deviations, deviations
from linear_ik.deviation_figures import Figure
from linear_ik.errors import LinearIkError
from linear_ik.result import FitResult

NAME = "LinearIK_AsBuilt"
AS_BUILT, AS_DESIGNED = "as built", "as designed"
NOT_FITTED = "not fitted"

# Property of a figure -> its field in Deviations; a second property with the suffix Band95 goes with each.
FIGURES = {
    "Bow": "bow_m",
    "Sag": "sag_m",
    "Sweep": "sweep_m",
    "OutOfPlumb": "out_of_plumb_m",
    "EndDisplacement": "end_displacement_m",
    "LargestDeparture": "departure_max_m",
    "LengthChange": "length_change_m",
    "Twist": "twist_rad",
    "LargestSlope": "slope_max_rad",
}

SEGMENTS = {"SegmentsMeasured": "measured", "SegmentsInferred": "inferred", "SegmentsNotScanned": "not_scanned"}


class PropertySets:
    """Adds the property set to products; what says the same of several products is written once."""

    def __init__(self, draft: Draft, when: datetime) -> None:
        """Take a file and the date of what is written."""
        self._draft, self._when = draft, when
        self._software = f"linear_ik {version('linear_ik')}"
        self._values: dict[tuple[str, str | int | float], Any] = {}
        self._remove_earlier()

    def of_fitted(self, result: FitResult, notes: Iterable[str]) -> list[Any]:
        """Return what was measured of a product whose body will be as built, for `attach`."""
        try:
            figures: Deviations | None = deviations(result)
        except LinearIkError as error:
            figures, notes = None, [*notes, f"No deviations: {error}"]
        values = self._common(result.status, AS_BUILT, result.reasons, notes)
        if figures is not None:
            values += self._figures(figures)
        for name, metres in (("SurfaceRms", result.surface_rmse_m), ("RangeNoise", result.range_noise_m)):
            if math.isfinite(metres):
                values.append(self._quantity(name, metres, "_m"))
        counts = Counter(str(segment.status) for segment in result.segments)
        values.append(self._single("Points", "IfcInteger", sum(segment.points for segment in result.segments)))
        return values + [self._single(name, "IfcInteger", counts[status]) for name, status in SEGMENTS.items()]

    def _figures(self, figures: Deviations) -> list[Any]:
        values = []
        for name, field in FIGURES.items():
            figure: Figure = getattr(figures, field)
            if figure.value is None:
                continue
            for suffix, number in (("", figure.value), ("Band95", figure.band)):
                if number is not None and math.isfinite(number):
                    values.append(self._quantity(name + suffix, number, field))
        departures = self._draft.lengths([math.hypot(*row) for row in figures.departure_m.xy])
        bands = self._draft.lengths(list(figures.departure_band_m))
        return [
            *values,
            self._list("NodeDepartures", departures),
            self._list("NodeDeparturesBand95", bands),
        ]

    def of_not_found(self, product: Any, result: FitResult, notes: Iterable[str] = ()) -> None:
        """Say that a product was looked for and is not in the scan, or has no shape to show."""
        self.attach([product], self._common(result.status, AS_DESIGNED, result.reasons, notes))

    def of_not_fitted(self, products: list[Any], why: str = "") -> None:
        """Say that products were not looked for, and why."""
        if products:
            self.attach(products, self._common(NOT_FITTED, AS_DESIGNED, [why] if why else (), ()), why)

    def _common(self, status: str, shape: str, reasons: Iterable[str], notes: Iterable[str]) -> list[Any]:
        if self._draft.schema == "IFC2X3":
            date = self._single("Date", "IfcLabel", self._when.date().isoformat())
        else:
            date = self._single("Date", "IfcDate", self._when.date().isoformat())
        values = [
            self._single("Status", "IfcLabel", status.replace("_", " ")),
            self._single("Shape", "IfcLabel", shape),
            date,
            self._single("Software", "IfcLabel", self._software),
        ]
        for name, sentences in (("Reasons", list(reasons)), ("Notes", list(notes))):
            if sentences:
                values.append(self._single(name, "IfcText", " ".join(s.rstrip(".") + "." for s in sentences)))
        return values

    def _quantity(self, name: str, number: float, field: str) -> Any:
        if field.endswith("_rad"):
            return self._single(name, "IfcPlaneAngleMeasure", float(f"{number / self._draft.unit_rad:.6g}"))
        return self._single(name, "IfcLengthMeasure", self._draft.length(number))

    def _single(self, name: str, measure: str, value: str | int | float) -> Any:
        # What several elements have in common is one entity: a third of the time and of the text.
        key = (name, value)
        if key not in self._values:
            nominal = self._draft.model.create_entity(measure, value)
            self._values[key] = self._draft.make("IfcPropertySingleValue", Name=name, NominalValue=nominal)
        return self._values[key]

    def _list(self, name: str, lengths: Iterable[float]) -> Any:
        make, model = self._draft.make, self._draft.model
        values = [model.create_entity("IfcLengthMeasure", v) for v in lengths]
        return make("IfcPropertyListValue", Name=name, ListValues=values)

    def _remove_earlier(self) -> None:
        """Remove what an earlier run said: a product has one property set of a name."""
        model = self._draft.model
        for sheet in [s for s in model.by_type("IfcPropertySet") if s.Name == NAME]:
            for relation in model.get_inverse(sheet):
                if relation.is_a("IfcRelDefinesByProperties"):
                    model.remove(relation)
            values = list(sheet.HasProperties)
            model.remove(sheet)
            for value in values:
                if not model.get_total_inverses(value):
                    model.remove(value)

    def attach(self, products: list[Any], values: list[Any], about: str = "") -> None:
        """Add the property set of some values to products; ``about`` tells it from another one of the first product."""
        make, owner = self._draft.make, self._draft.owner_history(products[0])
        sheet = make(
            "IfcPropertySet",
            GlobalId=sheet_guid(products[0], about + "properties"),
            OwnerHistory=owner,
            Name=NAME,
            HasProperties=values,
        )
        make(
            "IfcRelDefinesByProperties",
            GlobalId=sheet_guid(products[0], about + "relation"),
            OwnerHistory=owner,
            RelatedObjects=products,
            RelatingPropertyDefinition=sheet,
        )


def sheet_guid(product: Any, what: str) -> str:
    """Return the GlobalId of what is said of a product: the same whenever it is said."""
    import ifcopenshell.guid

    return str(ifcopenshell.guid.compress(uuid.uuid5(uuid.NAMESPACE_OID, f"{product.GlobalId}/{NAME}/{what}").hex))
