"""What may be set of how a design is read."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field

from linear_ik.bim.products import LINEAR_CLASSES, check_classes
from linear_ik.element import MOST_SEGMENTS, PlacementTolerance
from linear_ik.errors import SettingsError


@dataclass(frozen=True)
class DesignSettings:
    """How a design is read.

    Attributes:
        classes: which of LINEAR_CLASSES.
        slenderness: an element is linear if its length is at least this many times the larger
            side of its section. At 3, codes for concrete tell a beam from a deep beam.
        tolerance_m: how far a body may stick out of the element read from it, and an outline be
            from the profile it is taken for.
        segments: of every element; None: one a ``segment_length_m``, within the two limits.
        segment_length_m: about how long a segment is.
        fewest_segments: at least so many.
        most_segments: at most so many.
        placement_tolerance: of every element's start, which is free.
        obstacles: whether the other bodies are read too.
        threads: for the tessellation; None: as many as there are cores.
    """

    classes: tuple[str, ...] = LINEAR_CLASSES
    slenderness: float = 3.0
    tolerance_m: float = 1e-3
    segments: int | None = None
    segment_length_m: float = 0.5
    fewest_segments: int = 10
    most_segments: int = 60
    placement_tolerance: PlacementTolerance = field(default_factory=PlacementTolerance)
    obstacles: bool = True
    threads: int | None = None

    def __post_init__(self) -> None:
        """Check every value; raise SettingsError naming the wrong one."""
        object.__setattr__(self, "classes", check_classes(self.classes))
        for name, least in (("slenderness", 0.0), ("tolerance_m", 1e-6), ("segment_length_m", 1e-3)):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or isinstance(value, bool) or not least <= value < math.inf:
                raise SettingsError(name, repr(value), f"a number from {least:g} up")
        for name, most in (
            ("segments", MOST_SEGMENTS),
            ("fewest_segments", MOST_SEGMENTS),
            ("most_segments", MOST_SEGMENTS),
            ("threads", 1024),
        ):
            number = getattr(self, name)
            if number is None and name in ("segments", "threads"):
                continue
            if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= most:
                raise SettingsError(name, repr(number), f"a whole number, 1 to {most}")
        if self.fewest_segments > self.most_segments:
            raise SettingsError("fewest_segments", str(self.fewest_segments), f"at most {self.most_segments}")

    def segments_for(self, length_m: float) -> int:
        """Return the number of segments of an element so long."""
        if self.segments is not None:
            return self.segments
        return min(max(math.ceil(length_m / self.segment_length_m - 1e-9), self.fewest_segments), self.most_segments)

    @property
    def kernel_threads(self) -> int:
        """Number of threads."""
        return self.threads or os.cpu_count() or 1
