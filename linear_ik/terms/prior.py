"""Prior: where no point says otherwise, a member is as it was designed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]


def prior(x: Array, mean: Array, information: Array) -> Objective:
    """Return ``1/2 sum_i information_i (x_i - mean_i)^2`` about the current x [n].

    Args:
        x: variables.
        mean: [n] expected values.
        information: [n] inverse variances, in the unit of the point residual's weights.
    """
    return Objective(np.diag(information), information * (x - mean))
