"""Selection: which members of a design are fitted, and what else is in their way."""

from __future__ import annotations

import difflib
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from linear_ik.design_model import DesignModel, Member
from linear_ik.element import SEGMENTS
from linear_ik.errors import ElementError, LinearIkError, SettingsError
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.scene import element_mesh

Array = npt.NDArray[np.float64]
Body = tuple[Array, npt.NDArray[np.int64]]


def select(model: DesignModel, options: ModelFitOptions) -> tuple[list[Member], list[Body]]:
    """Return the members to fit, and the bodies of everything else.

    A member that is not fitted is an obstacle, as designed.

    Raises:
        SettingsError: a GlobalId or a class that the design has not.
        LinearIkError: nothing is left to fit.
    """
    if not model.members:
        raise LinearIkError(model.source, "holds no linear element", "beams, columns, members or pipes")
    guids = [member.guid for member in model.members]
    twice = {guid for guid in guids if guids.count(guid) > 1} if len(set(guids)) < len(guids) else set()
    if twice:
        raise LinearIkError(model.source, f"{sorted(twice)[0]} is the GlobalId of two elements", "one each")
    left_out = {left.guid: left.reason for left in model.left_out}
    for guid in options.only:
        if guid in left_out:
            raise SettingsError("only", f"{guid} is not fitted: {left_out[guid]}", "a linear element")
        if guid not in guids:
            near = difflib.get_close_matches(guid, guids, n=1)
            raise SettingsError("only", f"{guid} is not in the design", f"{near[0]}?" if near else "a GlobalId")
    classes = sorted({member.ifc_class for member in model.members})
    for name in options.classes:
        if _kind(name) not in (_kind(c) for c in classes):
            raise SettingsError("classes", f"{name} is not in the design", ", ".join(classes))
    wanted = {_kind(name) for name in options.classes}
    chosen: list[Member] = []
    rest: list[Member] = []
    for member in model.members:
        fits = not options.only or member.guid in options.only
        fits &= not wanted or _kind(member.ifc_class) in wanted
        (chosen if fits else rest).append(member)
    if not chosen:
        raise LinearIkError(model.source, "no element is in both --only and --class", "at least one")
    if options.segments is not None:
        auto = options.segments == "auto"
        segments = SEGMENTS if options.segments == "auto" else options.segments
        chosen = [replace(m, element=replace(m.element, segments=segments, auto_segments=auto)) for m in chosen]
    if options.length_tolerance_m is not None:
        chosen = [_with_tolerance(m, options.length_tolerance_m) for m in chosen]
    bodies = [(o.vertices_m, o.triangles) for o in model.obstacles]
    for member in rest:
        mesh = element_mesh(member.element)
        bodies.append((mesh.vertices, mesh.triangles))
    return chosen, bodies


def _with_tolerance(member: Member, tolerance_m: float) -> Member:
    try:
        return replace(member, element=replace(member.element, length_tolerance_m=tolerance_m))
    except ElementError as error:
        raise SettingsError("length_tolerance_m", f"{error.what} for {member.guid}", error.expected) from None


def _kind(ifc_class: str) -> str:
    """Return a class as compared: IFC2X3 and IFC4 call a beam of constant section IfcBeamStandardCase."""
    return ifc_class.lower().removesuffix("standardcase")
