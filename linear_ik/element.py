"""Element: what was designed, before anybody scanned it."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from linear_ik.design_axis import DesignAxis, Points, check_axis_points, follow, polyline_length_m, straight_axis
from linear_ik.errors import ElementError
from linear_ik.outline import as_float
from linear_ik.profile import Profile
from linear_ik.taper import between, check_taper

Array = npt.NDArray[np.float64]
Start = Literal["fixed", "pinned", "roller", "free"]
End = Literal["free", "roller", "pinned", "fixed"]

MOST_SEGMENTS = 500
SEGMENTS = 10  # where nobody says another number
LONGEST_M = 1e5
FARTHEST_M = 1e8
MOST_OF_LENGTH = 0.25  # that the length's tolerance may be


@dataclass(frozen=True)
class Placement:
    """Where the element was designed to stand (IfcAxis2Placement3D).

    Attributes:
        location: start node, metres, in the scan's coordinates.
        axis: from start to end, the element's local Z; any length above 0.
        ref_direction: local X, made orthogonal to ``axis``. When None, IFC's default:
            the scan's X, or its Y where the axis runs along X.
    """

    location: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    ref_direction: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Check the vectors.

        Raises:
            ElementError: not three finite numbers, a zero axis, parallel directions.
        """
        object.__setattr__(self, "location", _vector("placement.location", self.location, FARTHEST_M))
        object.__setattr__(self, "axis", _vector("placement.axis", self.axis))
        if self.ref_direction is not None:
            object.__setattr__(self, "ref_direction", _vector("placement.ref_direction", self.ref_direction))
        if not _norm(self.axis) > 1e-9:
            raise ElementError("placement.axis", f"{list(self.axis)} has no length", "a direction")
        if self.ref_direction is not None:
            if not _norm(self.ref_direction) > 1e-9:
                raise ElementError(
                    "placement.ref_direction", f"{list(self.ref_direction)} has no length", "a direction"
                )
            sine = (
                np.linalg.norm(np.cross(self.axis, self.ref_direction)) / _norm(self.axis) / _norm(self.ref_direction)
            )
            if sine < 1e-6:
                raise ElementError(
                    "placement.ref_direction",
                    f"{list(self.ref_direction)} is parallel to axis",
                    "a direction across it",
                )

    @cached_property
    def T_world_element(self) -> Array:  # noqa: N802 (T_target_source, as small_gicp names transforms)
        """The element's frame [4][4] in the scan's coordinates."""
        z = np.array(self.axis) / _norm(self.axis)
        if self.ref_direction is not None:
            ref = np.array(self.ref_direction)
        else:
            ref = np.array([1.0, 0.0, 0.0] if np.hypot(z[1], z[2]) > 1e-6 else [0.0, 1.0, 0.0])
        x = ref / np.linalg.norm(ref)
        # Twice: the first pass leaves rounding errors that a nearly parallel reference magnifies.
        for _ in range(2):
            x = x - (x @ z) * z
            x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, self.location
        return T


