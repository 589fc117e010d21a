"""Quality: how well a scan lies on a design.

A face counts only for points that can have been measured on it. The top of a slab and its
underside are alike but for that: a floor that is laid on the underside would be seen through
the slab. The members' points count apart from those of the other bodies: a floor has many
times more of them, and says nothing but its height.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.target import Target

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

TIGHT_M = 0.02  # within it a point is explained
LOOKS_DOWN = -0.9  # z of a normal
BELOW_M = 0.1  # whoever looks up at a face stands so much lower, at least
STRAYS = 0.005  # share of the points that may lie too low


class Cloud(NamedTuple):
    """Points of a scan, at most one a voxel.

    Attributes:
        points: [P][3].
        stations: [P][3] where each was measured from, NaN where that is unknown.
        spacing_m: edge of a voxel.
    """

    points: Array
    stations: Array
    spacing_m: float


class Quality(NamedTuple):
    """How well a scan lies on a design.

    Attributes:
        rms_m: of the scan points within 20 mm of the design's faces.
        scan_share: of the scan points that are, and can have been measured there.
        model_share: of the design's faces that the scan shows.
        score: harmonic mean of both shares, each averaged with what it is for the members alone.
    """

    rms_m: float
    scan_share: float
    model_share: float
    score: float


def share_within(target: Target, scan: Array, T_target_scan: Array, distance_m: float) -> float:  # noqa: N803
    """Return the share of the scan's points [P][3] that are so near to the design's faces."""
    return float((distances(target, scan, T_target_scan) < distance_m).mean())


def distances(target: Target, scan: Array, T_target_scan: Array) -> Array:  # noqa: N803
    """Return how far the scan's points [P][3] are from the design's faces [P]."""
    points = moved(scan, T_target_scan)
    return np.asarray(np.linalg.norm(points - target.closest(points)[0], axis=1))


def quality(target: Target, cloud: Cloud, T_target_scan: Array, within_m: float = TIGHT_M) -> Quality:  # noqa: N803
    """Return how well a scan lies on the design; a point within ``within_m`` of a face is on it."""
    from scipy.spatial import cKDTree

    points, stations = moved(cloud.points, T_target_scan), moved(cloud.stations, T_target_scan)
    lowest = float(np.quantile(points[:, 2], STRAYS))
    closest, normals, faces = target.closest(points)
    distance = np.linalg.norm(points - closest, axis=1)
    near = (distance < within_m) & _can_be_seen(points, stations, normals, target.one_sided[faces], lowest)
    rms = float(np.sqrt((distance[near] ** 2).mean())) if near.any() else float("nan")
    scan_share = float(near.mean())
    beside = ~near | target.of_member[faces]  # neither of them is on another body
    members_of_scan = float(near[beside].mean()) if beside.any() else 0.0

    found, places = cKDTree(points).query(target.samples, distance_upper_bound=1.5 * cloud.spacing_m)
    gap, nearest = np.asarray(found, dtype=np.float64), np.asarray(places, dtype=np.intp)
    shown = np.isfinite(gap)
    k, normals = nearest[shown], target.normals[shown]
    off = np.abs(np.einsum("ij,ij->i", points[k] - target.samples[shown], normals))
    one_sided = target.one_sided[target.sample_faces[shown]]
    shown[shown] = (off < within_m) & _can_be_seen(points[k], stations[k], normals, one_sided, lowest)
    model_share = float(shown.mean())
    of_member = target.of_member[target.sample_faces]
    members_of_model = float(shown[of_member].mean()) if of_member.any() else model_share
    if not of_member.any():
        members_of_scan = scan_share
    a, b = (scan_share + members_of_scan) / 2, (model_share + members_of_model) / 2
    return Quality(rms, scan_share, model_share, 2 * a * b / (a + b) if a + b else 0.0)


def moved(points: Array, T: Array) -> Array:  # noqa: N803
    """Return points [P][3] after a motion [4][4]."""
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _can_be_seen(points: Array, stations: Array, normals: Array, one_sided: Flags, lowest: float) -> Flags:
    """Say of each point [P] whether it can have been measured on a face with that outward normal.

    From the outside only. Without a station: who looks up at a face stands on something, and a scan shows that.
    """
    with np.errstate(invalid="ignore"):
        behind = np.einsum("ij,ij->i", normals, stations - points) < 0
    unknown = np.isnan(stations[:, 0])
    behind[unknown] = (normals[unknown, 2] < LOOKS_DOWN) & (points[unknown, 2] < lowest + BELOW_M)
    return np.asarray(~(behind & one_sided))
