"""Objective: what one term asks of the step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Objective(NamedTuple):
    """A term's quadratic model ``1/2 dx' H dx + c' dx`` of the step dx.

    Attributes:
        H: [n][n] symmetric, positive semidefinite.
        c: [n] gradient at dx = 0.
    """

    H: Array
    c: Array

    def __add__(self, other: object) -> Objective:
        """Terms add up."""
        if not isinstance(other, Objective):
            return NotImplemented
        return Objective(self.H + other.H, self.c + other.c)

    def of(self, variables: npt.NDArray[np.intp]) -> Objective:
        """Return what the term says of some variables, the others held."""
        return Objective(self.H[np.ix_(variables, variables)], self.c[variables])

    def mean_information(self) -> float:
        """Return the mean of H's diagonal over the variables it says anything about."""
        diagonal = np.diag(self.H)
        told = diagonal[diagonal > 0]
        return float(told.mean()) if len(told) else 0.0
