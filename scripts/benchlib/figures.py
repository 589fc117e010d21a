"""Pictures: the paper's figures 3 to 6 drawn anew.

Every picture is written twice, as PNG and as SVG; the same data give the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik import Chain, Element
from linear_ik.surface import Surface

Array = npt.NDArray[np.float64]

ORIGINAL, TRUTH, RESULT = "#ffffff", "#2166ac", "#35a04a"  # as in the paper's figure 4
METHOD_COLOURS = {"default": "#1b7837", "icpik": "#d9730d"}
METHOD_NAMES = {"default": "default", "icpik": "paper's method (our run)"}
PAPER_GREY = "#d9d9d9"
LINES = "solid: the paper's method, our run; dashed: the default"
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 7.0,
    "lines.linewidth": 1.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "linear_ik",
}
CHORDS = 24
AZIMUTH_DEG, ELEVATION_DEG = -25.0, 14.0


@contextmanager
def drawing(width_in: float, height_in: float) -> Iterator[Any]:
    """Give a figure of the house's style that no screen is needed for."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(width_in, height_in), layout="constrained")
        try:
            yield figure
        finally:
            plt.close(figure)


def save(figure: Any, stem: Path, dpi: int = 110) -> list[Path]:
    """Write a figure as ``stem``.png and ``stem``.svg, and return both paths."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    png, svg = stem.with_name(stem.name + ".png"), stem.with_name(stem.name + ".svg")
    figure.savefig(png, dpi=dpi, metadata={"Software": None})
    figure.savefig(svg, dpi=dpi, metadata={"Date": None, "Creator": None})
    return [png, svg]


# Figures 3 and 4 ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Bent:
    """An element in one shape: Pinocchio's q [3N] on a base [4][4]."""

    q: npt.ArrayLike
    base_pose: Array


def faces(element: Element, bent: Bent) -> Array:
    """Return the corners [F][4][3] of the faces of every segment, round sections in 20 chords."""
    surface = Surface.of(element.profile)
    corners = surface.corners
    if surface.radius_m is not None:
        angle = np.arange(CHORDS) * (2 * np.pi / CHORDS)
        corners = surface.radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    chain = Chain.of(element)
    pose = chain.pose(chain.with_q(bent.q))
    following = np.roll(corners, -1, axis=0)
    out = []
    for k, length in enumerate(chain.segment_length_m):
        quad = np.stack(
            [
                np.column_stack([xy, np.full(len(xy), z)])
                for xy, z in ((corners, 0.0), (following, 0.0), (following, length), (corners, length))
            ],
            axis=1,
        )
        out.append(quad @ pose.rotations[k].T + pose.nodes_m[k])
    base = np.asarray(bent.base_pose)
    return np.concatenate(out) @ base[:3, :3].T + base[:3, 3]


def draw_scan(stem: Path, points: Array, title: str) -> list[Path]:
    """Draw a point cloud [P][3] as the paper's figure 3."""
    with drawing(2.4, 4.6) as figure:
        axes = figure.add_subplot()
        xy, depth = seen(points)
        order = np.argsort(depth)
        axes.scatter(*xy[order].T, s=1.5, c=points[order, 2], cmap="viridis", linewidths=0, rasterized=True)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(title)
        return save(figure, stem)


