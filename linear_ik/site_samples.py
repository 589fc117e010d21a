"""Surface samples: points on the designed members, to tell which member a scan point is near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.design_model import DesignModel
from linear_ik.element import Element
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

SPACING_M = 0.04
MOST_SAMPLES = 1_500_000


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points on the outer surfaces of all members.

    Attributes:
        points_m: [S][3] in the model's coordinates.
        segment: [S] segment that each is on, counted over all members.
        member_of_segment: [N] row of the model's members.
        area_m2: [M] outer surface of each member, ends left out.
        spacing_m: between neighbours.
    """

    points_m: Array
    segment: npt.NDArray[np.int64]
    member_of_segment: npt.NDArray[np.int64]
    area_m2: Array
    spacing_m: float


def sample_surfaces(model: DesignModel) -> SurfaceSamples:
    """Return points on the members of a model, 40 mm apart or as many as are affordable."""
    elements = [member.element for member in model.members]
    areas = np.array([_area_m2(element) for element in elements])
    spacing = max(SPACING_M, float(np.sqrt(areas.sum() / MOST_SAMPLES)))
    points, segments, members = [], [], []
    first = 0
    for row, element in enumerate(elements):
        own, of = _sampled(element, spacing)
        points.append(own)
        segments.append(of + first)
        members += [row] * element.segments
        first += element.segments
    return SurfaceSamples(
        np.concatenate(points), np.concatenate(segments), np.array(members, dtype=np.int64), areas, spacing
    )


def _area_m2(element: Element) -> float:
    return element.length_m * Surface.of(element.profile_at(0.5)).perimeter_m


def _sampled(element: Element, spacing_m: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return points [S][3] on an element in world coordinates, and the segment of each."""
    design, T = element.design, element.placement.T_world_element
    along = max(1, int(np.ceil(element.segment_length_m / spacing_m)))
    z = (np.arange(along) + 0.5) / along * element.segment_length_m
    out, of = [], []
    for k in range(element.segments):
        surface = Surface.of(element.profile_at((k + 0.5) / element.segments))
        around = max(3, int(np.ceil(surface.perimeter_m / spacing_m)))
        xy = surface.at((np.arange(around) + 0.5) / around * surface.perimeter_m)
        local = np.column_stack([np.repeat(xy, along, axis=0), np.tile(z, around)])
        out.append(design.nodes_m[k] + local @ design.rotations[k].T)
        of.append(np.full(len(local), k, dtype=np.int64))
    return np.concatenate(out) @ T[:3, :3].T + T[:3, 3], np.concatenate(of)
