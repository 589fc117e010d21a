"""Fits of captured scans: one picture a scan, and docs/captured.md with what was measured."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import numpy.typing as npt
from captured import DATA, FILE_OF, element_of, scan_of
from truth import kinematics, surface_distances_m

import linear_ik
from linear_ik.result import FitResult

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402 - after the choice of what draws

Array = npt.NDArray[np.float64]
NEAR_M, COLOURS_M = 0.15, 0.010
MOST_POINTS = 4_000
GROUPS = {
    "steel_joint": ("heb340", "hea140"),
    "pump": ("pipe_west", "pipe_east"),
    "timbers": ("timber_000A", "timber_000Z"),
    "wire_harness": ("wire",),
    "lamppost": ("lamppost",),
}
ABOUT = {
    "steel_joint": ("A steel joint: a chord HEB 340 and a brace HEA 140", "fnoi/pc2beam", "MIT"),
    "pump": ("Two pipes of a pump room, seen from one station", "davidcaron/pye57", "MIT"),
    "timbers": ("Two carpentry beams, notched at their joints", "ibois-epfl/augmented-carpentry", "GPL-3"),
    "wire_harness": ("One wire of a harness, 8 mm thick, seen by a depth camera", "markuswnuk91/trackDLO", "MIT"),
    "lamppost": ("A lamppost on a grid of 16 to 31 mm", "PointCloudLibrary/data", "BSD-3"),
}
HEAD = """# Captured scans

Real scans, which nobody here took: five files from public repositories, each with the design that its description
gives. The scans are not part of this project; the pictures were made from them. A script writes this page, where the
data is:

```sh
LINEAR_IK_DATA=folder scripts/pictures captured
```

Scan points are coloured by their distance to the fitted surface, 0 to 10 mm; grey ones are farther away. Lines are the
fitted outline, dashed ones the design. Across the axis lengths are drawn to another scale than along it.

