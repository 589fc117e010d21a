"""ModelFitOptions: what a person may choose about the fit of a whole building."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal

import numpy as np
import numpy.typing as npt

from linear_ik.element import MOST_SEGMENTS
from linear_ik.errors import SettingsError

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModelFitOptions:
    """Options of one run; the fit of each element has its own FitSettings.

    Attributes:
        workers: processes; None for one a core, 0 to fit in this process.
        scheduler: address of a Dask scheduler, such as tcp://host:8786, in place of ``workers``.
        memory_mb: most memory for points on their way to the elements.
        max_points: of one element; where there are more, as many of every stretch of its length.
        reach_m: how far an element's points may be from its designed surface, its placement
            tolerance apart.
        segments: of every element, in place of the design's; "auto": as many as its scan asks for.
        length_tolerance_m: of every element, in place of its own 0: how far its length may be from the design's.
        only: GlobalIds; all when empty.
        classes: such as IfcBeam; all when empty.
        T_model_scan: [4][4] takes the scan into the model's coordinates; None where it is in them.
        map_coordinates: the scan is in the map's coordinates of the design's map conversion.
        legend_m: deviation at either end of the colours.
        contest: whether neighbours compete for points.

    Raises:
        SettingsError: a value out of its range, named.
    """

    workers: int | None = None
    scheduler: str | None = None
    memory_mb: float = 512.0
    max_points: int = 100_000
    reach_m: float = 0.15
    segments: int | Literal["auto"] | None = None
    length_tolerance_m: float | None = None
    only: Sequence[str] = ()
    classes: Sequence[str] = ()
    T_model_scan: Array | None = None
    map_coordinates: bool = False
    legend_m: float = 0.02
    contest: bool = True

    def __post_init__(self) -> None:
        """Check every field."""
        for name, low, high, whole in (
            ("workers", 0, 1000, True),
            ("segments", 1, MOST_SEGMENTS, True),
            ("max_points", 1000, 10**8, True),
            ("memory_mb", 16.0, 1e6, False),
            ("reach_m", 0.0, 10.0, False),
            ("length_tolerance_m", 0.0, 10.0, False),
            ("legend_m", 1e-6, 10.0, False),
        ):
            value = getattr(self, name)
            if name == "segments" and value == "auto":
                continue
            if value is None and name in ("workers", "segments", "length_tolerance_m"):
                continue
            kind: type = Integral if whole else Real
            if isinstance(value, bool) or not isinstance(value, kind) or not low <= value <= high:  # type: ignore[operator]
                what = "a whole number" if whole else "a number"
                raise SettingsError(name, f"{value!r}", f"{what} from {low:g} to {high:g}")
        if self.T_model_scan is not None:
            object.__setattr__(self, "T_model_scan", check_rigid("T_model_scan", self.T_model_scan))
            if self.map_coordinates:
                raise SettingsError("map_coordinates", "given together with T_model_scan", "one of the two")


def check_rigid(name: str, value: object) -> Array:
    """Return a rigid motion [4][4], or raise SettingsError saying what is wrong with it."""
    expected = "4 x 4 numbers: a rotation, a translation in metres, last row 0 0 0 1"
    try:
        T = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(name, "not numbers", expected) from None
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise SettingsError(name, f"shape {T.shape}, or a number that is not finite", expected)
    R = T[:3, :3]
    if not np.allclose(T[3], [0, 0, 0, 1], atol=1e-9):
        raise SettingsError(name, f"last row {T[3].tolist()}", expected)
    # Six digits are what programs print.
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(R) < 0:
        raise SettingsError(name, "its 3 x 3 part is no rotation", expected)
    u, _, vt = np.linalg.svd(R)
    T[:3, :3] = u @ vt
    return T