def draw_shapes(
    stem: Path, panels: Sequence[tuple[str, Element, Bent, Mapping[str, Bent]]], columns: int = 7
) -> list[Path]:
    """Draw original, truth and results of each case as the paper's figure 4.

    Args:
        stem: path without its ending.
        panels: (title, element, truth, results by method) a case.
        columns: cases side by side; each method has a row of its own.
    """
    methods = list(panels[0][3])
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns) * len(methods)
    with drawing(max(1.5 * columns, 3.4), 3.0 * rows) as figure:
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes in grid.flat:
            axes.set(xticks=[], yticks=[], facecolor=PAPER_GREY, aspect="equal", adjustable="datalim")
            axes.spines[:].set_visible(False)
        for axes in list(grid.flat)[len(grid.flat) - (-len(panels) % columns) :]:
            axes.set_visible(False)
        for i, (title, element, truth, results) in enumerate(panels):
            original = Bent(np.zeros(3 * element.segments), element.placement.T_world_element)
            for j, method in enumerate(methods):
                axes = grid[(i // columns) * len(methods) + j, i % columns]
                _solid(axes, faces(element, original), ORIGINAL, "#777777", 1.0)
                _solid(axes, faces(element, truth), TRUTH, TRUTH, 0.75)
                _solid(axes, faces(element, results[method]), RESULT, "#14501f", 0.55)
                axes.set_title(f"{title}\n{METHOD_NAMES[method]}", fontsize=6.0)
        figure.suptitle("original (white), truth (blue), result (green, over the truth)", fontsize=9)
        return save(figure, stem, dpi=90)


def _solid(axes: Any, quads: Array, fill: str, edge: str, alpha: float) -> None:
    """Draw the faces that look at the reader, the farthest first."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    xy, depth = seen(quads)
    (ax, ay), (bx, by) = np.moveaxis(xy[:, 1] - xy[:, 0], -1, 0), np.moveaxis(xy[:, 3] - xy[:, 0], -1, 0)
    facing = ax * by - ay * bx > 0.0
    order = np.argsort(depth.mean(axis=1))
    polygons = xy[order[facing[order]]]
    # Translucent faces would add up where they hide each other: shade the layer as a whole.
    axes.add_collection(
        PolyCollection(
            polygons, facecolors=to_rgba(fill, alpha), edgecolors=to_rgba(edge, 0.9), linewidths=0.3, rasterized=True
        )
    )
    axes.autoscale_view()


def seen(points: Array) -> tuple[Array, Array]:
    """Return points [...][3] as a reader sees them: [...][2] right and up, and [...] towards him."""
    azimuth, elevation = np.radians(AZIMUTH_DEG), np.radians(ELEVATION_DEG)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    towards = np.array([*(np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])), np.sin(elevation)])
    return points @ np.stack([right, np.cross(towards, right)], axis=1), points @ towards


# Figures 5 and 6 ------------------------------------------------------------------------


@dataclass(frozen=True)
class Curves:
    """What figures 5 and 6 show of one case and method.

    Attributes:
        case: name.
        study: panel it belongs to.
        method: "default" or "icpik".
        cloud_mm: the paper's RMSE, from the design on.
        surface_mm: point to surface, the same.
        node_mm: final error of each node.
        floor_mm: the paper's RMSE of the truth.
    """

    case: str
    study: str
    method: str
    cloud_mm: Sequence[float]
    surface_mm: Sequence[float]
    node_mm: Sequence[float]
    floor_mm: float


def draw_rmse(stem: Path, curves: Sequence[Curves], published: Mapping[str, tuple[float, float]]) -> list[Path]:
    """Draw the RMSE of every iteration as the paper's figure 5, and the distance to the surface below.

    The first row is the paper's method with scan and model on one grid, as the paper
    samples; the rows below are both methods on the same, independent clouds.

    Args:
        stem: path without its ending.
        curves: of all cases, methods "grid", "icpik" and "default".
        published: study to the band of the paper's final RMSE, mm.
    """
    studies = sorted({c.study for c in curves})
    with drawing(2.7 * len(studies), 7.2) as figure:
        grid = figure.subplots(3, len(studies), sharey="row", sharex="col", squeeze=False)
        for column, study in enumerate(studies):
            cases = list(dict.fromkeys(c.case for c in curves if c.study == study))
            top, middle, bottom = grid[:, column]
            for c in (c for c in curves if c.study == study):
                colour = f"C{cases.index(c.case)}"
                if c.method == "grid":
                    top.plot(c.cloud_mm, color=colour, label=c.case)
                    top.axhline(c.floor_mm, color=colour, lw=0.6, ls=":")
                    continue
                line = "-" if c.method == "icpik" else (0, (3, 1.2))
                middle.plot(c.cloud_mm, color=colour, ls=line)
                bottom.plot(c.surface_mm, color=colour, ls=line)
                if c.method == "icpik":
                    middle.axhline(c.floor_mm, color=colour, lw=0.6, ls=":")
            if study in published:
                top.axhspan(*published[study], color="black", alpha=0.08, lw=0, label="published, final")
            top.set_title(f"case study {study}")
            top.legend(loc="upper right", fontsize=5.5)
            bottom.set_xlabel("iteration")
        grid[0, 0].set_ylabel("RMSE, clouds on one grid, mm\n(dotted: of the truth)")
        grid[1, 0].set_ylabel("RMSE, independent clouds, mm\n(dotted: of the truth)")
        grid[2, 0].set_ylabel("scan to model's surface, mm")
        for axes in grid.flat:
            axes.set_yscale("log")
            axes.set_xlim(left=0)
            plain_log(axes.yaxis)
        grid[0, 0].set_ylim(bottom=1.5)
        figure.suptitle(LINES, fontsize=8)
        return save(figure, stem)


def draw_nodes(stem: Path, curves: Sequence[Curves], published_tip_mm: Mapping[str, float]) -> list[Path]:
    """Draw the error of every node as the paper's figure 6; a star is the tip that it publishes."""
    studies = sorted({c.study for c in curves})
    with drawing(2.7 * len(studies), 3.0) as figure:
        grid = figure.subplots(1, len(studies), sharey=True, squeeze=False)[0]
        for axes, study in zip(grid, studies, strict=True):
            cases = list(dict.fromkeys(c.case for c in curves if c.study == study))
            for c in (c for c in curves if c.study == study):
                colour = f"C{cases.index(c.case)}"
                nodes = np.arange(1, len(c.node_mm))
                style = "o-" if c.method == "icpik" else "s--"
                label = c.case if c.method == "icpik" else None
                axes.plot(nodes, c.node_mm[1:], style, color=colour, ms=2.5, lw=0.9, label=label)
                if c.method == "icpik" and c.case in published_tip_mm:
                    tip = published_tip_mm[c.case]
                    axes.plot(nodes[-1], tip, "*", color=colour, ms=9, mec="black", mew=0.5, clip_on=False)
            axes.axhline(0.5, color="black", lw=0.6, ls=":")
            axes.set(title=f"case study {study}", xlabel="node", yscale="log")
            axes.legend(loc="lower center", fontsize=6, ncols=4)
            plain_log(axes.yaxis)
        grid[0].set_ylim(bottom=0.003)
        grid[0].set_ylabel("node error, mm (dotted: 0.5 mm)")
        figure.suptitle(f"{LINES}; star: the tip that the paper publishes", fontsize=8)
        return save(figure, stem)


def plain_log(axis: Any) -> None:
    """Label a logarithmic axis 1, 2, 5, 10 and so on."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(10, subs=(1.0, 2.0, 5.0), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