@dataclass(frozen=True)
class PlacementTolerance:
    """How far a free start may have moved from the placement, each way on each axis.

    Attributes:
        translation_m: along each axis of the element.
        rotation_deg: about each axis of the element.
    """

    translation_m: float = 0.05
    rotation_deg: float = 2.0

    def __post_init__(self) -> None:
        """Check both bounds; raise ElementError naming the wrong one."""
        for name, largest in (("translation_m", 10.0), ("rotation_deg", 180.0)):
            value = check_number(f"placement_tolerance.{name}", getattr(self, name), 0.0, largest)
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class Element:
    """A designed linear element: a profile along an axis.

    Attributes:
        name: used in files and messages.
        profile: the section, in the element's local X and Y.
        length_m: along the axis; with ``axis_points`` that of the polyline, to 0.1 %.
        segments: rigid links the length is divided into.
        placement: the design position.
        start: support at the first node.
        end: support at the last node.
        joint_limit_deg: largest angle of each joint about its x, y and z, or one for all,
            either way from the designed angle.
        placement_tolerance: what ``start: free`` and the slide of ``start: roller`` allow.
        end_tolerance_m: how exactly a held end keeps its place (1 sigma).
        density_kg_m3: for the inertia in the URDF; steel when not given.
        profile_end: the section at the end of a tapered element, of the type of
            ``profile``, which is then the one at the start; it varies linearly between.
        axis_points: the design axis where it is not straight: a polyline [x, y, z] in the
            element's frame, from [0, 0, 0] on, its start leading towards +Z.
        length_tolerance_m: how far, each way, the as-built length may be from ``length_m``;
            0 takes the designed length as known.
        auto_segments: the fit chooses the number of segments by the scan; ``segments`` is left at its default then.

    Raises:
        ElementError: a value out of its range, named.
    """

    name: str
    profile: Profile
    length_m: float
    segments: int = SEGMENTS
    placement: Placement = field(default_factory=Placement)
    start: Start = "fixed"
    end: End = "free"
    joint_limit_deg: float | Sequence[float] = 45.0
    placement_tolerance: PlacementTolerance = field(default_factory=PlacementTolerance)
    end_tolerance_m: float = 0.005
    density_kg_m3: float = 7850.0
    profile_end: Profile | None = None
    axis_points: Points | None = None
    length_tolerance_m: float = 0.0
    auto_segments: bool = False

    def __post_init__(self) -> None:
        """Check every field and normalise the numbers."""
        if not isinstance(self.name, str) or not self.name.strip():
            raise ElementError("name", f"{self.name!r}", "a name of at least one character")
        if len(self.name) > 200 or any(c < " " or "\ud800" <= c <= "\udfff" for c in self.name):
            raise ElementError("name", "too long, or with control characters", "up to 200 printable characters")
        if not isinstance(self.profile, Profile):
            raise ElementError("profile", f"{self.profile!r}", "a profile, such as Rectangle(0.1, 0.3)")
        if self.profile_end is not None:
            check_taper(self.profile, self.profile_end)
        if not isinstance(self.placement, Placement):
            raise ElementError("placement", reprlib.repr(self.placement), "a Placement")
        if not isinstance(self.placement_tolerance, PlacementTolerance):
            raise ElementError("placement_tolerance", reprlib.repr(self.placement_tolerance), "a PlacementTolerance")
        if isinstance(self.segments, bool) or not isinstance(self.segments, (int, np.integer)):
            raise ElementError("segments", f"{self.segments!r}", f"a whole number, 1 to {MOST_SEGMENTS}")
        if not 1 <= self.segments <= MOST_SEGMENTS:
            raise ElementError("segments", reprlib.repr(self.segments), f"1 to {MOST_SEGMENTS}")
        if not isinstance(self.auto_segments, bool):
            raise ElementError("auto_segments", reprlib.repr(self.auto_segments), "True or False")
        if self.auto_segments and self.segments != SEGMENTS:
            raise ElementError("segments", f"{self.segments} together with auto_segments", "one of the two")
        if self.start not in get_args(Start):
            raise ElementError("start", f"{self.start!r}", "one of " + ", ".join(get_args(Start)))
        if self.end not in get_args(End):
            raise ElementError("end", f"{self.end!r}", "one of " + ", ".join(get_args(End)))
        limits = self.joint_limit_deg
        several = isinstance(limits, (list, tuple, np.ndarray))
        if several and len(limits) != 3:  # type: ignore[arg-type]
            raise ElementError("joint_limit_deg", f"{list(limits)}", "one number, or three: [x, y, z]")  # type: ignore[arg-type]
        values = tuple(
            check_number("joint_limit_deg", v, 0.0, 180.0, open_low=True)
            for v in (limits if several else [limits] * 3)  # type: ignore[union-attr]
        )
        object.__setattr__(self, "segments", int(self.segments))
        object.__setattr__(self, "joint_limit_deg", values)
        for name, low, high in (
            ("length_m", 0.0, LONGEST_M),
            ("end_tolerance_m", 0.0, 1.0),
            ("density_kg_m3", 0.0, 1e5),
        ):
            object.__setattr__(self, name, check_number(name, getattr(self, name), low, high, open_low=True))
        if self.axis_points is not None:
            object.__setattr__(self, "axis_points", check_axis_points(self.axis_points))
            along_m = polyline_length_m(self.axis_points)
            if abs(along_m - self.length_m) > 1e-3 * along_m:
                raise ElementError("length_m", f"{self.length_m:g}", f"{along_m:g}, the length along axis_points")
            object.__setattr__(self, "length_m", along_m)
        object.__setattr__(
            self, "length_tolerance_m", check_number("length_tolerance_m", self.length_tolerance_m, 0.0, LONGEST_M)
        )
        if self.length_tolerance_m > MOST_OF_LENGTH * self.length_m:
            raise ElementError(
                "length_tolerance_m",
                f"{self.length_tolerance_m:g}",
                f"up to a quarter of the length {self.length_m:g}",
            )
        if self.segment_length_m < 1e-4:
            raise ElementError(
                "segments", f"{self.segments} of {self.segment_length_m:g} m", "segments of 0.1 mm or more"
            )

    @property
    def segment_length_m(self) -> float:
        """Length of each segment: along a design axis that is not straight, of its chords."""
        return self.design.segment_length_m

    @cached_property
    def design(self) -> DesignAxis:
        """The chain as designed."""
        if self.axis_points is None:
            return straight_axis(self.length_m, self.segments)
        return follow(self.axis_points, self.segments)

    def with_length(self, length_m: float) -> Element:
        """Return the element with another length, every segment alike: the same angles as designed."""
        if length_m == self.length_m:
            return self
        scale, points = length_m / self.length_m, self.axis_points
        scaled = None if points is None else tuple((scale * x, scale * y, scale * z) for x, y, z in points)
        return replace(self, length_m=length_m, axis_points=scaled, length_tolerance_m=0.0)

    @property
    def is_tapered(self) -> bool:
        """Whether the section varies along the element."""
        return self.profile_end is not None and self.profile_end != self.profile

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Sentences on tolerances of what is held or free anyway: who gave them may expect otherwise."""
        usual, given = PlacementTolerance(), self.placement_tolerance
        out = []
        if self.start in ("fixed", "pinned") and given != usual:
            out.append(f"placement_tolerance has no effect with start: {self.start} (start: free lets it move)")
        if self.start == "roller" and given.rotation_deg != usual.rotation_deg:
            out.append("placement_tolerance.rotation_deg has no effect with start: roller")
        if self.end == "free" and self.end_tolerance_m != Element.end_tolerance_m:
            out.append("end_tolerance_m has no effect with end: free")
        return tuple(out)

    def profile_at(self, share: float) -> Profile:
        """Return the section at ``share`` (0 to 1) of the length."""
        if self.profile_end is None or not self.is_tapered:
            return self.profile
        return between(self.profile, self.profile_end, share)

    def segment_profiles(self, k: int) -> tuple[Profile, Profile | None]:
        """Return the sections at the start and at the end of segment k, counted from 0; None: the same one."""
        if not self.is_tapered:
            return self.profile, None
        return self.profile_at(k / self.segments), self.profile_at((k + 1) / self.segments)

    @property
    def joint_limit_rad(self) -> Array:
        """[3] largest angle about x, y and z, either way from the designed one."""
        return np.radians(np.asarray(self.joint_limit_deg, dtype=np.float64))

    @property
    def joint_limits_rad(self) -> Array:
        """[N][3][2] lower and upper limit of each joint about x, y and z."""
        designed, limit = self.design.angles_rad, self.joint_limit_rad
        return np.stack([designed - limit, designed + limit], axis=-1)


def check_number(name: str, value: object, low: float, high: float, open_low: bool = False) -> float:
    """Return ``value`` as a float within its range, or raise ElementError naming it."""
    expected = f"a number {'above' if open_low else 'from'} {low:g} {'and up ' if open_low else ''}to {high:g}"
    number = as_float(name, value, expected)
    if not low <= number <= high or (open_low and number == low):
        raise ElementError(name, f"{number:g}", expected)
    return number


def _vector(name: str, value: object, largest: float = 1e12) -> tuple[float, float, float]:
    if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != 3:
        raise ElementError(name, f"{value!r}", "three numbers [x, y, z]")
    x, y, z = (check_number(name, v, -largest, largest) for v in value)
    return x, y, z


def _norm(vector: Sequence[float]) -> float:
    return math.sqrt(sum(v * v for v in vector))
