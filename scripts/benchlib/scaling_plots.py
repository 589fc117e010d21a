"""Pictures of `bench_scaling`: growth on logarithmic axes, and where the time goes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchlib.figures import drawing, save
from benchlib.stages import STAGES

COLOURS = ("#08519c", "#9ecae1", "#4292c6", "#1b7837", "#d9730d", "#756bb1", "#c51b7d", "#bdbdbd", "#737373")
INK, FADED = "#1b7837", "#999999"

Answers = list[dict[str, Any]]


def draw(folder: Path, by_points: Answers, by_segments: Answers, slopes: dict[str, float]) -> list[Path]:
    """Draw growth over points and segments, and the stages of each size."""
    points = [a for a in by_points if "time_s" in a]
    segments = [a for a in by_segments if "time_s" in a]
    if not points and not segments:
        return []
    return growth(folder / "scaling", points, segments, slopes) + stages(folder / "stages", points, segments)


def growth(stem: Path, points: Answers, segments: Answers, slopes: dict[str, float]) -> list[Path]:
    """Draw time, memory and iterations over points, time and iterations over segments."""
    panels = (
        ("time s", points, "points", lambda a: a["time_s"], "time over points"),
        ("memory MB above the imports", points, "points", lambda a: a["peak_bytes"] / 1e6, None),
        ("iterations", points, "points", lambda a: a["iterations"], "iterations over points"),
        ("time s", segments, "segments", lambda a: a["time_s"], "time over segments"),
        ("iterations", segments, "segments", lambda a: a["iterations"], "iterations over segments"),
    )
    with drawing(9.0, 5.2) as figure:
        grid = figure.subplots(2, 3)
        for axes, (label, answers, size, figure_of, slope) in zip(grid.flat, panels, strict=False):
            x, y = np.array([a[size] for a in answers]), np.array([figure_of(a) for a in answers])
            if len(x):
                axes.loglog(x, y, "o-", color=INK, markersize=3.5)
            if label.startswith("memory") and len(x):
                axes.loglog(x, 24e-6 * x, ":", color=FADED, label="the points themselves")
                axes.loglog(x, 72e-6 * x, "--", color=FADED, label="three times them")
                axes.legend()
            axes.set(xlabel=size, ylabel=label)
            if slope is not None and np.isfinite(slopes.get(slope, np.nan)):
                axes.set_title(f"slope {slopes[slope]:.2f}")
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_visible(False)
        return save(figure, stem)


def stages(stem: Path, points: Answers, segments: Answers) -> list[Path]:
    """Draw each size's time as shares of the stages."""
    with drawing(9.0, 4.2) as figure:
        grid = figure.subplots(1, 2, squeeze=False)
        for axes, answers, size in zip(grid.flat, (points, segments), ("points", "segments"), strict=True):
            shares = np.array([[a["stages"][stage] for stage in STAGES] for a in answers]).reshape(-1, len(STAGES))
            at, below = np.arange(len(answers)), np.zeros(len(answers))
            for stage, colour, share in zip(STAGES, COLOURS, shares.T, strict=True):
                axes.bar(at, 100 * share, bottom=100 * below, color=colour, width=0.8, label=stage)
                below = below + share
            axes.set_xticks(at, [short(a[size]) for a in answers])
            axes.set(xlabel=size, ylabel="share of the time, %", ylim=(0, 100))
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        return save(figure, stem)


def short(count: int) -> str:
    """Return a number such as 3 M or 10 k."""
    for unit, letter in ((1_000_000, " M"), (1_000, " k")):
        if count >= unit:
            return f"{count / unit:g}{letter}"
    return str(count)