There is no truth here. Surface rms is that of the matched points; the median is that of all points within 10 mm,
matched or not; bow is the largest offset from the chord with its 95 % band, and the last column the widest 95 % band of
a node across the axis. A section that measures otherwise than designed is in the reasons; distances are to the
designed one.
"""


def captured(docs: Path) -> list[Path]:
    """Fit every member, draw, and write the page.

    Args:
        docs: folder of the page; pictures go to its figures/.
    """
    if not DATA.is_dir():
        raise SystemExit(f"error: {DATA}: the captured scans are not there (set LINEAR_IK_DATA)")
    made, text = [], [HEAD]
    for group, names in GROUPS.items():
        results = {name: linear_ik.fit(element_of(name), scan_of(name)) for name in names}
        picture = docs / "figures" / f"captured_{group}.png"
        draw(results, picture)
        made.append(picture)
        title, source, licence = ABOUT[group]
        text += [f"\n## {title}\n", f"Source: {source} ({licence}), {FILE_OF[names[0]]}", ""]
        if len({FILE_OF[name] for name in names}) > 1:
            text[-2] += f" and {FILE_OF[names[1]]}"
        text[-2] += "."
        text += [f"![{title}: points and fitted outlines](figures/{picture.name})", ""]
        text += table(results)
    page = docs / "captured.md"
    page.write_text("\n".join(text) + "\n", encoding="utf-8")
    return [*made, page]


def table(results: dict[str, FitResult]) -> list[str]:
    """Return the figures as lines of Markdown, and every reason below."""
    lines = [
        "| member | status | points | segments measured | surface rms mm | median mm | bow mm | widest band mm |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    reasons = []
    for name, result in results.items():
        matched = sum(s.points for s in result.segments)
        measured = f"{sum(s.status == 'measured' for s in result.segments)} of {len(result.segments)}"
        if result.status == "not_scanned":
            lines.append(f"| {name} | not_scanned | {matched} | {measured} | - | - | - | - |")
        else:
            found = linear_ik.deviations(result)
            distance = surface_distances_m(result, scan_of(name).points, result.element.profile)
            median_mm = 1e3 * np.median(distance[distance < COLOURS_M])
            bow = f"{1e3 * found.bow_m.value:.2f} +- {1e3 * found.bow_m.band:.2f}"
            rms_mm, band_mm = 1e3 * result.surface_rmse_m, 1e3 * found.departure_m.band.max()
            lines.append(
                f"| {name} | {result.status} | {matched} | {measured} | {rms_mm:.2f} | {median_mm:.2f} | {bow} "
                f"| {band_mm:.2f} |"
            )
        reasons += [f"- {name}: {reason}" for reason in result.reasons]
    return [*lines, "", *reasons]


def draw(results: dict[str, FitResult], path: Path) -> None:
    """Draw a row for each member: from the side, from above, and the section in the middle."""
    size = (11.0, 2.9 * len(results))
    figure, axes = plt.subplots(
        len(results), 3, figsize=size, squeeze=False, width_ratios=(2, 2, 1), layout="constrained"
    )
    shades = None
    for row, (name, result) in zip(axes, results.items(), strict=True):
        shades = draw_member(row, name, result) or shades
    if shades is not None:
        figure.colorbar(shades, ax=axes, label="distance to the fitted surface, mm", shrink=0.8)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def draw_member(axes: npt.NDArray[np.object_], name: str, result: FitResult) -> object:
    """Draw one member in its three panels; return what the colours stand for, if there are any."""
    element, T = result.element, result.element.placement.T_world_element
    points = scan_of(name).points
    local = (points - T[:3, 3]) @ T[:3, :3]
    near = np.flatnonzero(surface_distances_m(result, points, element.profile) < NEAR_M)
    near = np.random.default_rng(0).permutation(near)[:MOST_POINTS]
    distance = surface_distances_m(result, points[near], element.profile)
    found = result.status != "not_scanned"
    on = (distance < COLOURS_M) & found
    shades = None
    rotations, nodes = kinematics(result.base_pose, result.joint_angles_rad, element.segment_length_m)
    fitted = T[:3, :3].T @ rotations, (nodes - T[:3, 3]) @ T[:3, :3]
    designed = element.design.rotations, element.design.nodes_m
    for axis, side, letter in ((axes[0], 1, "y"), (axes[1], 0, "x")):
        axis.scatter(local[near[~on], 2], local[near[~on], side], s=1, c="0.8", linewidths=0, rasterized=True)
        if on.any():
            shades = axis.scatter(
                local[near[on], 2], local[near[on], side], s=2, c=1e3 * distance[on], cmap="viridis_r", vmin=0,
                vmax=1e3 * COLOURS_M, linewidths=0, rasterized=True,
            )  # fmt: skip
        outline(axis, element, *designed, side, {"color": "0.45", "linestyle": "--", "linewidth": 0.8})
        if found:
            outline(axis, element, *fitted, side, {"color": "tab:red", "linewidth": 1.0})
        axis.set(xlabel="along the design, m", ylabel=f"local {letter}, m")
    axes[0].set_title(f"{name}: {result.status}", fontsize=10)
    section(axes[2], element, fitted, local[near], distance, on)
    return shades


def outline(axis, element, rotations: Array, nodes: Array, side: int, style: dict) -> None:
    """Draw the two edges of the body as they are seen from the side."""
    n = element.segments
    for sign in (0, 1):
        edge = []
        for k in range(n):
            for at, node in ((k / n, nodes[k]), ((k + 1) / n, nodes[k + 1])):
                corners = element.profile_at(at).outline() @ rotations[k, :, :2].T + node
                pick = corners[:, side].argmax() if sign else corners[:, side].argmin()
                edge.append(corners[pick, [2, side]])
        axis.plot(*np.array(edge).T, **style)


def section(axis, element, fitted, local: Array, distance: Array, on) -> None:
    """Draw the section of the middle segment, in its own frame, with the points on that segment."""
    rotations, nodes = fitted
    k = element.segments // 2
    own = (local - nodes[k]) @ rotations[k]
    there = (own[:, 2] > 0) & (own[:, 2] < element.segment_length_m)
    ring = element.profile_at((k + 0.5) / element.segments).outline()
    reach = 1.3 * np.abs(ring).max()
    axis.scatter(*own[there & ~on, :2].T, s=2, c="0.8", linewidths=0)
    axis.scatter(
        *own[there & on, :2].T, s=4, c=1e3 * distance[there & on], cmap="viridis_r", vmin=0, vmax=1e3 * COLOURS_M,
        linewidths=0,
    )  # fmt: skip
    style = {"color": "tab:red", "linewidth": 1.0} if on.any() else {"color": "0.45", "linestyle": "--"}
    axis.plot(*np.concatenate([ring, ring[:1]]).T, **style)
    axis.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel=f"segment {k + 1}: x, m", ylabel="y, m")
