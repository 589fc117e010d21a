"""The same chain and the same matches, solved by general tools: scipy's least squares and Pink's inverse kinematics.

They are given what the fit has: its kinematics, its matcher, the analytic derivatives,
and a start from the design. What they lack is the coarse start, the reduction of the
points to moments, and everything that comes after the last step (weights from the
noise, priors, covariance, verdict).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchlib.methods.common import Array, Found, Solve, Task, tubes
from linear_ik.chain import BASE, Chain, Pose
from linear_ik.correspondence import Correspondences, Matcher
from linear_ik.surface import Surface
from linear_ik.terms.point_residual import segment_moments
from linear_ik.urdf import generate_urdf

STOP_M = 1e-5
MOST_ROUNDS = 50
LM_DAMPING = 1e-6


def least_squares() -> Solve:
    """Return scipy's trust-region least squares over the joint angles, all points at once.

    Residuals are the distances to the faces as matched at the angles asked for: matching
    is part of the function, as its derivative is that of the matched plane's distance.
    """
    import scipy.optimize
    from threadpoolctl import threadpool_limits

    def solve(task: Task) -> Found:
        chain, matcher = prepared(task)
        last: dict[str, Any] = {}

        def at(q: Array) -> tuple[Pose, Correspondences]:
            if not np.array_equal(last.get("q", ()), q):
                pose = chain.pose(chain.with_q(q))
                last.update(q=q.copy(), found=(pose, matcher.match(pose, task.points)))
            return last["found"]

        def jacobian(q: Array) -> Array:
            return residual_jacobian(*at(q))

        with threadpool_limits(1):
            solution = scipy.optimize.least_squares(
                lambda q: at(q)[1].residual_m,
                np.zeros(chain.nv - BASE),
                jacobian,
                bounds=(chain.lower[BASE:], chain.upper[BASE:]),
            )
        return chain_found(task, chain, solution.x, int(solution.nfev))

    return solve


def residual_jacobian(pose: Pose, pairs: Correspondences) -> Array:
    """Return d residual / d q [P][3N] at a pose: ``-n.v - (p x n).w`` for each joint up to the point's segment."""
    out = np.zeros((len(pairs.residual_m), pose.J.shape[1] - BASE))
    for k in np.flatnonzero(np.diff(pairs.starts)):
        rows = slice(pairs.starts[k], pairs.starts[k + 1])
        normals = pairs.gradient[rows] @ pose.rotations[k, :, :2].T
        points = pairs.local[rows] @ pose.rotations[k].T + pose.nodes_m[k]
        columns = slice(BASE, BASE + 3 * (k + 1))
        out[rows, : 3 * (k + 1)] = -np.column_stack([normals, np.cross(points, normals)]) @ pose.J[:, columns]
    return out


def pink_points() -> Solve:
    """Return Pink's solve_ik with one task a segment made of its points.

    The task says the same as the points do: with ``M = L L'`` the moments of the
    segment's points and m their pull, its Jacobian is ``L' J_k`` and its error
    ``-L^-1 m``.
    """
    import pink
    from pink.tasks import Task as PinkTask

    class PointsTask(PinkTask):
        """Pulls one segment to the points matched to it."""

        def __init__(self, frame: str) -> None:
            super().__init__(cost=None, gain=1.0, lm_damping=0.0)
            self.frame = frame

        def set_points(self, M: Array, m: Array) -> None:  # noqa: N803
            """Take the moments of the points [6][6], [6], in the segment's own frame."""
            values, vectors = np.linalg.eigh(M)
            kept = values > 1e-12 * values[-1]
            self.root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
            self.pull = (vectors[:, kept].T @ m) / np.sqrt(values[kept])

        def compute_error(self, configuration: Any) -> Array:
            """Return the error [up to 6]."""
            return -self.pull

        def compute_jacobian(self, configuration: Any) -> Array:
            """Return the error's Jacobian [up to 6][3N]."""
            return self.root @ configuration.get_frame_jacobian(self.frame)

        def __repr__(self) -> str:
            return f"PointsTask({self.frame})"

    def update(task: PointsTask, configuration: Any, M: Array, m: Array) -> None:  # noqa: N803
        task.set_points(M, m)

    return with_pink(pink, PointsTask, update)


def pink_frames() -> Solve:
    """Return Pink's solve_ik with its stock frame task for each segment.

    In each round a segment's target is where its own points want it: the rigid step of
    the segment alone that lowers the distances of its points to its faces the most.
    """
    import pink
    import pinocchio as pin
    from pink.tasks import FrameTask

    def make(frame: str) -> Any:
        # No point says where a segment is along its own axis.
        return FrameTask(frame, position_cost=[1.0, 1.0, 0.0], orientation_cost=0.1)

    def update(task: Any, configuration: Any, M: Array, m: Array) -> None:  # noqa: N803
        # A segment without points stays where it is.
        ridge = LM_DAMPING * max(np.trace(M), 1e-12) / 6.0
        twist = np.linalg.solve(M + ridge * np.eye(6), m)
        task.set_target(configuration.get_transform_frame_to_world(task.frame) * pin.exp6(twist))

    return with_pink(pink, make, update)


def with_pink(pink: Any, make: Any, update: Any) -> Solve:
    """Return rounds of matching all points, updating the tasks, and one step of solve_ik."""
    import pinocchio as pin
    import qpsolvers
    from threadpoolctl import threadpool_limits

    solver = next(s for s in ("daqp", "quadprog", "proxqp", "osqp") if s in qpsolvers.available_solvers)

    def solve(task: Task) -> Found:
        chain, matcher = prepared(task)
        model = pin.buildModelFromXML(generate_urdf(task.element))
        configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))
        tasks = [make(f"segment_{k:02d}") for k in range(1, task.element.segments + 1)]
        limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0)]
        nodes = chain.nodes(configuration.q)
        rounds, moved_m = 0, np.inf
        with threadpool_limits(1):
            while moved_m >= STOP_M and rounds < MOST_ROUNDS:
                rounds += 1
                pose = chain.pose(chain.with_q(configuration.q))
                pairs = matcher.match(pose, task.points)
                M, m = segment_moments(pairs, np.ones(len(pairs.residual_m)))
                for one, M_k, m_k in zip(tasks, M, m, strict=True):
                    update(one, configuration, M_k, m_k)
                velocity = pink.solve_ik(configuration, tasks, 1.0, solver, damping=LM_DAMPING, limits=limits)
                configuration.integrate_inplace(velocity, 1.0)
                before, nodes = nodes, chain.nodes(configuration.q)
                moved_m = float(np.abs(nodes - before).max())
        return chain_found(task, chain, configuration.q, rounds)

    return solve


def prepared(task: Task) -> tuple[Chain, Matcher]:
    """Return the kinematics and the matcher of a task."""
    chain = Chain.of(task.element)
    return chain, Matcher(Surface.of(task.element.profile), chain.segment_length_m)


def chain_found(task: Task, chain: Chain, q: Array, iterations: int) -> Found:
    """Return the chain at Pinocchio's q [3N] as what was found."""
    pose = chain.pose(chain.with_q(q))
    return Found(pose.nodes_m, lambda: tubes(task.element, pose.rotations, pose.nodes_m), iterations)
