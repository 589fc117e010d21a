"""Align: the rigid motion that takes a scan into a design's coordinates."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from linear_ik.alignment.hypotheses import (
    FEW_POINTS,
    NEARLY_THE_SAME,
    Judged,
    best_judged,
    best_rough,
    differs,
    settled,
)
from linear_ik.alignment.quality import TIGHT_M, Cloud, Quality, moved, quality
from linear_ik.alignment.refine import freedom
from linear_ik.alignment.search import any_candidates, levelled_candidates
from linear_ik.alignment.slides import FAR, NEAR
from linear_ik.alignment.target import Target
from linear_ik.alignment.thinning import thin
from linear_ik.design_model import DesignModel
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.readers import iter_scan
from linear_ik.rigid import check_rigid
from linear_ik.scan import Scan, no_points

Array = npt.NDArray[np.float64]
Points = Scan | npt.NDArray[np.float64] | str | os.PathLike[str]
AlignStatus = Literal["aligned", "ambiguous", "not_found"]

VOXEL_M = 0.03
MOST_JUDGED = 50_000  # points that hypotheses are judged by
NEAR_START_M = 0.3  # how far off a person's guess may be
ALIKE = 0.985  # of the score: a plate seen from one side is told from its other by a few per cent
# Of wrong scans, measured: both shares below 0.2.
LEAST_SHARE = 0.3
LEAST_SCORE = 0.08
SLIDES = 0.02
TILTED_DEG = 0.2


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another way to lay the scan on the design.

    Attributes:
        T_model_scan: [4][4].
        score: as `Alignment.score`.
    """

    T_model_scan: Array
    score: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """A scan laid on a design.

    Attributes:
        status: aligned | ambiguous (another hypothesis is nearly as good) | not_found.
        reasons: plain sentences: why it is not aligned, and what else the reader should know.
        T_model_scan: [4][4] from the scan's coordinates to the model's, metres; the best found, whatever the status.
        rms_m: of the scan points within 20 mm of the design's faces.
        scan_share: of the scan's points that are within 20 mm of a face that can have been seen, one point a voxel.
        model_share: of the design's faces that the scan shows.
        score: harmonic mean of both shares, each averaged with what it is for the members alone.
        voxel_m: edge of the voxels.
        tilt_deg: between the scan's z and the model's.
        alternatives: the other hypotheses, the best first.
    """

    status: AlignStatus
    reasons: tuple[str, ...]
    T_model_scan: Array
    rms_m: float
    scan_share: float
    model_share: float
    score: float
    voxel_m: float
    tilt_deg: float
    alternatives: tuple[Alternative, ...]


