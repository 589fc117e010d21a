"""Reason: why a fit may be wrong, a sentence for people and a code for programs.

Programs decide by codes alone: sentences name figures and may be worded better one day.
docs/formats.md has a table of the codes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

ReasonCode = Literal[
    "absent",
    "scan_units",
    "scan_elsewhere",
    "length_unit",
    "not_at_rest",
    "segments_not_scanned",
    "segments_inferred",
    "scatter",
    "joint_limits",
    "placement_limits",
    "bending_not_shown",
    "place_not_shown",
    "start_beside",
    "shifted_along",
    "noise_misgiven",
    "one_side",
    "parallel_surface",
    "turned_away",
    "side_off",
    "beside_all_along",
    "seen_through",
    "bends_between_joints",
    "stepped_aside",
    "thin_plates",
    "foreign_points",
    "touched",
    "other_section",
    "section_size",
    "outliers_removed",
    "stations_not_used",
    "coarse_coordinates",
    "length_not_measured",
    "length_as_designed",
    "length_by_held_end",
    "longer_than_allowed",
    "end_beside",
    "without_effect",
    "neighbours_not_settled",
]

# What the reader should know, and no doubt: the same section out of its nominal size, points that were left out.
NOTES = frozenset(
    {
        "section_size",
        "touched",
        "outliers_removed",
        "length_not_measured",
        "length_as_designed",
        "length_by_held_end",
        "without_effect",
    }
)
# Doubts that the covariance carries: who tests against it need not doubt again.
PLACE = frozenset({"place_not_shown"})
CARRIED = PLACE | {"bending_not_shown", "segments_not_scanned", "segments_inferred"}


@dataclass(frozen=True)
class Reason:
    """Why a fit may be wrong, or what else its reader should know.

    Attributes:
        code: for programs.
        sentence: for people, with the figures.
    """

    code: ReasonCode
    sentence: str


def only(codes: Sequence[str], allowed: frozenset[str]) -> bool:
    """Return whether there are doubts, and all of them are of the codes allowed.

    Without codes, as in files written before there were any, nobody knows which they are.
    """
    doubts = set(codes) - NOTES
    return bool(doubts) and doubts <= allowed
