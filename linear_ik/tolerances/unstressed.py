"""Unstressed: what a member that was scanned under its own weight would be without it.

Standards limit imperfections, not elastic deflection. Where the person states how the member is held and
what it is made of, its elastic sag is computed and taken from what was measured. Where not, own weight
is known to sag a member that is not vertical, and to sweep one that has no principal axis of its
section vertical: only what weight cannot cause is then held against a limit.
"""

from __future__ import annotations

import numpy as np

from linear_ik.deviation import Deviations, deviations
from linear_ik.elastic_sag import ElasticSag, elastic_sag
from linear_ik.result import FitResult
from linear_ik.section import section_properties
from linear_ik.tolerances.conditions import Conditions

# Of what own weight bends a member downwards, as much may be sideways: the rounding of a design's axes.
MOST_SIDEWAYS = 0.01


def sag_of(result: FitResult, known: Conditions) -> ElasticSag | None:
    """Return the elastic sag of a member, or None where it was not scanned so or something is not stated."""
    if known.loading_state != "self_weight" or known.supports is None or known.material is None:
        return None
    if result.element.axis_points is not None:
        return None
    return elastic_sag(result.element, known.supports, known.material, share95=known.sag_share95)


def imperfection(result: FitResult, sag: ElasticSag, known: Conditions) -> Deviations:
    """Return the deviations of a member that was found, without its elastic sag.

    Raises:
        LinearIkError: its ends coincide.
    """
    return deviations(result, precamber_m=known.precamber_m or 0.0, elastic=sag)


def not_stated(result: FitResult, known: Conditions) -> str:
    """Return what is missing for the elastic sag of a member under its own weight, and would make it known."""
    if result.element.axis_points is not None:
        return "the sag of a member that is curved by design is not computed: scan it unloaded"
    missing = []
    if known.supports is None:
        missing.append("how it is held (supports: simple, clamped, cantilever or cantilever_end)")
    if known.material is None:
        missing.append("what it is made of (material: steel, or E and density)")
    return "state " + " and ".join(missing)


def sags_straight_down(result: FitResult) -> bool:
    """Say whether own weight bends a member downwards only, by its design.

    A load along e bends a section along J^-1 e, J its second moments: along e alone where e is a
    principal axis.
    """
    element = result.element
    across = element.design.rotations.transpose(0, 2, 1) @ element.placement.T_world_element[2, :3]
    for profile in (element.profile_at(0.0), element.profile_at(1.0)):
        p = section_properties(profile)
        bends = across[:, :2] @ np.linalg.inv(np.array([[p.iyy_m4, p.ixy_m4], [p.ixy_m4, p.ixx_m4]]))
        down = np.einsum("ki,ki->k", bends, across[:, :2])
        sideways = bends[:, 0] * across[:, 1] - bends[:, 1] * across[:, 0]
        if (np.abs(sideways) > MOST_SIDEWAYS * down).any():
            return False
    return True
