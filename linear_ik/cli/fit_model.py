"""`linear-ik fit` of a design model: every element of a building, a folder of results."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from linear_ik.cli.outputs import check_folder, check_output
from linear_ik.cli.process import NOT_SCANNED, Outcome, about_options
from linear_ik.cli.progress import Progress
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.run_files import OUTPUTS

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from linear_ik.model_fit import ModelFit
    from linear_ik.settings import FitSettings

SUFFIXES = (".ifc", ".ifczip", ".ifcxml")
# Without a terminal: a line for a log, not one an element.
LINE_EVERY_S = 30.0
# What an estimate does not count.
THEN = {"fitting": ", then settling and colouring", "settling between neighbours": ", then colouring"}
OPTIONS = {
    "classes": "--class",
    "T_model_scan": "--transform",
    "map_coordinates": "--map",
    "memory_mb": "--memory",
    "reach_m": "--reach",
    "legend_m": "--legend",
    "length_tolerance_m": "--length-tolerance",
}


def is_model(path: Path) -> bool:
    """Say whether a file is a design model, by its ending."""
    return path.suffix.lower() in SUFFIXES


def refuse(what: str, expected: str, **options: object) -> None:
    """Raise LinearIkError about the first option that was given, where it has no meaning."""
    for name, value in options.items():
        if value is not None:
            raise LinearIkError(OPTIONS.get(name, "--" + name.replace("_", "-")), what, expected)


def fit_building(
    design: Path,
    scans: list[Path],
    output: Path,
    settings: FitSettings,
    quiet: bool,
    transform: Path | None,
    inverse: bool,
    options: Mapping[str, object],
) -> Outcome:
    """Fit a model, and say what was found.

    Args:
        design: the IFC file.
        scans: files of one scan.
        output: the folder.
        settings: of each element's fit.
        quiet: no summary and no progress.
        transform: a 4 x 4 matrix as text that takes the scan into the model's coordinates.
        inverse: it is the one that takes the model into the scan's.
        options: of ModelFitOptions; None where the person said nothing.

    Raises:
        LinearIkError: bad input.
    """
    folder = check_folder(output)
    for name in OUTPUTS:
        check_output(output / name, [design, *scans, *([] if transform is None else [transform])])
    given = {name: value for name, value in options.items() if value is not None}
    given["T_model_scan"] = transform_given(transform, inverse)
    if given.get("only") == ():
        raise LinearIkError("--only", "names no element", "GlobalIds or tags, separated by commas")
    from linear_ik.model_fit import ModelFitOptions, fit_model

    talk = _Talk(quiet)
    try:
        chosen = ModelFitOptions(**given)  # type: ignore[arg-type]
        with talk.progress.stage("reading", judges_input=True):
            found = fit_model(design, scans, folder, settings, chosen, talk)
    except KeyboardInterrupt:
        # Ctrl-C or SIGTERM; the last line is the one that every verb ends with.
        print("what is finished is kept: type the line again to go on", file=sys.stderr)
        raise
    except SettingsError as error:
        raise about_options(error, **OPTIONS) from None
    except LinearIkError as error:
        raise error.about(f"--{error.subject}") if error.subject == "scheduler" else error from None
    if not quiet:
        for line in summary(found, output):
            print(line, file=sys.stderr)
    return Outcome(0 if found.fitted else NOT_SCANNED)


def transform_given(path: Path | None, inverse: bool) -> npt.NDArray[np.float64] | None:
    """Return what --transform and --inverse say, the matrix [4][4] from the scan to the model, or None.

    Raises:
        LinearIkError: no such file, something else in it, or --inverse alone.
    """
    if path is not None:
        return read_transform(path, inverse)
    if inverse:
        raise LinearIkError("--inverse", "given without --transform", "--transform T.txt")
    return None


def read_transform(path: Path, inverse: bool = False) -> npt.NDArray[np.float64]:
    """Return the matrix [4][4] of a text file: sixteen numbers, row by row, as CloudCompare writes them.

    Raises:
        LinearIkError: no such file, or something else in it.
    """
    import numpy as np

    from linear_ik.rigid import check_rigid

    expected = "4 x 4 numbers: a rotation, a translation in metres, last row 0 0 0 1"
    try:
        text = path.read_text(encoding="utf-8")
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except OSError as error:
        raise LinearIkError(path, f"cannot be read: {error.strerror}", expected) from None
    except ValueError:
        raise LinearIkError(path, "holds something else than numbers", expected) from None
    if len(numbers) != 16:
        raise LinearIkError(path, f"holds {len(numbers)} numbers", expected)
    try:
        T = check_rigid(str(path), np.reshape(numbers, (4, 4)))
    except SettingsError as error:
        raise LinearIkError(path, error.what, error.expected) from None
    return np.asarray(np.linalg.inv(T)) if inverse else T


def summary(found: ModelFit, output: Path) -> list[str]:
    """Return the lines that a person reads at the end."""
    counts = ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in sorted(found.counts.items()))
    lines = [f"{'elements':<11}{counts}"]
    failed = [row for row in found.rows if row.result is None]
    lines += [f"{'failed':<11}{row.member.guid}: {row.failure}" for row in failed[:10]]
    if len(failed) > 10:
        lines.append(f"{'':<11}and {len(failed) - 10} more, see elements.csv")
    lines += [f"{'note':<11}{note}" for note in found.notes]
    return [*lines, f"{'written':<11}{output}: elements, {', '.join(found.files)}"]


class _Talk:
    """Says how far the run is: on a terminal in place, else a line now and then."""

    def __init__(self, quiet: bool) -> None:
        self.progress = Progress(quiet)
        self._lines = not quiet and not sys.stderr.isatty()
        self._last = time.monotonic()

    def __call__(self, stage: str, done: int, total: int, seconds: float) -> None:
        text, then = stage, THEN.get(stage, "")
        if done or total:
            text = f"{stage}: {done:,} of {total:,}" if total else f"{stage}: {done:,}"
        if math.isfinite(seconds):
            text += f" elements, {_time(seconds)} left{then}"
        self.progress.update(text)
        if self._lines and time.monotonic() - self._last > LINE_EVERY_S:
            self._last = time.monotonic()
            print(text, file=sys.stderr, flush=True)


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes}:{rest:02}"
