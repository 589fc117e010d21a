"""ModelFitOptions: what a person may choose about the fit of a whole building."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal

import numpy as np
import numpy.typing as npt

from linear_ik.coordinates import metres_of
from linear_ik.element import MOST_SEGMENTS
from linear_ik.errors import SettingsError
from linear_ik.rigid import check_rigid

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
        only: GlobalIds, or tags or names that one element has; all when empty.
        classes: such as IfcBeam; all when empty.
        scan_unit: of the files' numbers: m, mm, cm, in, ft or us-ft; None: metres, unless a file says otherwise.
        T_model_scan: [4][4] takes the scan, in metres, into the model's coordinates; None where it is in them.
        map_coordinates: the scan is in the map's coordinates of the design's map conversion.
        legend_m: deviation at either end of the colours.
        contest: whether neighbours compete for points.
        overwrite: replace files in the folder that no run of this design wrote.

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
    scan_unit: str | None = None
    T_model_scan: Array | None = None
    map_coordinates: bool = False
    legend_m: float = 0.02
    contest: bool = True
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check every field; numbers of NumPy become Python's, which JSON knows."""
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
            object.__setattr__(self, name, (int if whole else float)(getattr(self, name)))
        for name in ("map_coordinates", "contest", "overwrite"):
            value = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise SettingsError(name, f"{value!r}", "True or False")
            object.__setattr__(self, name, bool(value))
        try:
            metres_of("m" if self.scan_unit is None else self.scan_unit)
        except SettingsError as error:
            raise error.about("scan_unit") from None
        if self.T_model_scan is not None:
            object.__setattr__(self, "T_model_scan", check_rigid("T_model_scan", self.T_model_scan))
            if self.map_coordinates:
                raise SettingsError("map_coordinates", "given together with T_model_scan", "one of the two")
