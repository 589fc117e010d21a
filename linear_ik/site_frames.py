"""Whether a model and a scan are in the same coordinates, and if not, what keeps them apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik import coordinates
from linear_ik.design_model import DesignModel, MapConversion

Array = npt.NDArray[np.float64]

# What a scan may be in, in metres.
UNITS = {**coordinates.UNITS, "metres taken for millimetres": 1000.0}
# Of a scan's x, y, z: what its writer may have made of a model's.
SWAPS = {
    "y and z swapped": np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]], dtype=np.float64),
    "y up instead of z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float64),
    "z turned to y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float64),
    "x and y swapped": np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1]], dtype=np.float64),
}
LEAST_SHARE = 0.02  # of the points near some member: less is worth a word
CLEARLY = 3.0  # times the weight that is without the change
FAR_M = 1000.0
# Of a change of coordinates that is beyond doubt: points that it brings near a member, and times the weight without it.
SURE_SHARE, SURELY = 0.2, 10.0
LARGE = 100.0  # times the size of the model: another unit


@dataclass(frozen=True)
class Hits:
    """What some points of a scan have to do with a model.

    Attributes:
        share: of the points that are near a member.
        segments: how many of the members' segments have one; a scan that is shrunk to a heap has
            many points near few of them.
    """

    share: float
    segments: int

    @property
    def weight(self) -> float:
        """How much they have to do with each other."""
        return self.share * self.segments


Count = Callable[[Array], Hits]


@dataclass(frozen=True, eq=False)
class FrameFinding:
    """What is known of a scan's coordinates.

    Attributes:
        place: "model": the scan is in the model's coordinates; "map": in those that its map
            conversion leads to; "elsewhere": neither.
        sentences: what a person should know; empty where all is well.
        share: of the points near some member, in that place.
    """

    place: str
    sentences: tuple[str, ...]
    share: float


def compare_frames(model: DesignModel, sample: Array, box_m: Array, count: Count) -> FrameFinding:
    """Say where a scan is, seen from a model.

    Args:
        model: the design.
        sample: [P][3] some points of the whole scan.
        box_m: [2][3] the bounding box of the members.
        count: of points [P][3] in the model's coordinates, those that are near a member.
    """
    as_it_is = count(sample)
    conversion = model.map_conversion
    on_map = count(conversion.to_model(sample)) if conversion is not None else Hits(0.0, 0)
    best = max(as_it_is.weight, on_map.weight)
    found = _changes(sample, conversion, count)
    if found[1].weight > CLEARLY * best:
        return FrameFinding("elsewhere", (found[0],), as_it_is.share)
    if best == 0:
        return FrameFinding("elsewhere", _apart(model, sample, box_m, as_it_is.share), 0.0)
    if on_map.weight > as_it_is.weight:
        there = "in map coordinates: the model's map conversion leads there (fit --map)"
        return FrameFinding("map", (there,), on_map.share)
    few = as_it_is.share < LEAST_SHARE
    return FrameFinding("model", _apart(model, sample, box_m, as_it_is.share) if few else (), as_it_is.share)


def sure_change(model: DesignModel, sample: Array, count: Count) -> tuple[str, float]:
    """Return what a scan's coordinates have to be, as a sentence, and the share of points it brings near some member.

    The sentence is empty unless the scan as it is has next to nothing to do with the model.

    Args:
        model: the design.
        sample: [P][3] some points of the whole scan.
        count: of points [P][3] in the model's coordinates, those that are near a member.
    """
    conversion = model.map_conversion
    best = count(sample).weight
    if conversion is not None:
        best = max(best, count(conversion.to_model(sample)).weight)
    sentence, changed = _changes(sample, conversion, count)
    sure = changed.share >= SURE_SHARE and changed.weight > SURELY * best
    return (sentence, changed.share) if sure else ("", 0.0)


def _changes(sample: Array, conversion: MapConversion | None, count: Count) -> tuple[str, Hits]:
    """Return the one change of the coordinates that fits best, as a sentence."""
    tried: list[tuple[str, Hits]] = []
    frames: list[tuple[str, Callable[[Array], Array]]] = [("", lambda points: points)]
    if conversion is not None:
        frames.append((" and the map conversion taken back", conversion.to_model))
    for after, back in frames:
        for unit, factor in UNITS.items():
            text = f"it seems to be in {unit}: times {factor:.4g}{after} it would be where the model is"
            tried.append((text + coordinates.how_to_say(unit), count(back(sample * factor))))
        for swap, M in SWAPS.items():
            text = f"it seems to have {swap}: turned{after} it would be where the model is"
            tried.append((f"{text} (export it again with the model's axes)", count(back(sample @ M.T))))
    return max(tried, key=lambda one: one[1].weight)


def _apart(model: DesignModel, sample: Array, box_m: Array, share: float) -> tuple[str, ...]:
    """Say how far a scan is from a model, or how different in size."""
    out = []
    low, high = np.quantile(sample, 0.01, axis=0), np.quantile(sample, 0.99, axis=0)
    gap = np.maximum(np.maximum(box_m[0] - high, low - box_m[1]), 0.0)
    distance = float(np.linalg.norm(gap))
    if distance >= FAR_M:
        far = f"{distance / 1000:.0f} km" if distance >= 10_000 else f"{distance / 1000:.1f} km"
        why = (
            "its map conversion doesn't lead there"
            if model.map_conversion is not None
            else "the model has no map conversion: is one of them in map coordinates?"
        )
        out.append(f"it is {far} from the model, and {why}")
    elif distance > 0:
        out.append(f"it is {distance:.1f} m from the model's elements (linear-ik align finds the motion between them)")
    elif share < LEAST_SHARE:
        out.append(
            f"it is around the model, but only {100 * share:.1f} % of its points are near an element "
            "(linear-ik align finds the motion between them)"
        )
    sizes = np.linalg.norm(high - low), np.linalg.norm(box_m[1] - box_m[0])
    ratio = float(sizes[0] / sizes[1])
    if ratio >= LARGE or ratio <= 1 / LARGE:
        out.append(
            f"it is {sizes[0]:.3g} m large, the model {sizes[1]:.3g} m: is one of them in another unit, such as mm?"
        )
    return tuple(out)
