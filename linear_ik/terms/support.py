"""Support: what holds the element's end, as stiff terms of the step."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.element import Element
from linear_ik.terms.objective import Objective

Array = npt.NDArray[np.float64]


def end_support(element: Element, pose: Pose, weight: float, end_m: Array | None = None) -> Objective:
    """Return the pull of the end support towards its place in the design.

    roller: the end node stays on the design axis where that ends (2 equations); pinned: it stays within
    ``end_tolerance_m`` of the design end (3); fixed: the last segment also keeps the
    design direction, to the angle that the tolerance makes over its length (5).
    With r the violations and A their Jacobian the term is
    ``1/2 weight |A dx + r|^2 / end_tolerance_m^2``.

    Args:
        element: the design, its end held; its frame is the pose's.
        pose: the chain now.
        weight: [cost]; the variance a residual of one tolerance is worth.
        end_m: [3] where the end is held; None: where the element's own design ends.

    Returns:
        The term over all variables [6 + 3N].
    """
    # Seen from the last segment as designed, so that Z is its direction.
    designed = element.design.rotations[-1].T
    rows = 2 if element.end == "roller" else 3
    A = (designed @ pose.node_jacobians()[-1])[:rows]
    held_m = element.design.nodes_m[-1] if end_m is None else end_m
    r = (designed @ (pose.nodes_m[-1] - held_m))[:rows]
    if element.end == "fixed":
        z = pose.rotations[-1, :, 2]
        # d z = w x z: the last segment's direction turns with its angular velocity.
        turn = (designed @ np.cross(pose.J[3:].T, z).T)[:2]
        A = np.concatenate([A, element.segment_length_m * turn])
        r = np.concatenate([r, element.segment_length_m * (designed @ z)[:2]])
    scale = weight / element.end_tolerance_m**2
    return Objective(scale * (A.T @ A), scale * (A.T @ r))
