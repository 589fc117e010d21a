"""Sights: from where each point of a cloud was seen.

A scanner sees no face that looks away from it. Where stations are known this tells the
two sides of a plate apart, which points alone cannot where the plate is as thin as
their noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

# Any three numbers without a common measure: points on a grid, too, get keys of their own.
KEY = (1.0, np.sqrt(2.0), np.pi)


@dataclass(frozen=True, eq=False)
class Sights:
    """Stations of the points of one cloud, found again by the points' own coordinates.

    The stages of a fit hand subsets of the cloud around as bare coordinates; those are
    copied, never changed, so that they tell which points they are.

    Attributes:
        stations: [S][3] in the frame of the points.
        keys: [P] sorted; one of each point.
        seen_from: [P] row of ``stations`` in the order of the keys.
    """

    stations: Array
    keys: Array
    seen_from: Index

    @classmethod
    def of(cls, points: Array, stations: Array, station_index: npt.NDArray[np.int32]) -> Sights:
        """Remember which station [S][3] saw each point [P][3]."""
        if len(stations) == 1:
            return cls(stations, np.zeros(0), np.zeros(0, dtype=np.intp))
        keys = _keys(points)
        order = np.argsort(keys, kind="stable")
        return cls(stations, keys[order], station_index[order].astype(np.intp))

    def stations_of(self, points: Array) -> Array:
        """Return the station [P][3] that saw each point [P][3] of the cloud."""
        if len(self.stations) == 1:
            return np.broadcast_to(self.stations[0], points.shape)
        row = np.minimum(np.searchsorted(self.keys, _keys(points)), len(self.keys) - 1)
        return np.asarray(self.stations[self.seen_from[row]])


def _keys(points: Array) -> Array:
    x, y, z = points.astype(np.float64, copy=False).T
    return np.asarray(KEY[0] * x + KEY[1] * y + KEY[2] * z)
