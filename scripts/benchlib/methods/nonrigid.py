"""Non-rigid registration of a template of the design: coherent point drift and its kin, non-rigid ICP.

They know no segments: nodes are regressed from the deformed template, see
`common.regressed_nodes`. They get the whole scan. Their settings were tried on such a
cloud, kernel width and stiffness by factors of two to three, size of the template,
thresholds and schedules, and the most accurate kept: none is at its defaults, which do
worse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from benchlib.methods.common import Found, Solve, Task, Template, regressed_nodes

# Coherent point drift: kernel width (m), stiffness, share of outliers.
BETA_M, ALPHA, OUTLIERS = 0.5, 0.3, 0.01
MOST_ITERATIONS = 150
RANK, NEIGHBOURS = 100, 20
DENSE_TEMPLATE, SPARSE_TEMPLATE, MESH_TEMPLATE = 1000, 2000, 500
# Non-rigid ICP: how far a match may be.
THRESHOLD_M = 0.05
# Of Sumner's: correspondence, identity, smoothness, landmarks, normals.
SUMNER_STEPS = ((10.0, 0.001, 1.0, 0.0, 0.0),) * 20

Warp = Callable[[Task, Template], tuple[npt.ArrayLike, int | None]]


def pycpd() -> Solve:
    """Return pycpd's deformable coherent point drift."""
    from pycpd import DeformableRegistration

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, int]:
        drift = DeformableRegistration(X=task.points, Y=template.vertices, tolerance=1e-7, **of_drift())
        return drift.register()[0], drift.iteration

    return warping(warp, DENSE_TEMPLATE)


def rustcpd() -> Solve:
    """Return rustcpd's deformable coherent point drift, its kernel of low rank and its sums over neighbours."""
    from rustcpd import register_deformable

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, int]:
        drift = register_deformable(
            task.points,
            template.vertices,
            alpha=ALPHA,
            beta=BETA_M,
            outlier_weight=OUTLIERS,
            max_iterations=MOST_ITERATIONS,
            tolerance=1e-9,
            low_rank=RANK,
            low_rank_method="pivoted_cholesky",
            k=NEIGHBOURS,
        )
        return drift.points, drift.iterations

    return warping(warp, SPARSE_TEMPLATE)


def biocpd() -> Solve:
    """Return biocpd's deformable coherent point drift, its kernel of low rank and its sums over neighbours."""
    from biocpd import DeformableRegistration

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, int]:
        drift = DeformableRegistration(
            X=task.points,
            Y=template.vertices,
            tolerance=1e-9,
            num_eig=RANK,
            low_rank_method="pivoted_cholesky",
            k=NEIGHBOURS,
            dtype=np.float64,
            **of_drift(),
        )
        return drift.register()[0], drift.iteration

    return warping(warp, SPARSE_TEMPLATE)


def probreg() -> Solve:
    """Return probreg's non-rigid coherent point drift."""
    from probreg import cpd

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, int]:
        rounds: list[Any] = []
        found = cpd.registration_cpd(
            template.vertices,
            task.points,
            "nonrigid",
            w=OUTLIERS,
            maxiter=MOST_ITERATIONS,
            tol=1e-7,
            callbacks=[rounds.append],
            beta=BETA_M,
            lmd=ALPHA,
        )
        return found.transformation.transform(template.vertices), len(rounds)

    return warping(warp, DENSE_TEMPLATE)


def nricp_amberg() -> Solve:
    """Return trimesh's non-rigid ICP after Amberg, its steps the default ones."""
    import trimesh

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, None]:
        mesh = trimesh.Trimesh(template.vertices, template.triangles, process=False)
        found = trimesh.registration.nricp_amberg(mesh, task.points, distance_threshold=THRESHOLD_M, use_faces=False)
        return found, None

    return warping(warp, MESH_TEMPLATE)


def nricp_sumner() -> Solve:
    """Return trimesh's non-rigid ICP after Sumner, with twenty steps instead of four."""
    import trimesh

    def warp(task: Task, template: Template) -> tuple[npt.ArrayLike, int]:
        mesh = trimesh.Trimesh(template.vertices, template.triangles, process=False)
        found = trimesh.registration.nricp_sumner(
            mesh, task.points, steps=SUMNER_STEPS, distance_threshold=THRESHOLD_M, use_faces=False
        )
        return found, len(SUMNER_STEPS)

    return warping(warp, MESH_TEMPLATE)


def of_drift() -> dict[str, Any]:
    """Return the settings that pycpd and biocpd name alike."""
    return {"alpha": ALPHA, "beta": BETA_M, "w": OUTLIERS, "max_iterations": MOST_ITERATIONS}


def warping(warp: Warp, count: int) -> Solve:
    """Return the method that moves a template of about ``count`` vertices as ``warp`` says."""

    def solve(task: Task) -> Found:
        template = Template.of(task.element, count)
        moved, iterations = warp(task, template)
        vertices = np.asarray(moved, dtype=np.float64)
        nodes = regressed_nodes(task.element, template.vertices, vertices)
        return Found(nodes, lambda: (vertices, template.triangles), iterations)

    return solve
