"""Deviation bands: 95 % half-widths of sums over a fitted member's nodes, and of its twist."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from linear_ik.chain import BASE, Chain
from linear_ik.element import Element
from linear_ik.profile import Circle
from linear_ik.result import FitResult

Array = npt.NDArray[np.float64]

BAND_95 = 1.959964  # two-sided 95 % of a normal distribution
NO_LENGTH_M = 1e-12  # rounding has no direction
DRAWS = 4000  # of which 95 % are then 94.3 to 95.7 % of all there are
STEP_RAD = 1e-6  # near the cube root of the rounding, where a difference to both sides is the nearest to a slope


@dataclass(frozen=True, eq=False)
class Bands:
    """Covariances of a result's nodes, in the element's frame.

    Attributes:
        own: [N+1][3][3] of each node.
        joint: [N+1][3][N+1][3] between nodes, or None where the result does not say.
    """

    own: Array
    joint: Array | None

    @classmethod
    def of(cls, result: FitResult, in_step_m: Array | None = None) -> Bands:
        """Return the covariances of a result.

        Args:
            result: of a fit.
            in_step_m: [N+1][3] standard deviation of what the nodes are measured from, all in step.
        """
        R = result.element.placement.T_world_element[:3, :3]
        own, S = R.T @ result.nodes_covariance_m2 @ R, result.configuration_covariance
        if in_step_m is not None:
            own = own + in_step_m[:, :, None] * in_step_m[:, None, :]
        if S is None:
            return cls(own, None)
        # To load a chain takes longer than all else here, and chains of as many segments differ in length alone.
        # That is of the chain: an axis designed curved is longer than its chords.
        fitted, x = result.fitted_element, configuration(result)
        length_m = fitted.segments * fitted.segment_length_m
        x[:3] /= length_m
        pose = _chain_of_length_1(result.element.segments).pose(x)
        A = pose.node_jacobians()
        A[:, :, 3:] *= length_m
        flat = A.reshape(-1, A.shape[2])
        joint = flat @ S @ flat.T
        if in_step_m is not None:
            joint = joint + np.outer(in_step_m, in_step_m)
        if result.length_spread_m:
            slid = result.length_spread_m * pose.length_jacobian().ravel()
            joint = joint + np.outer(slid, slid)
        return cls(own, joint.reshape(len(own), 3, len(own), 3))

    def carried(self, D: Array) -> Bands:
        """Return the covariances of ``D n``, of the nodes n; coefficients D [N+1][N+1].

        Raises:
            ValueError: of a result that does not say how its nodes vary together.
        """
        joint = np.einsum("ka,aibj,lb->kilj", D, self._between(), D, optimize=True)
        return Bands(np.einsum("kikj->kij", joint), joint)

    def projected(self, P: Array) -> Bands:
        """Return the covariances of ``P_k n_k`` of the nodes n_k; matrices P [N+1][3][3]."""
        own = np.einsum("kim,kmn,kjn->kij", P, self.own, P)
        if self.joint is None:
            return Bands(own, None)
        return Bands(own, np.einsum("aim,ambn,bjn->aibj", P, self.joint, P, optimize=True))

    def _between(self) -> Array:
        """Return the covariance between nodes.

        Raises:
            ValueError: a result that does not say.
        """
        if self.joint is None:
            raise ValueError("the result does not say how its nodes vary together")
        return self.joint

    def of_rows(self, rows: Array, directions: Array) -> Array:
        """Return the half-width [K] of ``sum_a rows[k, a] directions[k] . n_a`` for each k.

        Args:
            rows: [K][N+1] coefficients of the nodes.
            directions: [K][3] unit vectors.
        """
        if self.joint is None:
            variance = np.einsum("ki,aij,kj->ka", directions, self.own, directions)
            # A node that does not count may be known as badly as it likes.
            parts = np.where(rows != 0.0, np.abs(rows) * np.sqrt(np.maximum(variance, 0.0)), 0.0)
            return np.asarray(BAND_95 * parts.sum(axis=1))
        flat = (rows[:, :, None] * directions[:, None, :]).reshape(len(rows), 3 * rows.shape[1])
        variance = np.einsum("kf,kf->k", flat @ self.joint.reshape(flat.shape[1], -1), flat)
        return np.asarray(BAND_95 * np.sqrt(np.maximum(variance, 0.0)))

    def largest_of_none(self, rows: Array, axes: Array, between: Array) -> float | None:
        """Return what the longest of some sums of sums stays below in 95 % of scans when all of them are 0.

        By random draws with a fixed seed: of the largest of several figures that vary together
        there is no formula.

        Args:
            rows: [K][N+1] coefficients of the nodes.
            axes: [A][3] directions in which each sum is looked at.
            between: [L][K] coefficients of the sums that make those whose longest is asked for.
        """
        if self.joint is None:
            return None
        at_axes = np.einsum("mi,aibj,nj->ambn", axes, self.joint, axes, optimize=True)
        C = np.tensordot(np.tensordot(rows, at_axes, 1), rows, (2, 1)).transpose(0, 1, 3, 2)
        size = C.shape[0] * C.shape[1]
        values, vectors = np.linalg.eigh(C.reshape(size, size))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = _draws(size) @ root.T
        # Drawn at the sums, of which there are fewer.
        vectors_of = np.moveaxis(drawn.reshape(DRAWS, C.shape[0], C.shape[1]), 0, 2)
        lengths = np.linalg.norm(np.tensordot(between, vectors_of, 1), axis=1).T
        return float(np.quantile(lengths.max(axis=1), 0.95))


@lru_cache(maxsize=8)
def _chain_of_length_1(segments: int) -> Chain:
    return Chain.of(Element("chain", Circle(0.01), 1.0, segments))


@lru_cache(maxsize=8)
def _draws(size: int) -> Array:
    return np.random.default_rng(0).standard_normal((DRAWS, size))


def band_along(vectors: Array, covariance: Array) -> Array:
    """Return the half-width [K] of the band of each vector's length, along it; of none, of the widest direction.

    Args:
        vectors: [K][3].
        covariance: [K][3][3] of each.
    """
    size = np.linalg.norm(vectors, axis=1)
    unit = vectors / np.maximum(size, NO_LENGTH_M)[:, None]
    widest = np.linalg.eigvalsh(covariance)[:, -1]
    variance = np.where(size > NO_LENGTH_M, np.einsum("ki,kij,kj->k", unit, covariance, unit), widest)
    return np.asarray(BAND_95 * np.sqrt(np.maximum(variance, 0.0)))


def configuration(result: FitResult) -> Array:
    """Return the chain's variables [6 + 3N] at a result."""
    T_element_base = np.linalg.inv(result.element.placement.T_world_element) @ result.base_pose
    R = T_element_base[:3, :3]
    turned = [np.arctan2(R[1, 0], R[0, 0]), -np.arcsin(np.clip(R[2, 0], -1.0, 1.0)), np.arctan2(R[2, 1], R[2, 2])]
    return np.concatenate([T_element_base[:3, 3], turned, result.q])


