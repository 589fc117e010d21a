"""Rigid motions that a person gives: checked once, the same way everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.errors import SettingsError

Array = npt.NDArray[np.float64]

EXPECTED = "4 x 4 numbers: a rotation, a translation in metres, last row 0 0 0 1"
ROUNDED = 1e-4  # six digits are what programs print
EXACT = 1e-12


def check_rigid(name: str, value: object) -> Array:
    """Return a rigid motion [4][4], its rotation made exact where it came with few digits.

    Raises:
        SettingsError: about ``name``: another shape, a number that is not finite, no rotation.
    """
    try:
        T = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(name, "not numbers", EXPECTED) from None
    if T.shape != (4, 4):
        raise SettingsError(name, "shape " + "".join(f"[{n}]" for n in T.shape), EXPECTED)
    if not np.isfinite(T).all():
        raise SettingsError(name, "a value that is not finite", EXPECTED)
    if not np.allclose(T[3], [0, 0, 0, 1], rtol=0, atol=1e-9):
        raise SettingsError(name, f"not a rigid motion: last row {T[3].tolist()}", EXPECTED)
    R = T[:3, :3]
    off = np.abs(R @ R.T - np.eye(3)).max()
    if off > ROUNDED or np.linalg.det(R) < 0:
        raise SettingsError(name, "not a rigid motion: its 3 x 3 part is no rotation", EXPECTED)
    if off > EXACT:
        u, _, vt = np.linalg.svd(R)
        T[:3, :3] = u @ vt
    T[3] = 0.0, 0.0, 0.0, 1.0
    return T
