"""read_design: an IFC file as a DesignModel."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.bim.axis_design import placement_of
from linear_ik.bim.body_check import enough_segments
from linear_ik.bim.broken import BROKEN, said
from linear_ik.bim.file import ModelFile, open_model
from linear_ik.bim.georeference import angle_unit_rad, length_unit_m, map_conversion, true_north
from linear_ik.bim.kernel_repairs import leave_one_body, mend
from linear_ik.bim.member_reader import MemberReader
from linear_ik.bim.products import guid_of, linear_products, not_named, other_products, profile_name, text
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.settings import DesignSettings
from linear_ik.bim.sweep import Sweep
from linear_ik.bim.sweeps import SweepReader
from linear_ik.bim.tessellation import Body, bodies
from linear_ik.design_axis import follow
from linear_ik.design_model import DesignModel, LeftOut, Member, Obstacle
from linear_ik.element import Element, Placement
from linear_ik.errors import DesignError, ElementError, SettingsError

Array = npt.NDArray[np.float64]
OnProgress = Callable[[int, int], None]

LONGEST_NAME = 200
CHORD_TOLERANCE_M = 2e-3  # of the segments below a curved axis


def read_design(
    path: str | os.PathLike[str],
    settings: DesignSettings | None = None,
    on_progress: OnProgress | None = None,
    **changes: Any,
) -> DesignModel:
    """Read the linear elements of an IFC file, and what else stands there.

    Every product of the linear classes is a member or is left out with a reason. A member's
    axis runs through the middle of its section's bounding box, over the length that its body
    has after everything was cut off it; its profile is the whole one, without notches and
    openings. Holes are kept where they make a box or a tube; a scanner sees the outside.

    Args:
        path: .ifc of IFC2X3, IFC4 or IFC4X3, or .ifczip.
        settings: how; DesignSettings() when None.
        on_progress: called with how many bodies are done, and of how many.
        changes: of single settings, such as ``slenderness=2.5`` or ``obstacles=False``.

    Returns:
        Metres, in the model's own coordinates (IFC's world coordinate system).

    Raises:
        DesignError: said of the file: no IFC, damaged, no product of a linear class, nothing but contradictions.
        SettingsError: a setting out of its range, or that is none.
    """
    how = _settings(settings, changes)
    file = open_model(path)
    try:
        return _read(file, how, on_progress)
    except BROKEN as error:
        raise DesignError(file.path, f"contradicts {file.schema}: {said(error)}", "a valid IFC file") from error


def _read(file: ModelFile, how: DesignSettings, on_progress: OnProgress | None) -> DesignModel:
    model = file.model
    unit_m = length_unit_m(file.path, model)
    linear = linear_products(model, how.classes)
    if not linear:
        raise DesignError(file.path, "holds no linear element", "one of " + ", ".join(how.classes))
    others = other_products(model, {product.id() for product, _ in linear}) if how.obstacles else []
    angle_rad = angle_unit_rad(model)
    profiles = ProfileReader(unit_m, angle_rad, how.tolerance_m)
    mend(model, profiles, unit_m)
    remarks = leave_one_body([*(product for product, _ in linear), *others])
    reader = MemberReader(profiles, SweepReader(profiles, unit_m, angle_rad), how.slenderness, how.tolerance_m, unit_m)
    found = bodies(model, [p for p, _ in linear if p.Representation] + others, how.kernel_threads, on_progress)
    members, left_out, unfit = _read_members(reader, linear, not_named(model), remarks, found, how)
    if how.obstacles:
        unfit += [(product, product.is_a()) for product in others]
    conversion, notes = map_conversion(model, unit_m)
    return DesignModel(
        source=file.path.name,
        schema=file.schema,
        length_unit_m=unit_m,
        members=tuple(members),
        left_out=tuple(left_out),
        obstacles=tuple(
            _obstacle(product, name, found[product.id()]) for product, name in unfit if product.id() in found
        )
        if how.obstacles
        else (),
        map_conversion=conversion,
        true_north=true_north(model),
        notes=notes,
    )


def _settings(settings: DesignSettings | None, changes: dict[str, Any]) -> DesignSettings:
    try:
        return replace(settings or DesignSettings(), **changes)
    except TypeError:
        known = DesignSettings.__dataclass_fields__
        wrong = next(name for name in changes if name not in known)
        raise SettingsError(wrong, "is no setting", "one of " + ", ".join(known)) from None


def _read_members(
    reader: MemberReader,
    linear: list[tuple[Any, str]],
    nameless: dict[int, str],
    remarks: dict[int, str],
    found: dict[int, Body],
    how: DesignSettings,
) -> tuple[list[Member], list[LeftOut], list[tuple[Any, str]]]:
    """Return the members, what is left out, and the products of the latter."""
    members: list[Member] = []
    left_out: list[LeftOut] = []
    unfit: list[tuple[Any, str]] = []
    for product, name in linear:
        guid = guid_of(product)
        body = found.get(product.id())
        reading = reader.read(product, body)
        reason = nameless.get(product.id()) or reading.reason
        if reading.sweep is not None and product.id() not in nameless:
            try:
                T = body.T_world_product if body is not None else placement_of(product, reader.unit_m)
                element = _element(product, reading.sweep, T, how)
                tag = text(getattr(product, "Tag", None)) or text(product.Name)
                section = profile_name(product, reading.solid)
                remark = "; ".join(filter(None, (reading.remark, remarks.get(product.id()))))
                members.append(Member(guid, name, text(product.Name), tag, section, element, remark))
                continue
            except ElementError as error:
                reason = f"it makes no element: {error}"
        left_out.append(LeftOut(guid, name, text(product.Name), reason))
        unfit.append((product, name))
    return members, left_out, unfit


def _element(product: Any, sweep: Sweep, T_world_product: Array, how: DesignSettings) -> Element:
    T = T_world_product @ sweep.T_product_start
    location, axis, ref = (tuple(float(v) for v in T[:3, k]) for k in (3, 2, 0))
    segments = how.segments_for(sweep.length_m)
    points = None
    if sweep.axis_m is not None:
        points = tuple((float(x), float(y), float(z)) for x, y, z in sweep.axis_m)
        segments = _on_curve(sweep.axis_m, segments, how)
    label = "".join(c for c in text(product.Name) if c.isprintable()) or guid_of(product)
    return Element(
        label[:LONGEST_NAME],
        sweep.profile,
        sweep.length_m,
        segments,
        Placement(location, axis, ref),  # type: ignore[arg-type]
        start="free",
        placement_tolerance=how.placement_tolerance,
        profile_end=sweep.profile_end,
        axis_points=points,
    )


def _on_curve(axis: Array, segments: int, how: DesignSettings) -> int:
    """Return so many segments that they follow a curved axis."""
    most = max(segments, how.most_segments)
    if how.segments is not None:
        return segments
    while True:
        enough = enough_segments(axis, segments, most)
        if enough is None:
            raise ElementError("axis_points", f"up to {most} segments cannot follow its turns", "a gentler curve")
        if enough >= most or _below_m(axis, enough) <= CHORD_TOLERANCE_M:
            return enough
        segments = min(most, max(enough + 1, int(1.2 * enough)))


def _below_m(axis: Array, segments: int) -> float:
    """Return how far a polyline is from the chain that follows it."""
    nodes = follow(tuple(map(tuple, axis)), segments).nodes_m
    legs = np.diff(nodes, axis=0)
    t = np.clip(((axis[:, None] - nodes[:-1]) * legs).sum(axis=2) / (legs**2).sum(axis=1), 0.0, 1.0)
    gaps = np.linalg.norm(axis[:, None] - nodes[:-1] - t[:, :, None] * legs, axis=2)
    return float(gaps.min(axis=1).max())


def _obstacle(product: Any, name: str, body: Body) -> Obstacle:
    return Obstacle(guid_of(product), name, body.world_m(), body.triangles)