def twist_rad(q: Array) -> float:
    """Return the twist of the last segment against the first, about the axis.

    The sum over the joints between them of the part of each rotation ``R = swing twist`` that is
    about Z, the swing being the smallest rotation that turns the axis; a section carried along a
    bent axis without twist has none.

    Args:
        q: [3N] Pinocchio's configuration, (z, y, x) a segment.
    """
    return float(_twists(q[None])[0])


def twist_band_rad(q: Array, S: Array) -> float:
    """Return the half-width of the twist's 95 % band.

    Args:
        q: [3N] Pinocchio's configuration.
        S: [6 + 3N][6 + 3N] covariance of base and configuration.
    """
    steps = STEP_RAD * np.eye(len(q))
    slope = (_twists(q + steps) - _twists(q - steps)) / (2.0 * STEP_RAD)
    variance = float(slope @ S[BASE:, BASE:] @ slope)
    return BAND_95 * math.sqrt(max(variance, 0.0))


def _twists(q: Array) -> Array:
    """Return the twist [M] of configurations [M][3N]."""
    angles = q.reshape(len(q), -1, 3)[:, 1:]
    z, y, x = angles[:, :, 0], angles[:, :, 1], angles[:, :, 2]
    # R = Rz Ry Rx: of the quaternion, what is about Z and the real part.
    along = np.cos(x / 2) * np.cos(y / 2) * np.sin(z / 2) - np.sin(x / 2) * np.sin(y / 2) * np.cos(z / 2)
    real = np.cos(x / 2) * np.cos(y / 2) * np.cos(z / 2) + np.sin(x / 2) * np.sin(y / 2) * np.sin(z / 2)
    twists: Array = np.arctan2(along, real)
    return np.asarray(2.0 * twists.sum(axis=1))
