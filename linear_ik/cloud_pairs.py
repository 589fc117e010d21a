"""Cloud pairs: the paper's correspondences, from the model's points to the scan's.

Open3D's point-to-point ICP runs from the model's cloud to the scan's; the pairs it ends
with are the correspondences (paper 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.chain import Pose
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

INNER_TOLERANCE = 1e-6  # paper 3.2: relative fitness and RMSE
INNER_ITERATIONS = 30  # Open3D's own default; the paper gives none


@dataclass(frozen=True, eq=False)
class CloudPairs:
    """Model points matched with scan points, sorted by segment. Element's frame, metres.

    Attributes:
        starts: [N+1] first pair of each segment, and P.
        source: [P][3] points s on the model.
        target: [P][3] points t of the scan.
        distance_m: [P] |t - s|.
    """

    starts: Index
    source: Array
    target: Array
    distance_m: Array

    @property
    def residual_m(self) -> Array:
        """[P] what the loop's cost is made of: the distances."""
        return self.distance_m

    @property
    def counts(self) -> Index:
        """[N] pairs of each segment."""
        return np.diff(self.starts)


class ModelCloud:
    """Points on the faces of every segment, moving with the chain."""

    def __init__(self, surface: Surface, segment_length_m: Array, points: int, seed: int) -> None:
        """Spread about ``points`` points evenly over the segments' lateral faces."""
        rng = np.random.default_rng(seed)
        n = len(segment_length_m)
        each = max(points // n, 1)
        self.segment = np.repeat(np.arange(n), each)
        self.local = surface.sample(each, segment_length_m, rng).reshape(-1, 3)

    def at(self, pose: Pose) -> Array:
        """Return the points [M][3] of the bent chain, element's frame."""
        return np.asarray(
            np.einsum("pij,pj->pi", pose.rotations[self.segment], self.local) + pose.nodes_m[self.segment]
        )


class CloudMatcher:
    """Pairs a model's cloud with a scan by Open3D's registration_icp, point to point."""

    def __init__(self, cloud: ModelCloud, scan_points: Array) -> None:
        """Take the scan once; the model's pose comes with each query."""
        import open3d as o3d

        self._o3d: Any = o3d
        self.cloud, self.points = cloud, scan_points
        self._scan = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan_points))

    def match(self, pose: Pose, threshold_m: float) -> CloudPairs:
        """Return the correspondences within ``threshold_m`` that the inner ICP ends with."""
        registration = self._o3d.pipelines.registration
        source = self.cloud.at(pose)
        model = self._o3d.geometry.PointCloud(self._o3d.utility.Vector3dVector(source))
        found = registration.registration_icp(
            model,
            self._scan,
            threshold_m,
            np.eye(4),
            registration.TransformationEstimationPointToPoint(),
            registration.ICPConvergenceCriteria(INNER_TOLERANCE, INNER_TOLERANCE, INNER_ITERATIONS),
        )
        rows = np.asarray(found.correspondence_set).reshape(-1, 2)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        s, t = source[rows[:, 0]], self.points[rows[:, 1]]
        starts = np.searchsorted(self.cloud.segment[rows[:, 0]], np.arange(pose.n_segments + 1))
        return CloudPairs(starts, s, t, np.linalg.norm(t - s, axis=1))
