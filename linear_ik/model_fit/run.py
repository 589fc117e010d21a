"""The run: a design model and a site's scan in, a folder of as-built elements out."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from linear_ik.atomic import same_file, write_atomically
from linear_ik.design_model import DesignModel
from linear_ik.errors import LinearIkError, OutputError
from linear_ik.exports.result_json import versions
from linear_ik.model_fit.colours import Coloured, colour_scan, coloured_before
from linear_ik.model_fit.fits import Fits, Row
from linear_ik.model_fit.folder import RunFolder, fingerprint
from linear_ik.model_fit.handed_out import HandedOut, Listener, Pieces, check_unchanged, scan_inputs
from linear_ik.model_fit.kept_results import Facts
from linear_ik.model_fit.options import ModelFitOptions
from linear_ik.model_fit.ownership import SCHEMA, check_ours, note_design
from linear_ik.model_fit.placing import check_place, scan_to_model, why_nothing
from linear_ik.model_fit.pool import make_pool
from linear_ik.model_fit.selection import select
from linear_ik.model_fit.table import write_table
from linear_ik.readers import CHUNK_POINTS, iter_scan
from linear_ik.run_files import ASBUILT, OUTPUTS, REPORT, TABLE
from linear_ik.scan import Scan, no_points
from linear_ik.scan_sample import ScanSample
from linear_ik.settings import FitSettings
from linear_ik.site.handout import boxes_back, moved

Array = npt.NDArray[np.float64]

BYTES_A_POINT = 400  # while a piece of the scan is handed out


@dataclass(frozen=True, eq=False)
class ModelFit:
    """What a run found.

    Attributes:
        rows: one for each element, in the design's order; histories and joint covariances are in the files alone.
        folder: where the files are.
        counts: how many elements there are of each status.
        files: names of the files in the folder beside ``elements``.
        notes: plain sentences on what was left out and why.
    """

    rows: tuple[Row, ...]
    folder: Path
    counts: dict[str, int]
    files: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def fitted(self) -> int:
        """Number of elements that are in the scan."""
        return sum(n for status, n in self.counts.items() if status not in ("not_scanned", "failed"))


def fit_model(
    design: str | os.PathLike[str] | DesignModel,
    scan_paths: Sequence[str | os.PathLike[str]],
    output_folder: str | os.PathLike[str],
    settings: FitSettings | None = None,
    options: ModelFitOptions | None = None,
    on_progress: Listener | None = None,
) -> ModelFit:
    """Fit every linear element of a design model to one scan of the site.

    Results are in the model's coordinates. A run that was interrupted goes on where it
    stopped when it is started again; elements whose inputs are unchanged are not fitted again.
    A script that calls this keeps its own work below ``if __name__ == "__main__":``, because
    worker processes import it; with ``workers=0`` there are none.

    Args:
        design: an IFC file, or a model.
        scan_paths: one or more files of one scan.
        output_folder: gets ``elements/<GlobalId>.json``, ``elements.csv``, ``deviation.ply``,
            ``deviation.laz``, ``asbuilt.ifc`` (from an IFC file) and ``run.json``.
        settings: of each element's fit.
        options: of the run.
        on_progress: called with each step, see `Listener`.

    Raises:
        LinearIkError: bad input, or files in the folder that no run of this design wrote; nothing was written then.
    """
    settings, options = settings or FitSettings(), options or ModelFitOptions()
    listener = on_progress or (lambda *_: None)
    chunk = int(min(CHUNK_POINTS, max(10_000, options.memory_mb * 2**20 / 4 / BYTES_A_POINT)))
    paths = [Path(path) for path in scan_paths]
    if not paths:
        raise LinearIkError("scan", "no files", "at least one")

    def pieces(near: Array) -> Iterator[Scan]:
        within = boxes_back(near, T)
        for path in paths:
            yield from moved(iter_scan(path, chunk, within, options.scan_unit), T)
            check_unchanged(paths, scans)

    design_path = None if isinstance(design, DesignModel) else Path(design)
    _keep_inputs(Path(output_folder), paths if design_path is None else [design_path, *paths])
    source = design.source if isinstance(design, DesignModel) else Path(design).name
    check_ours(Path(output_folder), source, design_path, OUTPUTS, options.overwrite)
    for path in paths:
        iter_scan(path, chunk)  # says at once what can be seen from outside
    scans = scan_inputs(paths, options.scan_unit)
    listener("reading the design", 0, 0, float("nan"))
    model = design if isinstance(design, DesignModel) else _read_design(Path(design), listener)
    T = scan_to_model(model, options)
    members, obstacles = select(model, options)
    folder = RunFolder(Path(output_folder), [member.guid for member in model.members])
    pool = make_pool(options.workers, options.scheduler, len(members), lambda what: listener(what, 0, 0, float("nan")))
    clock = _Clock()
    try:
        folder.make()
        fits = Fits(members, obstacles, settings, options, folder, scans, T)
        # Who has said how the scan lies, or in what unit it is, is believed.
        doubted = paths[0] if T is None and options.scan_unit is None else None
        points = _hand_out(fits, folder, model, pieces, doubted, listener)
        note_design(folder.path, model.source, design_path)
        folder.begin()
        fits.take_over()
        clock.lap("hand_out")
        fits.first(points, pool, listener)
        clock.lap("first_fits")
        fits.contest(points, pool, listener)
        clock.lap("contest")
        pool.close()
        about: Facts = {
            "scans": [path.name for path in paths],
            "coordinates": "the model's; " + ("as the scan's" if T is None else "T_model_scan was used"),
            "T_model_scan": (np.eye(4) if T is None else T).tolist(),
        }
        return _write(fits, model, design_path, pieces, about, clock, listener)
    finally:
        pool.close()
        folder.release()


def _keep_inputs(folder: Path, inputs: Sequence[Path]) -> None:
    """Refuse a folder in which a file that is read would be replaced or removed.

    Raises:
        OutputError: it is one.
    """
    for name in OUTPUTS:
        if any(same_file(folder / name, path) for path in inputs):
            raise OutputError(folder / name, "is one of the files that are read", "another folder")


class _Clock:
    def __init__(self) -> None:
        self._began = self._last = time.perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self._laps[name], self._last = self._laps.get(name, 0.0) + now - self._last, now

    def timings_s(self) -> dict[str, float]:
        return {**self._laps, "total": time.perf_counter() - self._began}


def _hand_out(
    fits: Fits, folder: RunFolder, model: DesignModel, pieces: Pieces, doubted: Path | None, listener: Listener
) -> HandedOut | None:
    """Take over what is known and hand out the scan; leave nothing behind where that comes to no good.

    A ``doubted`` scan, by its file, is refused where it is beyond doubt in other coordinates than the model.
    """
    sample = ScanSample()
    try:
        points = fits.prepare(lambda near: sample.of(pieces(near)), listener)
        if doubted is not None:
            check_place(model, sample.points, fits.extent, doubted)
        return points
    except LinearIkError:
        folder.take_back()
        raise
    except KeyboardInterrupt:
        folder.clear_part()
        raise


def _write(
    fits: Fits, model: DesignModel, design: Path | None, pieces: Pieces, about: Facts, clock: _Clock, listener: Listener
) -> ModelFit:
    """Write the files that are about all elements; return what was found.

    The clouds come last, when the points that waited are gone: where they fill the disk, all else is there.
    """
    folder, options, rows = fits.folder.path, fits.options, fits.rows
    files, notes = [], [*model.notes, *fits.folder.notes]
    if fits.extent and not fits.extent["in_a_neighbourhood"]:
        notes.append(why_nothing(model, np.array([fits.extent["low_m"], fits.extent["high_m"]])))
    if fits.extent.get("left_out"):
        notes.append(f"left out of the scan: {no_points(fits.extent['left_out'])}")
    if mixed := fits.extent.get("elements_with_mixed_stations"):
        some = f"{mixed} elements have" if mixed > 1 else "1 element has"
        notes.append(f"{some} points of unknown stations among others: there no station was used")
    whole = fits.whole
    write_table((replace(row, result=whole.get(row.member.guid)) for row in rows), folder / TABLE)
    if design is not None:
        listener("writing asbuilt.ifc", 0, 0, float("nan"))
        from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc

        def on_left(guid: str, what: str) -> None:
            notes.append(f"{guid} is as designed in {ASBUILT}: {what}")

        remarks = {member.guid: member.remark for member in model.members}
        write_asbuilt_ifc(design, whole, folder / ASBUILT, remarks=remarks, on_left=on_left)
        files.append(ASBUILT)
    counts = dict(Counter(row.status for row in rows))

    def report(coloured: Coloured) -> None:
        clock.lap("files")
        facts: Facts = {
            "schema": SCHEMA,
            "design": model.source,
            "counts": {"elements": len(rows), **counts},
            "left_out": [asdict(left) for left in model.left_out],
            "notes": [*notes, *coloured.notes],
            "settings": asdict(fits.settings),
            "options": {
                k: v for k, v in vars(options).items() if k not in ("T_model_scan", "workers", "scheduler", "overwrite")
            },
            "deviation": coloured.legend,
            "scan_points": fits.extent,
            "where": {"workers": options.workers, "scheduler": options.scheduler, "fitted_now": len(fits.fitted_now)},
            "versions": versions(),
            **about,
            "timings_s": clock.timings_s(),
        }
        write_atomically(folder / REPORT, json.dumps(facts, indent=1, default=list) + "\n")

    shapes = {guid: result.nodes_m.tolist() for guid, result in fits.results.items()}
    inputs = fingerprint(fits.inputs, options.legend_m, shapes)
    coloured = None if fits.fitted_now else coloured_before(folder, inputs)
    report(coloured or Coloured())
    fits.folder.end()
    if coloured is None:
        coloured = colour_scan(pieces, fits, folder, options, inputs, listener)
        report(coloured)
    return ModelFit(tuple(rows), folder, counts, (TABLE, *coloured.files, *files, REPORT), (*notes, *coloured.notes))


def _read_design(path: Path, listener: Listener) -> DesignModel:
    from linear_ik.bim import read_design

    def on_progress(done: int, total: int) -> None:
        listener("reading the design", done, total, float("nan"))

    return read_design(path, on_progress=on_progress)
