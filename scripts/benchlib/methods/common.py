"""What every method is given and hands back, and how its answer is measured.

Methods differ in what they find: a chain, one rigid motion, a deformed cloud, a line of
centres. All are brought to nodes and to a surface, and measured by these alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linear_ik import Element, SimulatedScan
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be solved, and the truth to measure it by.

    Attributes:
        element: the design, its placement the identity.
        points: [P][3] the scan.
        nodes_m: [N+1][3] where the nodes are.
        on_element: [P] which points are the element's; all when None.
    """

    element: Element
    points: Array
    nodes_m: Array
    on_element: npt.NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, element: Element, scan: SimulatedScan) -> Task:
        """Return the task of a simulated scan."""
        return cls(element, np.ascontiguousarray(scan.points), scan.nodes_m, scan.on_element)


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found.

    Attributes:
        nodes_m: [N+1][3].
        surface: returns vertices [V][3] and triangles [F][3] of the surface found. For
            measuring only: it is asked once the clock has stopped.
        iterations: as the method counts them; None where it does not say.
        core_s: seconds of the method without what some users have at hand, such as normals;
            None where there is nothing of the kind.
    """

    nodes_m: Array
    surface: Callable[[], tuple[Array, Triangles]]
    iterations: int | None = None
    core_s: float | None = None


Solve = Callable[[Task], Found]


def errors_mm(task: Task, found: Found) -> dict[str, float]:
    """Return node rms, worst node and tip error, and the rms distance of the element's points to the surface found.

    The first node is where the design puts it for most methods, and is left out of the rms.
    """
    import open3d as o3d

    points = task.points if task.on_element is None else task.points[task.on_element]
    scene = o3d.t.geometry.RaycastingScene()
    vertices, triangles = found.surface()
    scene.add_triangles(o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(triangles))
    points = points[:: max(1, len(points) // 20_000)]
    distance = scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
    node = np.linalg.norm(found.nodes_m - task.nodes_m, axis=1)
    return {
        "node_rms_mm": 1e3 * float(np.sqrt(np.mean(node[1:] ** 2))),
        "node_max_mm": 1e3 * float(node.max()),
        "tip_mm": 1e3 * float(node[-1]),
        "surface_rms_mm": 1e3 * float(np.sqrt(np.mean(distance.astype(np.float64) ** 2))),
    }


def tubes(element: Element, rotations: Array, nodes_m: Array) -> tuple[Array, Triangles]:
    """Return the mesh of the segments at the poses [N][3][3], [N+1][3] (or of all at one pose)."""
    vertices, triangles = Surface.of(element.profile).mesh(element.segment_length_m)
    n = element.segments
    placed = vertices @ rotations.transpose(0, 2, 1) + nodes_m[:n, None]
    shifts = len(vertices) * np.arange(n, dtype=np.uint32)[:, None, None]
    return placed.reshape(-1, 3), np.asarray((triangles + shifts).reshape(-1, 3), dtype=np.uint32)


@dataclass(frozen=True, eq=False)
class Template:
    """The design's surface as a mesh of even spacing, with a ring of vertices at every node.

    Attributes:
        vertices: [V][3].
        triangles: [F][3].
        rings: vertices lie in so many rings along a segment, the last shared with the next.
    """

    vertices: Array
    triangles: Triangles
    rings: int

    @classmethod
    def of(cls, element: Element, count: int) -> Template:
        """Return a template of about ``count`` vertices."""
        surface = Surface.of(element.profile)
        spacing_m = float(np.sqrt(surface.perimeter_m * element.length_m / count))
        edges = []
        for corner, tangent, width in zip(surface.corners, surface.tangents, surface.widths_m, strict=True):
            steps = max(1, round(width / spacing_m))
            edges.append(corner + np.linspace(0.0, width, steps, endpoint=False)[:, None] * tangent)
        ring = np.concatenate(edges)
        rings = max(2, round(element.segment_length_m / spacing_m))
        z = np.linspace(0.0, element.length_m, rings * element.segments + 1)
        vertices = np.column_stack([np.tile(ring, (len(z), 1)), np.repeat(z, len(ring))])
        a = np.arange(len(ring))
        b = np.roll(a, -1)
        band = np.concatenate([np.column_stack([a, b, b + len(a)]), np.column_stack([a, b + len(a), a + len(a)])])
        triangles = (band + len(a) * np.arange(len(z) - 1)[:, None, None]).reshape(-1, 3)
        return cls(vertices, triangles.astype(np.uint32), rings)


def regressed_nodes(element: Element, straight: Array, deformed: Array) -> Array:
    """Return the nodes [N+1][3] of a deformed template.

    The sections of a segment are regressed on where they were: one affine map a segment,
    by least squares over its template points, carries the design's axis to the line of
    the deformed sections' centroids. At a boundary the two lines' ends are averaged.

    Args:
        element: the design.
        straight: [V][3] template points on the design.
        deformed: [V][3] the same points where the method put them.
    """
    n, length = element.segments, element.segment_length_m
    ends = np.zeros((n, 2, 3))
    for k in range(n):
        own = np.flatnonzero((straight[:, 2] >= k * length - 1e-9) & (straight[:, 2] <= (k + 1) * length + 1e-9))
        A = np.column_stack([straight[own], np.ones(len(own))])
        affine, *_ = np.linalg.lstsq(A, deformed[own], rcond=None)
        ends[k] = np.array([[0.0, 0.0, k * length, 1.0], [0.0, 0.0, (k + 1) * length, 1.0]]) @ affine
    inner = (ends[:-1, 1] + ends[1:, 0]) / 2.0
    return np.concatenate([ends[:1, 0], inner, ends[-1:, 1]])