def align(
    design: DesignModel,
    *scans: Points,
    near: npt.ArrayLike | None = None,
    levelled: bool = True,
    on_step: Callable[[str, float], None] | None = None,
    unit: str | None = None,
) -> Alignment:
    """Return the rigid motion that takes a scan into the model's coordinates.

    The search needs no guess: all headings and translations of a levelled scan (z up) are scored at once by
    correlating occupied voxels; a scan that is not levelled goes through features and RANSAC. The best hypotheses are
    refined, point to plane with a robust kernel, on the design's own faces; members that deviate count nothing.
    Others beside them, up to a storey up and down, compete with them, so that the underside of a slab is not taken
    for its top. Faces of slabs and walls count for what can have been measured on them: from the outside, seen
    from the station; where stations are unknown, no face that looks down counts with nothing of the scan below it.
    The last refinement turns about all axes.

    Args:
        design: members and obstacles.
        scans: of one registration, all in the same coordinates: Scan, points [P][3], or files, read piece by
            piece and thinned to one point a voxel.
        near: [4][4] a guess within about 0.3 m, in place of the search.
        levelled: the scanner was levelled: z is up, in the model too.
        on_step: called with what is being done and the share of it that is.
        unit: of the files' numbers, as for `read_scan`.

    Raises:
        SettingsError: no scan, a guess that is no rigid motion, another unit.
        ScanError: a scan without points, or a file that cannot be read.
        LinearIkError: a design without bodies.
    """
    say = on_step if on_step is not None else lambda what, share: None
    if not scans:
        raise SettingsError("scans", "none", "at least one")
    guess = None if near is None else check_rigid("near", near)
    if not (design.members or any(len(o.triangles) for o in design.obstacles)):
        raise LinearIkError(design.source, "has no bodies", "members or obstacles to lay a scan on")
    say("reading", 0.0)
    left_out: list[int] = []
    thinned = thin(_parts(scans, unit, left_out.append), VOXEL_M)
    rows, voxel_m = thinned.points(), thinned.voxel_m
    say("reading", 1.0)
    target = Target(design)
    # Single precision comes later: both clouds about origins of their own.
    centre = np.round((rows[:, :3].min(axis=0) + rows[:, :3].max(axis=0)) / 2)
    rows = rows - np.tile(centre, 2)
    local, cloud = rows[:, :3], _cloud(rows, voxel_m)
    mixed = local[np.random.default_rng(0).permutation(len(local))]
    few = mixed[:FEW_POINTS]

    def step(what: str) -> Callable[[float], None]:
        say(what, 0.0)
        return lambda share: say(what, share)

    if not levelled and guess is None:
        # Stood upright on the design by one good hypothesis, the scan has all others by turning about z.
        tilted, near_m = any_candidates(target.samples, local, step("searching by features"))
        stood = best_rough(target, few, tilted, near_m, False, step("refining"))[0][1]
        upright, near_m = levelled_candidates(target.samples, moved(local, stood), step("searching"))
        candidates = [stood, *(np.asarray(T @ stood) for T in upright)]
    elif guess is not None:
        start = guess.copy()
        start[:3, 3] = guess[:3, :3] @ centre + guess[:3, 3] - target.origin_m
        candidates, near_m = [start], NEAR_START_M
    else:
        candidates, near_m = levelled_candidates(target.samples, local, step("searching"))
    about_z = levelled and guess is None
    rough = best_rough(target, few, candidates, near_m, about_z, step("refining"))
    found = best_judged(target, cloud, mixed, rough, FAR if guess is None else NEAR, about_z, step("comparing"))
    q, best = found[0]
    thin_apart: list[Judged] = []
    if _is_found(q):
        say("settling", 0.0)
        best, thin_apart = settled(target, cloud, mixed, best)
        q = quality(target, cloud, best)
    others = [one for one in found[1:] if differs(one.T, best)]
    held, direction = freedom(target, local, best)
    tilt_deg = float(np.degrees(np.arccos(np.clip(best[2, 2], -1.0, 1.0))))
    status, reasons = _judge(q, [one.quality for one in others], held, direction, tilt_deg, levelled)
    if thinned.dropped:
        far = f"Points left out, more than {thinned.reach_km:.0f} km from the others: {thinned.dropped:,}."
        reasons = (*reasons, far)
    if sum(left_out):
        reasons = (*reasons, f"Left out: {no_points(sum(left_out))}.")

    def in_model(T: Array) -> Array:
        out = T.copy()
        out[:3, 3] += target.origin_m - T[:3, :3] @ centre
        return np.asarray(out)

    same = [one for one in thin_apart[1:] if one.quality.score >= ALIKE * thin_apart[0].quality.score]
    if same and status == "aligned":
        apart_mm = 1000 * float(np.linalg.norm(same[0].T[:3, 3] - best[:3, 3]))
        status = "ambiguous"
        reasons = (f"{apart_mm:.0f} mm beside it, it lies as well: the two sides of a plate?", *reasons)
    alternatives = tuple(Alternative(in_model(one.T), one.quality.score) for one in others)
    return Alignment(
        status, reasons, in_model(best), q.rms_m, q.scan_share, q.model_share, q.score, voxel_m, tilt_deg, alternatives
    )


def _cloud(rows: Array, voxel_m: float) -> Cloud:
    """Return points and stations [P][6] of larger voxels, where there are many of them."""
    if len(rows) > MOST_JUDGED:
        thinned = thin([rows], voxel_m, MOST_JUDGED)
        rows, voxel_m = thinned.points(), thinned.voxel_m
    return Cloud(rows[:, :3], rows[:, 3:], voxel_m)


def _is_found(q: Quality) -> bool:
    return max(q.scan_share, q.model_share) >= LEAST_SHARE and q.score >= LEAST_SCORE


def _judge(
    q: Quality, others: list[Quality], held: float, direction: Array, tilt_deg: float, levelled: bool
) -> tuple[AlignStatus, tuple[str, ...]]:
    if not _is_found(q):
        return "not_found", (
            f"The best position explains {100 * q.scan_share:.0f} % of the scan and shows {100 * q.model_share:.0f} % "
            f"of the design, within {1000 * TIGHT_M:.0f} mm.",
            "The scan seems to be of something else, or a guess was far off.",
        )
    reasons = []
    status: AlignStatus = "aligned"
    same = [other for other in others if other.score >= NEARLY_THE_SAME * q.score]
    if same:
        status = "ambiguous"
        reasons.append(
            f"{len(same)} other position{'s are' if len(same) > 1 else ' is'} nearly as good (score "
            f"{same[0].score:.3f} beside {q.score:.3f}): a symmetric design? A guess (near) settles it."
        )
    if held < SLIDES:
        status = "ambiguous"
        along = ", ".join(f"{v:.2f}" for v in direction)
        reasons.append(f"Hardly a face holds it along ({along}) in the model: it may have slid.")
    if levelled and tilt_deg > TILTED_DEG:
        reasons.append(f"The scan's z is {tilt_deg:.2f} degrees off the model's: was the scanner levelled?")
    return status, tuple(reasons)


def _parts(scans: tuple[Points, ...], unit: str | None, on_left_out: Callable[[int], None]) -> Iterator[Array]:
    """Yield points with the stations that they were measured from [P][6], NaN where that is unknown."""
    for scan in scans:
        if isinstance(scan, Scan):
            parts: Iterable[Scan] = [scan]
        elif isinstance(scan, np.ndarray):
            parts = [Scan(scan)]
        else:
            parts = iter_scan(scan, unit=unit)
        for part in parts:
            on_left_out(part.left_out)
            stations = np.full(part.points.shape, np.nan)
            if part.stations is not None and part.station_index is not None:
                stations = part.stations[part.station_index]
            yield np.column_stack([part.points, stations])
