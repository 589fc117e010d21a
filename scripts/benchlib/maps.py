"""Maps of where a method succeeds, and its errors beside the bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchlib.figures import METHOD_COLOURS, METHOD_NAMES, drawing, plain_log, save

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SuccessMap:
    """Share of the seeds a method succeeds with, over two quantities.

    Attributes:
        title: what the map is about.
        x_label, x: along the columns.
        y_label, y: along the rows, as labels.
        share: by method, [rows][columns] from 0 to 1, NaN where nothing was run.
        observable: [rows][columns] whether the scan shows every bend at all.
    """

    title: str
    x_label: str
    x: Sequence[str]
    y_label: str
    y: Sequence[str]
    share: Mapping[str, Array]
    observable: npt.NDArray[np.bool_]


def draw_maps(stem: Path, maps: Sequence[SuccessMap]) -> list[Path]:
    """Draw each map once a method, side by side; hatched where the scan cannot show the bends."""
    from matplotlib.patches import Rectangle

    methods = list(maps[0].share)
    with drawing(3.3 * len(methods), 2.5 * len(maps) + 0.4) as figure:
        grid = figure.subplots(len(maps), len(methods), squeeze=False)
        image = None
        for row, m in zip(grid, maps, strict=True):
            for axes, method in zip(row, methods, strict=True):
                share = np.asarray(m.share[method], dtype=float)
                image = axes.imshow(share, vmin=0, vmax=1, cmap="RdYlGn", aspect="auto", origin="lower")
                for (i, j), value in np.ndenumerate(share):
                    if not m.observable[i, j]:
                        cell = Rectangle((j - 0.5, i - 0.5), 1, 1, hatch="////", fc="none", ec="0.35", lw=0)
                        axes.add_patch(cell)
                    if np.isfinite(value):
                        axes.text(j, i, f"{100 * value:.0f}", ha="center", va="center", fontsize=6)
                axes.set_xticks(range(len(m.x)), m.x)
                axes.set_yticks(range(len(m.y)), m.y)
                axes.set_xticks(np.arange(len(m.x) + 1) - 0.5, minor=True)
                axes.set_yticks(np.arange(len(m.y) + 1) - 0.5, minor=True)
                axes.grid(which="minor", color="white", lw=1.0)
                axes.tick_params(which="both", length=0)
                axes.set(title=f"{m.title}: {METHOD_NAMES[method]}", xlabel=m.x_label, ylabel=m.y_label)
                for spine in axes.spines.values():
                    spine.set_visible(False)
        figure.colorbar(image, ax=grid, shrink=0.3, label="share of the seeds that succeed")
        return save(figure, stem, dpi=100)


def draw_efficiency(
    stem: Path, names: Sequence[str], errors_mm: Mapping[str, Sequence[Array]], bound_mm: Sequence[float], what: str
) -> list[Path]:
    """Draw the errors of every seed beside the bound of each case.

    Args:
        stem: path without its ending.
        names: of the cases.
        errors_mm: method to one array of the seeds' errors a case.
        bound_mm: of each case.
        what: the error's name, for the axis.
    """
    with drawing(8.0, 3.2) as figure:
        axes = figure.add_subplot()
        at = np.arange(len(names), dtype=float)
        for i, (method, errors) in enumerate(errors_mm.items()):
            shift = (i - (len(errors_mm) - 1) / 2) * 0.3
            for j, values in enumerate(errors):
                spread = np.linspace(-0.1, 0.1, len(values))
                label = METHOD_NAMES[method] if j == 0 else None
                axes.plot(at[j] + shift + spread, np.sort(values), ".", ms=3, color=METHOD_COLOURS[method], label=label)
        for j, bound in enumerate(bound_mm):
            axes.hlines(
                bound, at[j] - 0.4, at[j] + 0.4, color="black", lw=1.2, label="Cramer-Rao bound" if j == 0 else None
            )
        axes.set_xticks(at, names)
        axes.set(yscale="log", ylabel=f"{what}, mm")
        plain_log(axes.yaxis)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        return save(figure, stem)
