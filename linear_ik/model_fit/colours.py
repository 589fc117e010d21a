"""Colours: the scan's points on the elements, coloured by how far they are from the design.

A point belongs to the fitted surface that it is nearest to; its deviation is the signed
distance to the same face as designed. Points on nothing that was fitted are left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import output_errors, written_whole
from linear_ik.exports.coloured_cloud import CloudFile, LazCloud, PlyCloud, colours_of, laz_can_be_written
from linear_ik.model_fit.fits import Fits
from linear_ik.model_fit.handed_out import Listener, Pieces
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.result import FitResult
from linear_ik.run_files import LAZ, PLY, REPORT
from linear_ik.scan import Scan
from linear_ik.site.body import Body
from linear_ik.site.neighbourhood import Neighbourhoods

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

NO_LAZ = f'{LAZ} was not written: it needs laspy and lazrs (pip install "linear_ik[scan]")'
ON_SURFACE_M = 0.008
NOISES = 4.0


@dataclass
class Coloured:
    """What was written.

    Attributes:
        files: names.
        legend: of the colours, and how many points have one.
        notes: plain sentences.
    """

    files: list[str] = field(default_factory=list)
    legend: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def colour_scan(
    pieces: Pieces,
    fits: Fits,
    folder: Path,
    options: ModelFitOptions,
    inputs: str,
    listener: Listener,
) -> Coloured:
    """Write deviation.ply and deviation.laz.

    Args:
        pieces: gives the scan, in the model's coordinates.
        fits: the results.
        folder: for the files.
        options: of the run.
        inputs: fingerprint of what the files hang on.
        listener: told how many points are done.

    Raises:
        OutputError: they cannot be written.
        ScanError: the scan cannot be read again.
    """
    found = {i: r for i, r in enumerate(row.result for row in fits.rows) if r is not None and r.status != "not_scanned"}
    out = Coloured()
    if not found:
        for name in (PLY, LAZ):
            with output_errors(folder / name):
                (folder / name).unlink(missing_ok=True)
        return out
    total = int(fits.extent.get("points", 0))
    comments = [
        "linear_ik: signed distance to the same face as designed, metres, outside positive",
        f"blue -{options.legend_m:g} m, grey 0, red +{options.legend_m:g} m; element: row of elements.csv, from 1",
    ]
    count, done = 0, 0
    low, high = np.inf, -np.inf
    with ExitStack() as stack:
        clouds: list[CloudFile] = [PlyCloud(stack.enter_context(written_whole(folder / PLY)), comments)]
        out.files.append(PLY)
        offset = next(iter(found.values())).nodes_m[0]
        if laz_can_be_written():
            clouds.append(LazCloud(stack.enter_context(written_whole(folder / LAZ)), offset))
            out.files.append(LAZ)
        else:
            out.notes.append(NO_LAZ)
        for read, points, deviation, element in _belonging(
            pieces(fits.neighbourhoods.bounds_m), found, fits.neighbourhoods
        ):
            done += read
            if len(element):
                colours = colours_of(deviation, options.legend_m)
                for cloud in clouds:
                    cloud.write(points, deviation, colours, element + 1)
                count += len(element)
                low, high = min(low, float(deviation.min())), max(high, float(deviation.max()))
            listener("colouring the scan", done, total, float("nan"))
        for cloud in clouds:
            cloud.close()
    out.legend = {
        "inputs": inputs,
        "files": out.files,
        "of": "signed distance to the same face as designed, outside positive",
        "legend_m": options.legend_m,
        "points": count,
        "lowest_m": round(low, 6) if count else None,
        "highest_m": round(high, 6) if count else None,
    }
    return out


def _belonging(
    pieces: Iterable[Scan], found: dict[int, FitResult], neighbourhoods: Neighbourhoods
) -> Iterator[tuple[int, Array, Array, Index]]:
    """Yield for each piece how many points it has, those [P][3] on an element, their deviation [P] and element [P]."""
    fitted = {i: Body.fitted(result) for i, result in found.items()}
    designed = {i: Body.designed(result.element) for i, result in found.items()}
    gate = {i: max(ON_SURFACE_M, NOISES * _noise(result)) for i, result in found.items()}
    for piece in pieces:
        points = piece.points
        pairs = neighbourhoods.pairs(points)
        best = np.full(len(points), np.inf)
        owner = np.full(len(points), -1, dtype=np.intp)
        starts = np.flatnonzero(np.diff(pairs.member, prepend=-1))
        for start, end in zip(starts, np.append(starts, len(pairs.row))[1:], strict=True):
            i = int(pairs.member[start])
            if i not in found:
                continue
            rows = pairs.row[start:end]
            rows = rows[fitted[i].may_touch(points[rows], gate[i])]
            if not len(rows):
                continue
            _, distance, _ = fitted[i].distances(points[rows])
            nearer = (distance <= gate[i]) & (distance < best[rows])
            best[rows[nearer]], owner[rows[nearer]] = distance[nearer], i
        rows = np.flatnonzero(owner >= 0)
        deviation = np.empty(len(rows))
        for i in np.unique(owner[rows]):
            of_i = owner[rows] == i
            deviation[of_i] = fitted[int(i)].deviations(points[rows[of_i]], designed[int(i)])
        yield len(points), points[rows], deviation, owner[rows]


def _noise(result: FitResult) -> float:
    return result.range_noise_m if np.isfinite(result.range_noise_m) else 0.0


def coloured_before(folder: Path, inputs: str) -> Coloured | None:
    """Return what an earlier run wrote from the same inputs, or None."""
    try:
        report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        legend = report["deviation"]
        if legend["inputs"] != inputs or not all((folder / name).is_file() for name in legend["files"]):
            return None
        return Coloured(list(legend["files"]), legend, [] if LAZ in legend["files"] else [NO_LAZ])
    except (OSError, ValueError, KeyError, TypeError):
        return None
