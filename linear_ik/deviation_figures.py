"""Deviation figures: vectors made from a member's nodes, and the longest of several, with 95 % bands.

The largest figure f_k of several has the band ``max(f_k + U_k) - max(f_k)``, with the bands U_k of
all of them: none reaches beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik.deviation_bands import Bands

Array = npt.NDArray[np.float64]

NO_EFFECT = 1e-9  # of a node on a sum, its coefficient: what rounding leaves of 0
LARGEST = "the largest of all {}, its band as far as any of them reaches: noise alone makes it more than 0"


@dataclass(frozen=True)
class Figure:
    """One number to judge by.

    Attributes:
        value: metres, radians or 1/m as the name of its field says; None where it says nothing.
        band: half-width of its 95 % band, same unit; None where the value is.
        node: the node nearest to where it was found (a segment, from 1, for slopes), or None for the whole member.
        note: why there is no value, or how to read it; may be empty.
        s_m: where it was found, distance from the start along the chain; None for the whole member.
    """

    value: float | None
    band: float | None
    node: int | None = None
    note: str = ""
    s_m: float | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """A figure along the member, in two axes.

    Attributes:
        s_m: [K] distance from the start along the chain.
        xy: [K][2] values in local X and Y.
        band: [K][2] half-widths of their 95 % bands, each by itself.
    """

    s_m: Array
    xy: Array
    band: Array


@dataclass(frozen=True, eq=False)
class Sums:
    """Vectors along a member, each a sum over its nodes.

    Attributes:
        bands: covariances of the nodes.
        rows: [K][N+1] coefficients that make each vector.
        vectors: [K][3].
        axes: [K][A][3] directions that a vector without length may have.
        places: [K] where each is, in segments from the start.
        step_m: length of a segment.
    """

    bands: Bands
    rows: Array
    vectors: Array
    axes: Array
    places: Array
    step_m: float

    @classmethod
    def of(cls, bands: Bands, rows: Array, vectors: Array, axes: Array, places: Array, step_m: float) -> Sums:
        """Return sums that all have the same axes [A][3]."""
        return cls(bands, rows, vectors, np.broadcast_to(axes, (len(rows), *axes.shape)), places, step_m)

    def lengths(self) -> tuple[Array, Array]:
        """Return the length of each vector [K], and its band along it [K]; of none, the widest along its axes."""
        length = np.linalg.norm(self.vectors, axis=1)
        band = self.bands.of_rows(self.rows, self.vectors / np.where(length > 0.0, length, 1.0)[:, None])
        none = np.flatnonzero(length == 0.0)
        if len(none):
            count = self.axes.shape[1]
            widest = self.bands.of_rows(np.repeat(self.rows[none], count, axis=0), self.axes[none].reshape(-1, 3))
            band[none] = widest.reshape(-1, count).max(axis=1)
        return length, band

    def largest(self, of_what: str, along: Array | None = None) -> Figure:
        """Return the longest of the vectors.

        Args:
            of_what: what there are several of, in words, for the note.
            along: [3] unit direction whose sign the value takes; None: it is a length.
        """
        # Ends have no offset from their own chord: not a figure, and no band.
        free = np.flatnonzero(np.abs(self.rows).max(axis=1, initial=0.0) > NO_EFFECT)
        if not len(free):
            return Figure(None, None, None, "one segment cannot bend")
        length, band = self.lengths()
        k = int(free[length[free].argmax()])
        value = float(length[k]) if along is None else float(self.vectors[k] @ along)
        # What is less far out but less well known may be the farthest: the limit must hold for it too.
        reach = float((length + band)[free].max() - length[k])
        at = float(self.places[k])
        # Upwards from a half: the middle of the first segment is that of number 1.
        return Figure(value, reach, int(at + 0.5), LARGEST.format(of_what), self.step_m * at)


def length_of(bands: Bands, row: Array, vector: Array, axes: Array, node: int | None = None) -> Figure:
    """Return the length of a vector [3] with its band along it; of none, the widest along the axes [A][3]."""
    length, band = Sums.of(bands, row, vector[None], axes, np.zeros(1), 0.0).lengths()
    return Figure(float(length[0]), float(band[0]), node)


def both(bands: Bands, rows: Array, axes: Array) -> Array:
    """Return the half-widths [K][2] of rows of coefficients along both axes."""
    return np.stack([bands.of_rows(rows, np.tile(axis, (len(rows), 1))) for axis in axes], axis=-1)
