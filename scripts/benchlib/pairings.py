"""Other correspondences for the library's loop: each maker takes a problem and a scan, and returns a pairing.

A pairing is called once an iteration with (problem, pose, stage, i) and returns
`linear_ik.stage.Paired`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik import SimulatedScan
from linear_ik.chain import Pose
from linear_ik.cloud_pairs import CloudPairs, ModelCloud
from linear_ik.correspondence import Correspondences
from linear_ik.problem import Problem
from linear_ik.stage import Paired, Pairing, Stage, on_surface, robust_weights
from linear_ik.uncertainty import noise_of

Array = npt.NDArray[np.float64]

UNWEIGHTED_ITERATIONS = 12
MODEL_POINTS = 10_000
ROBUST_SCALE = 5.0
OPENING_M, DECAY, LEAST_M = 0.3, 0.75, 0.004
GATE_COSINE = 0.5
FEATURE_M = 0.15
NEIGHBOURS = 20


def surface(problem: Problem, scan: SimulatedScan) -> Pairing:
    """Nearest face, point to plane: unweighted first, then robustly by the noise found."""

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        pairs = problem.matcher.match(pose, stage.points)
        return Paired(pairs, settled_weights(pairs.distance_m, noise_of(pairs), i), np.inf)

    return pair


def annealed(problem: Problem, scan: SimulatedScan) -> Pairing:
    """Nearest face, weighed by a scale that shrinks from 0.3 m by a quarter an iteration."""

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        scale_m = max(OPENING_M * DECAY**i, LEAST_M)
        return on_surface(problem, pose, replace(stage, scales_m=(scale_m,)), 0)

    return pair


def gated(problem: Problem, scan: SimulatedScan) -> Pairing:
    """Nearest face, but only where its normal is within 60 degrees of the point's true one.

    Raises:
        ValueError: the problem left out points, so that the normals are not those of its points.
    """
    T = problem.element.placement.T_world_element
    points = (scan.points - T[:3, 3]) @ T[:3, :3]
    # The problem leaves out points beyond the element's reach; the ablation's scans have none.
    if len(points) != len(problem.points):
        raise ValueError(f"{len(points) - len(problem.points)} points beyond the element's reach: expected none")
    normals = scan.surface_normals @ T[:3, :3]

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        pairs = problem.matcher.match(pose, stage.points)
        faces = np.einsum("pia,pa->pi", pose.rotations[pairs.segment][:, :, :2], pairs.gradient)
        agree = np.einsum("pi,pi->p", faces, normals[pairs.order]) > GATE_COSINE
        return Paired(pairs, settled_weights(pairs.distance_m, noise_of(pairs), i) * agree, np.inf)

    return pair


def foot_points(problem: Problem, scan: SimulatedScan) -> Pairing:
    """Nearest point of the surface, point to point: it holds a point where it happens to lie along the face."""

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        pairs = problem.matcher.match(pose, stage.points)
        foot = pairs.local.copy()
        foot[:, :2] -= pairs.residual_m[:, None] * pairs.gradient
        length = problem.chain.segment_length_m[pairs.segment]
        foot[:, 2] = np.clip(foot[:, 2], 0.0, length)
        R, start = pose.rotations[pairs.segment], pose.nodes_m[pairs.segment]
        source = np.einsum("pij,pj->pi", R, foot) + start
        matched = CloudPairs(pairs.starts, source, stage.points[pairs.order], pairs.distance_m)
        return Paired(matched, settled_weights(pairs.distance_m, noise_of(pairs), i), np.inf)

    return pair


def model_to_scan(problem: Problem, scan: SimulatedScan) -> Pairing:
    """The nearest scan point of each point of the model, point to the model's plane."""
    model, tree = ModelSamples(problem), _tree(problem.points)

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        distance, row = tree.query(model.at(pose))
        target = stage.points[row]
        local = np.einsum("pji,pj->pi", pose.rotations[model.segment], target - pose.nodes_m[model.segment])
        residual = np.einsum("pi,pi->p", local[:, :2] - model.local[:, :2], model.normals)
        pairs = Correspondences(row, model.starts, model.edge, local, residual, model.normals, distance)
        return Paired(pairs, settled_weights(np.abs(residual), noise_of(pairs), i), np.inf)

    return pair


def model_to_scan_points(problem: Problem, scan: SimulatedScan) -> Pairing:
    """The nearest scan point of each point of the model, point to point."""
    model, tree = ModelSamples(problem), _tree(problem.points)

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        source = model.at(pose)
        distance, row = tree.query(source)
        return Paired(CloudPairs(model.starts, source, stage.points[row], distance), np.ones(len(row)), np.inf)

    return pair


def geometric_features(problem: Problem, scan: SimulatedScan) -> Pairing:
    """The scan point nearest in place, normal and curvature: what GF-ICP adds, for the paper's loop.

    Normals and curvature (the surface variation of 20 neighbours) are estimated on the
    scan; its normals have no sign, so each point is offered with both. The model's own
    are exact. A unit of either counts as 150 mm.
    """
    model = ModelSamples(problem)
    normals, variation = _estimated(problem.points)
    points = np.concatenate([problem.points, problem.points])
    features = np.column_stack(
        [points, FEATURE_M * np.concatenate([normals, -normals]), FEATURE_M * np.tile(variation, 2)]
    )
    tree = _tree(features)

    def pair(problem: Problem, pose: Pose, stage: Stage, i: int) -> Paired:
        source = model.at(pose)
        across = np.einsum("pia,pa->pi", pose.rotations[model.segment][:, :, :2], model.normals)
        flat = np.zeros((len(source), 1))
        _, row = tree.query(np.column_stack([source, FEATURE_M * across, flat]))
        target = points[row]
        distance = np.linalg.norm(target - source, axis=1)
        return Paired(CloudPairs(model.starts, source, target, distance), np.ones(len(row)), np.inf)

    return pair


class ModelSamples(ModelCloud):
    """The paper's cloud on the model, with the face and the normal of each of its points."""

    def __init__(self, problem: Problem) -> None:
        """Spread `MODEL_POINTS` of them evenly."""
        super().__init__(problem.surface, problem.chain.segment_length_m, MODEL_POINTS, 0)
        n = problem.element.segments
        self.starts = np.searchsorted(self.segment, np.arange(n + 1))
        straight = problem.chain.pose(problem.designed)
        pairs = problem.matcher.match(straight, self.at(straight))
        self.edge, self.normals = np.empty_like(pairs.face), np.empty_like(pairs.gradient)
        self.edge[pairs.order], self.normals[pairs.order] = pairs.face, pairs.gradient


def settled_weights(distance_m: Array, noise_m: float, i: int) -> Array:
    """Return ones for the first iterations, then robust weights by the noise."""
    if i < UNWEIGHTED_ITERATIONS:
        return np.ones(len(distance_m))
    return robust_weights(distance_m, ROBUST_SCALE * noise_m)


def _tree(points: Array) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _estimated(points: Array) -> tuple[Array, Array]:
    """Return unsigned normals [P][3] and the surface variation [P], 0 on a plane and 1/3 at most."""
    _, rows = _tree(points).query(points, k=NEIGHBOURS)
    patches = points[rows] - points[rows].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("pki,pkj->pij", patches, patches))
    return vectors[:, :, 0], values[:, 0] / values.sum(axis=1)
