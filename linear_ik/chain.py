"""Kinematic chain: a URDF of spherical-jointed segments on a base that may move.

The only module that knows Pinocchio. The chain's variables are

    x = [base translation x, y, z | base rotation z, y, x | (z, y, x) of segment 1 | ...]

[6 + 3N], the base as a composite joint in front of the URDF's own (Pinocchio's q of the
URDF alone is ``x[6:]``). Supports are boxes: a support that holds a base variable gives
it equal bounds. Everything is in the element's frame, metres and radians.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linear_ik.element import Element
from linear_ik.errors import ChainError
from linear_ik.urdf import generate_urdf

Array = npt.NDArray[np.float64]

BASE = 6
SEGMENTS_A_PIECE = 10


class _Piece(NamedTuple):
    """Some segments of the chain as a Pinocchio model of their own.

    Pinocchio's Data holds tensors cubic in the number of joints: 2 GB at 100 segments,
    and none to be had at 500. Pieces cost what they are long, and compose exactly.
    """

    model: pin.Model
    data: pin.Data
    columns: slice
    last_joints: range


def _pieces(whole: pin.Model) -> Iterator[_Piece]:
    first = 1
    while first < whole.njoints:
        count = 3 * SEGMENTS_A_PIECE + (first == 1)
        piece, parent = pin.Model(), 0
        for j in range(first, min(first + count, whole.njoints)):
            parent = piece.addJoint(parent, whole.joints[j], whole.jointPlacements[j], whole.names[j])
        start = whole.joints[first].idx_v
        last_joints = range(4 if first == 1 else 3, piece.njoints, 3)
        yield _Piece(piece, pin.Data(piece), slice(start, start + piece.nv), last_joints)
        first += count


def _along_z(model: pin.Model) -> bool:
    """Whether joints turn about z, y and x in one place, then again farther along Z, up to the end."""
    end = model.frames[model.getFrameId("end")]
    places = [model.jointPlacements[j] for j in range(2, model.njoints)] + [end.placement]
    steps = np.array([T.translation for T in places])
    at_nodes = np.arange(len(steps)) % 3 == 0
    at_nodes[0] = False
    return (
        [*model.parents[2:], end.parentJoint] == list(range(1, model.njoints))
        and all(model.joints[j].shortname() == f"JointModelR{'XZY'[(j - 1) % 3]}" for j in range(2, model.njoints))
        and all((T.rotation == np.eye(3)).all() for T in places)
        and not steps[:, :2].any()
        and not steps[~at_nodes].any()
    )


@dataclass(frozen=True, eq=False)
class Pose:
    """A chain at one configuration.

    Attributes:
        rotations: [N][3][3] orientation of each segment, R_element_segment.
        nodes_m: [N+1][3] start of each segment, and the tip.
        J: [6][6 + 3N] spatial Jacobian of every joint about the element's origin,
            linear part first. A point p fixed to segment k moves with
            ``v = J[:3] + J[3:] x p`` summed over the columns up to segment k's.
    """

    rotations: Array
    nodes_m: Array
    J: Array

    @property
    def n_segments(self) -> int:
        """Number of segments."""
        return len(self.rotations)

    def segment_jacobian(self, k: int) -> Array:
        """Return the spatial frame Jacobian [6][6 + 3N] of segment k, counted from 1.

        Linear part first, expressed in and about the element's frame (Pinocchio's WORLD).
        """
        J = self.J.copy()
        J[:, BASE + 3 * k :] = 0.0
        return np.asarray(J)

    def length_jacobian(self) -> Array:
        """Return d nodes / d length [N+1][3] of a chain whose shape is held: a node slides along it by its share."""
        along = self.rotations[:, :, 2]
        tangents = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
        tangents = tangents / np.maximum(np.linalg.norm(tangents, axis=1), 1e-12)[:, None]
        return np.asarray(np.linspace(0.0, 1.0, len(tangents))[:, None] * tangents)

    def node_jacobians(self) -> Array:
        """Return d nodes / d x [N+1][3][6 + 3N] (paper eq. 3: v_j x (s - p_j))."""
        out = self.J[None, :3] + np.cross(self.J[3:].T[None], self.nodes_m[:, None]).transpose(0, 2, 1)
        # Node k is the end of segment k: it moves with the columns up to that segment.
        columns = (np.arange(self.J.shape[1]) - BASE) // 3
        out *= (columns[None, :] < np.arange(len(self.nodes_m))[:, None])[:, None, :]
        return np.asarray(out)


class Chain:
    """Forward kinematics and Jacobians of an element's URDF.

    Attributes:
        n_segments: N.
        lower, upper: [6 + 3N] the box of the variables.
        segment_length_m: [N].
    """

    def __init__(self, urdf: str, base_lower: npt.ArrayLike = (0.0,) * BASE, base_upper: npt.ArrayLike = (0.0,) * BASE):
        """Load a URDF written by `generate_urdf`, on a base within a box.

        Args:
            urdf: XML text.
            base_lower: [6] lower bounds of translation x, y, z (m) and rotation z, y, x (rad).
            base_upper: [6] upper bounds.

        Raises:
            ChainError: the URDF does not load, or is not a chain of z, y, x joints.
        """
        root = pin.JointModelComposite()
        for joint in (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ):
            root.addJoint(joint())
        for joint in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX):
            root.addJoint(joint())
        try:
            self._model = pin.buildModelFromXML(urdf, root)
        except (ValueError, RuntimeError) as error:
            raise ChainError("urdf", str(error), "the text generate_urdf writes") from None
        joints = list(self._model.names)[2:]
        if not joints or len(joints) % 3 or any(not n.endswith(f"_{'zyx'[i % 3]}") for i, n in enumerate(joints)):
            raise ChainError("urdf", f"joints {joints[:4]}...", "joints segment_01_z, _y, _x, segment_02_z, ...")
        if not self._model.existFrame("end"):
            raise ChainError("urdf", "no frame named end", "the frame of the last node")
        if not _along_z(self._model):
            raise ChainError("urdf", "joints off the chain", "z, y, x at each node, segments along Z")
        self.n_segments = len(joints) // 3
        self._pieces = list(_pieces(self._model))
        first = [self._model.jointPlacements[2 + 3 * k].translation[2] for k in range(1, self.n_segments)]
        tip = self._model.frames[self._model.getFrameId("end")].placement.translation[2]
        self.segment_length_m = np.array([*first, tip])
        self.lower = np.array(self._model.lowerPositionLimit)
        self.upper = np.array(self._model.upperPositionLimit)
        self.lower[:BASE], self.upper[:BASE] = base_lower, base_upper
        if not np.all(self.lower <= self.upper):
            raise ChainError("urdf", "a lower limit above its upper limit", "lower <= upper")

    @classmethod
    def of(cls, element: Element) -> Chain:
        """Return the chain of an element, its start support as the base's box."""
        reach = np.zeros(BASE)
        tolerance = element.placement_tolerance
        if element.start == "free":
            reach[:3] = tolerance.translation_m
            reach[3:] = np.radians(tolerance.rotation_deg)
        elif element.start in ("pinned", "roller"):
            reach[3:] = np.pi
            if element.start == "roller":
                reach[2] = tolerance.translation_m
        return cls(generate_urdf(element), -reach, reach)

    @property
    def nv(self) -> int:
        """Number of variables, 6 + 3N."""
        return int(self._model.nv)

    def pose(self, x: Array) -> Pose:
        """Return the chain's pose at ``x`` [6 + 3N]."""
        rotations, nodes = np.empty((self.n_segments, 3, 3)), np.empty((self.n_segments + 1, 3))
        J = np.empty((6, self.nv))
        T_element_piece, k = pin.SE3.Identity(), 0
        for piece in self._pieces:
            pin.computeJointJacobians(piece.model, piece.data, x[piece.columns])
            J[:, piece.columns] = piece.data.J if k == 0 else T_element_piece.action @ piece.data.J
            for joint in piece.last_joints:
                T = piece.data.oMi[joint] if k < SEGMENTS_A_PIECE else T_element_piece * piece.data.oMi[joint]
                rotations[k], nodes[k] = T.rotation, T.translation
                k += 1
            T_element_piece = pin.SE3(rotations[k - 1], nodes[k - 1])
        nodes[-1] = nodes[-2] + rotations[-1, :, 2] * self.segment_length_m[-1]
        return Pose(rotations, nodes, J)

    def base_pose(self, x: Array) -> Array:
        """Return T_element_base [4][4] at ``x``."""
        first = self._pieces[0]
        pin.forwardKinematics(first.model, first.data, x[first.columns])
        return np.asarray(first.data.oMi[1].homogeneous.copy())

    def bounded(self, lower: Array, upper: Array) -> Chain:
        """Return the chain in another box [6 + 3N]."""
        other = copy(self)
        other.lower, other.upper = lower, upper
        return other

    def at_limits(self, x: Array) -> npt.NDArray[np.bool_]:
        """Return which of the variables that have room in their box are at one of its sides [6 + 3N]."""
        return np.asarray((self.upper > self.lower) & ((x <= self.lower) | (x >= self.upper)))

    def clip(self, x: Array) -> Array:
        """Return ``x`` within the box, exactly."""
        return np.asarray(np.minimum(np.maximum(x, self.lower), self.upper))

    # for those who know only Pinocchio's q of the URDF -------------------------------

    def with_q(self, q: npt.ArrayLike) -> Array:
        """Return the variables [6 + 3N] of Pinocchio's q [3N] on an unmoved base."""
        return np.concatenate([np.zeros(BASE), np.asarray(q, dtype=np.float64)])

    def nodes(self, q: npt.ArrayLike) -> Array:
        """Return the nodes [N+1][3] in the element's frame at Pinocchio's q [3N]."""
        return self.pose(self.with_q(q)).nodes_m

    def segment_poses(self, q: npt.ArrayLike) -> Array:
        """Return T_element_segment [N][4][4] at Pinocchio's q [3N]."""
        pose = self.pose(self.with_q(q))
        T = np.tile(np.eye(4), (self.n_segments, 1, 1))
        T[:, :3, :3], T[:, :3, 3] = pose.rotations, pose.nodes_m[:-1]
        return T
