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
MOST_NAMED = 5
Body = tuple[Array, npt.NDArray[np.int64]]


def select(model: DesignModel, options: ModelFitOptions) -> tuple[list[Member], list[Body]]:
    """Return the members to fit, and the bodies of everything else.

    A member that is not fitted is an obstacle, as designed.

    Raises:
        SettingsError: an element or a class that the design has not.
        LinearIkError: nothing is left to fit.
    """
    if not model.members:
        raise LinearIkError(model.source, "holds no linear element", "beams, columns, members or pipes")
    guids = [member.guid for member in model.members]
    twice = {guid for guid in guids if guids.count(guid) > 1} if len(set(guids)) < len(guids) else set()
    if twice:
        raise LinearIkError(model.source, f"{sorted(twice)[0]} is the GlobalId of two elements", "one each")
    only = {_guid_of(name, model) for name in options.only}
    classes = sorted({member.ifc_class for member in model.members})
    for name in options.classes:
        if _kind(name) not in (_kind(c) for c in classes):
            raise SettingsError("classes", f"{name} is not a class of its linear elements", ", ".join(classes))
    wanted = {_kind(name) for name in options.classes}
    chosen: list[Member] = []
    rest: list[Member] = []
    for member in model.members:
        fits = not only or member.guid in only
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


def _guid_of(wanted: str, model: DesignModel) -> str:
    """Return the GlobalId of the member that is meant: by its GlobalId, its tag, or its name.

    Raises:
        SettingsError: none is, several are, or it is one that is not fitted.
    """
    for field in ("guid", "tag", "name"):
        found = [member.guid for member in model.members if getattr(member, field) == wanted]
        if len(found) == 1:
            return found[0]
        if found:
            several = ", ".join(found[:MOST_NAMED]) + (", ..." if len(found) > MOST_NAMED else "")
            raise SettingsError("only", f"{wanted} is the {field} of {len(found)} elements", f"one of {several}")
    for left in model.left_out:
        if wanted in (left.guid, left.name):
            raise SettingsError("only", f"{wanted} is not fitted: {left.reason}", "a linear element")
    known = [name for member in model.members for name in (member.guid, member.tag, member.name) if name]
    near = difflib.get_close_matches(wanted, known, n=1)
    expected = f"{near[0]}?" if near else "a GlobalId, tag or name of one of its linear elements"
    raise SettingsError("only", f"{wanted} is not in the design", expected)


def _with_tolerance(member: Member, tolerance_m: float) -> Member:
    try:
        return replace(member, element=replace(member.element, length_tolerance_m=tolerance_m))
    except ElementError as error:
        raise SettingsError("length_tolerance_m", f"{error.what} for {member.guid}", error.expected) from None


def _kind(ifc_class: str) -> str:
    """Return a class as compared: IFC2X3 and IFC4 call a beam of constant section IfcBeamStandardCase."""
    return ifc_class.lower().removesuffix("standardcase")
