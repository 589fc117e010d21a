"""The arguments that every export of a bent element takes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element
from linear_ik.errors import ChainError

Array = npt.NDArray[np.float64]


def check_posed(element: Element, q: npt.ArrayLike, base_pose: npt.ArrayLike) -> tuple[Array, Array]:
    """Return ``q`` [3N] and ``base_pose`` [4][4] as arrays.

    Raises:
        ChainError: another shape, or a value that is not finite.
    """
    angles, pose = np.asarray(q, dtype=np.float64), np.asarray(base_pose, dtype=np.float64)
    for name, value, shape in (("q", angles, (3 * element.segments,)), ("base_pose", pose, (4, 4))):
        if value.shape != shape:
            raise ChainError(name, f"shape {value.shape}", f"{shape} for {element.segments} segments")
        if not np.isfinite(value).all():
            raise ChainError(name, "a value that is not finite", "numbers")
    return angles, pose
