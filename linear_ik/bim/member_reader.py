"""One product -> the sweep that it is, or the reason why it is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.axis_design import REMARK, sweep_of_axis
from linear_ik.bim.body_check import Agreement, agreement, box_difference_m, stood
from linear_ik.bim.broken import BROKEN, said
from linear_ik.bim.chain_of_solids import joined
from linear_ik.bim.mesh_sweep import box_sides, shape, sweeps_of_mesh
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.solids import Solid, body_representations, solids_of
from linear_ik.bim.sweep import Sweep, into, out_of
from linear_ik.bim.sweeps import SweepReader
from linear_ik.bim.tessellation import Body, item_body
from linear_ik.errors import DesignError, ElementError
from linear_ik.profile import Polygon, Rectangle

Array = npt.NDArray[np.float64]

# Of the section's larger side: how far a corbel, an end plate or the bend at a downpipe's foot reaches.
MOST_FIXED = 1.5


@dataclass(frozen=True, eq=False)
class Reading:
    """What was found of a product.

    Attributes:
        sweep: the element, or None.
        reason: why there is none.
        remark: what a person should know of a sweep that is not all of the body.
        solid: the IFC item that it was read from, where it was.
    """

    sweep: Sweep | None
    reason: str = ""
    remark: str = ""
    solid: Any = None


@dataclass(frozen=True, eq=False)
class MemberReader:
    """Reads the products of one file.

    Attributes:
        profiles: reads their sections.
        sweeps: reads their swept solids.
        slenderness: least length against the section's larger side.
        tolerance_m: how far a body may stick out of its element.
        unit_m: one of the file's length units.
    """

    profiles: ProfileReader
    sweeps: SweepReader
    slenderness: float
    tolerance_m: float
    unit_m: float

    def read(self, product: Any, body: Body | None) -> Reading:
        """Return what a product is.

        What the file writes down is believed where the body agrees with it; else the body
        itself is cut. A body that was cut or notched lies inside its element.
        """
        try:
            return self._read(product, body)
        except BROKEN as error:
            # One product that contradicts the schema is no reason to lose the others.
            return Reading(None, f"it cannot be read: {said(error)}")

    def _read(self, product: Any, body: Body | None) -> Reading:
        found = body_representations(product)
        if not found:
            return self._without_body(product)
        if body is None:
            return Reading(None, "its body cannot be computed")
        solids = solids_of(found[0], self.unit_m)
        if len(solids) == 1:
            return self._single(solids[0], body)
        return self._several(solids, body)

    def _without_body(self, product: Any) -> Reading:
        parts = [part for rel in product.IsDecomposedBy for part in rel.RelatedObjects]
        if parts:
            return Reading(None, "its body is that of its parts")
        try:
            sweep = sweep_of_axis(product, self.profiles)
        except DesignError as error:
            return Reading(None, f"it has no body, and {error.subject} {error.what}")
        if sweep is None:
            return Reading(None, "it has no body")
        if not self._slender(sweep):
            return Reading(None, "it has no body, and its axis is short")
        return Reading(sweep, remark=REMARK)

    def _single(self, solid: Solid, body: Body) -> Reading:
        written, reason = self._written(solid, body.vertices_m)
        if written is not None:
            found = agreement(written, body.vertices_m)
            if self._agrees(found) or self._is_tube(written, body.vertices_m):
                if self._slender(written):
                    return Reading(written, solid=solid.item)
                sides = box_sides(into(written.T_product_start, body.vertices_m))
                full = isinstance(written.profile, (Polygon, Rectangle))
                reason = f"it is {shape(sides, full)}"
                if not full or sides[1] < self.slenderness * max(sides[0], sides[2]):
                    # Nor is it a bar that was drawn from the side.
                    return Reading(None, reason, solid=solid.item)
            else:
                reason = _difference(found)
        cut = self._from_mesh(body, solid.item)
        if cut.sweep is not None and not cut.remark:
            return cut
        if written is not None and self._slender(written) and self._holds(agreement(written, body.vertices_m)):
            return Reading(written, solid=solid.item)
        return cut if cut.sweep is not None else Reading(None, reason or cut.reason, solid=solid.item)

    def _several(self, solids: list[Solid], body: Body) -> Reading:
        """Read a body of several solids: pieces one behind the other, or one that the others are fixed to."""
        written = []
        for solid in solids:
            part = item_body(solid.top)
            if part is None:
                continue
            vertices = out_of(solid.T_product_item, part.vertices_m)
            sweep, _ = self._written(solid, vertices)
            if sweep is not None and self._agrees(agreement(sweep, vertices)):
                written.append((sweep, solid.item))
        chain = joined([sweep for sweep, _ in written]) if len(written) == len(solids) else None
        if chain is not None and self._slender(chain) and self._holds(agreement(chain, body.vertices_m)):
            return Reading(chain, solid=written[0][1])
        cut = self._from_mesh(body, solids[0].item)
        if cut.sweep is not None and not cut.remark:
            return cut
        slender = [(sweep, item) for sweep, item in written if self._slender(sweep)]
        if slender:
            sweep, item = max(slender, key=lambda one: one[0].length_m * _area(one[0]))
            # The member is what runs from end to end; what is fixed to it is short.
            extent = np.ptp(into(sweep.T_product_start, body.vertices_m)[:, 2])
            if sweep.axis_m is not None or sweep.length_m > 0.8 * extent:
                return Reading(sweep, remark=f"read from one of the {len(solids)} solids of its body", solid=item)
        if cut.sweep is not None:
            return cut
        return Reading(None, f"it is made of {len(solids)} solids, and {cut.reason}", solid=solids[0].item)

    def _written(self, solid: Solid, vertices: Array) -> tuple[Sweep | None, str]:
        try:
            sweep = self.sweeps.read(solid)
            return (stood(sweep, vertices) if sweep is not None else None), ""
        except (DesignError, ElementError) as error:
            return None, f"{error.subject} {error.what}"

    def _from_mesh(self, body: Body, item: Any) -> Reading:
        found, reason = sweeps_of_mesh(
            body.vertices_m, body.triangles, self.profiles, self.slenderness, self.tolerance_m
        )
        second: Reading | None = None
        for sweep in found:
            if not self._slender(sweep):
                reason = f"it is {shape(box_sides(into(sweep.T_product_start, body.vertices_m)))}"
                continue
            compared = agreement(sweep, body.vertices_m)
            if self._agrees(compared):
                return Reading(sweep, solid=item)
            reason = _difference(compared)
            # A corbel or an end plate belongs to the body, not to the section that most of it has. A second leg
            # of a pipe is more than that.
            fixed = compared.outside_m <= MOST_FIXED * _side_m(sweep)
            if second is None and fixed and sweep.axis_m is None and sweep.profile_end is None:
                second = Reading(sweep, remark=reason, solid=item)
        return second or Reading(None, reason, solid=item)

    def _agrees(self, found: Agreement) -> bool:
        return self._holds(found) and found.short_m <= self.tolerance_m

    def _holds(self, found: Agreement) -> bool:
        return found.outside_m <= self.tolerance_m and found.ends_m <= self.tolerance_m

    def _is_tube(self, sweep: Sweep, vertices: Array) -> bool:
        """Say whether a body is at least as large as a round section along a curve.

        The kernel's tubes around curves have vertices inside themselves, and in places a few
        millimetres outside.
        """
        return sweep.axis_m is not None and box_difference_m(sweep, vertices) <= self.tolerance_m

    def _slender(self, sweep: Sweep) -> bool:
        # A hair's breadth is rounding.
        return sweep.length_m + 1e-6 >= self.slenderness * _side_m(sweep)


def _side_m(sweep: Sweep) -> float:
    return float(np.ptp(sweep.profile.outline(), axis=0).max())


def _area(sweep: Sweep) -> float:
    return float(np.prod(np.ptp(sweep.profile.outline(), axis=0)))


def _difference(found: Agreement) -> str:
    if found.ends_m > max(found.outside_m, found.short_m):
        return f"its body ends {1000 * found.ends_m:.0f} mm from where its axis does"
    if found.outside_m >= found.short_m:
        return f"its body sticks out of its section by {1000 * found.outside_m:.1f} mm"
    return f"its body is {1000 * found.short_m:.1f} mm smaller than its section"
