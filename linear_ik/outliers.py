"""Outliers: points without company, removed before a fit where that is asked for."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NEIGHBOURS = 20
DEVIATIONS = 2.0


def without_outliers(points: Array) -> Array:
    """Return the points [P][3] whose neighbours are about as near as other points' are.

    Open3D's statistical outlier removal: the mean distance to 20 neighbours is at most 2
    standard deviations above its mean over all points. One threshold for the whole cloud,
    so that a sparse end of a scan may go too.
    """
    import open3d as o3d

    if len(points) <= NEIGHBOURS:
        return points
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    _, kept = cloud.remove_statistical_outlier(NEIGHBOURS, DEVIATIONS)
    return points[np.asarray(kept, dtype=np.intp)]
