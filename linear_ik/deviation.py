"""Deviation: how far the as-built member is from a straight one and from its design, with 95 % bands.

Figures are those of the smooth axis (`smooth_axis`): of a curve, the nodes of the chain lie outside. The
largest offsets are looked for between the nodes too: of an arc of N segments, N odd, no node is in the
middle, and its bow is larger than that of any node by one part in N^2.

Two ways to look at a member. *Relative to the chord*: the line between its working points, the
first and the last node; what all nodes share, such as the error of the registration, cancels.
*Against the design*: where it stands.

Every figure but the twist is a sum over the nodes n_a of ``c_a e . n_a`` with a direction e, so
its variance is ``sum_ab c_a c_b e' C_ab e`` with the covariance C_ab between nodes,
``C = A S A'`` of the result's ``configuration_covariance`` S. A result without that one gets
the largest deviation that the nodes' own covariances allow, ``sum_a |c_a| sqrt(e' C_aa e)``:
wider, never too narrow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from linear_ik.deviation_bands import Bands, twist_band_rad, twist_rad
from linear_ik.deviation_figures import Curve, Figure, Sums, both, length_of
from linear_ik.directions import across, turn
from linear_ik.elastic_sag import ElasticSag
from linear_ik.errors import LinearIkError
from linear_ik.profile import Circle, CircleHollow
from linear_ik.result import FitResult
from linear_ik.smooth_axis import between_nodes, curve_of, kinks

Array = npt.NDArray[np.float64]

VERTICAL_RAD = np.radians(10.0)  # of the design's chord: within it a member is a column
UP = (0.0, 0.0, 1.0)
LEAST_CHORD = 1e-3  # of the length: ends that are nearer, as a ring's are, have no direction between them


@dataclass(frozen=True, eq=False)
class Deviations:
    """What became of a member. Metres and radians.

    Local X and Y are the element's. Relative to the chord they are turned with it by the
    smallest rotation that takes the designed direction to the fitted one. A member that was
    designed curved is compared with its designed shape, laid on the fitted chord; of one that
    own weight sags, what that explains can be part of the shape: the rest is imperfection.

    Attributes:
        length_m: of the design, along its axis.
        chord_m: between the working points as built.
        specified_m: [N+1][3] nodes of the design with its precamber and elastic sag, in the element's frame.
        vertical: whether the design's chord is within 10 degrees of the vertical.
        joint: whether bands know how nodes vary together; else they are upper bounds.
        offset_m: w(s), offset of each node from the chord.
        offset_between_m: w(s) between the nodes too, of which the largest offsets are taken.
        departure_m: offset of each node from its designed place, across the designed axis.
        departure_between_m: the same between the nodes too.
        departure_band_m: [N+1] half-width of the 95 % band of its length, along it; of none, the widest.
        slope_rad: angle of each segment against the chord, arcsin w'(s).
        curvature_1_m: at each inner node, w''(s).
        bow_m: largest offset from the chord, in any direction.
        sag_m: largest vertical offset from the chord, downwards positive; not for verticals.
        sweep_m: largest horizontal offset from the chord (without sign); not for verticals.
        camber_m: vertical offset from the chord at half the length, upwards positive; not for verticals.
        out_of_plumb_m: for verticals, horizontal offset of the end from the start, less the design's.
        twist_rad: of the end's section against the start's, about the axis; not seen on round sections.
        end_displacement_m: of the last node from its designed place, along the axis included.
        departure_max_m: the largest of ``departure_between_m``, in any direction.
        slope_max_rad: the largest of ``slope_rad``, in any direction.
        curvature_max_1_m: the largest of ``curvature_1_m``, in any direction.
        length_change_m: of the chord, against the design's.
        straight_bow_m: a straight member, scanned alike, shows a bow below this in 95 % of scans;
            None where nodes' joint covariance is not known.
    """

    length_m: float
    chord_m: float
    specified_m: Array
    vertical: bool
    joint: bool
    offset_m: Curve
    offset_between_m: Curve
    departure_m: Curve
    departure_between_m: Curve
    departure_band_m: Array
    slope_rad: Curve
    curvature_1_m: Curve
    bow_m: Figure
    sag_m: Figure
    sweep_m: Figure
    camber_m: Figure
    out_of_plumb_m: Figure
    twist_rad: Figure
    end_displacement_m: Figure
    departure_max_m: Figure
    slope_max_rad: Figure
    curvature_max_1_m: Figure
    length_change_m: Figure
    straight_bow_m: float | None


def deviations(
    result: FitResult,
    up: tuple[float, float, float] = UP,
    precamber_m: float = 0.0,
    elastic: ElasticSag | None = None,
    smooth: bool = True,
) -> Deviations:
    """Return the deviations of a fitted member.

    Bands are 1.96 standard deviations of the fit's covariance: they hold where the fit does, so
    read the result's status first.

    Args:
        result: of a fit that found the element.
        up: the vertical, in the scan's coordinates.
        precamber_m: specified rise of the middle above the chord, where the design is drawn
            without it: a parabola that is added to the designed shape. Verticals have none.
        elastic: what own weight makes of the member; added to the designed shape, so that figures are
            imperfections, its uncertainty to their bands.
        smooth: the axis is the curve behind the chain, wherever bends are alike and nodes' joint covariance
            is known; else the chain.

    Raises:
        LinearIkError: the element was not found; its ends coincide, so that there is no chord.
    """
    if result.status == "not_scanned":
        raise LinearIkError("status", "not_scanned", "the result of an element that was found")
    element, n = result.element, result.element.segments
    T = element.placement.T_world_element
    # In the element's frame: coordinates of a map would cost digits.
    nodes = (result.nodes_m - T[:3, 3]) @ T[:3, :3]
    designed, vertical = element.design.nodes_m, np.asarray(up, dtype=np.float64) @ T[:3, :3]
    vertical = vertical / np.linalg.norm(vertical)
    bands = Bands.of(result, None if elastic is None else elastic.sd_m)
    chords_m = [float(np.linalg.norm(p[-1] - p[0])) for p in (nodes, designed)]
    if min(chords_m) < LEAST_CHORD * element.length_m:
        raise LinearIkError(element.name, "its ends coincide", "a member with a chord")
    t, between = np.arange(n + 1.0), np.eye(n + 1)
    if smooth and bands.joint is not None:
        kinked = kinks(result)
        curve, (t, between) = curve_of(result, kinked), between_nodes(n, kinked)
        nodes, bands = nodes[0] + curve @ (nodes - nodes[0]), bands.carried(curve)
    chord_m, designed_chord_m = float(np.linalg.norm(nodes[-1] - nodes[0])), chords_m[1]
    chord, designed_chord = (nodes[-1] - nodes[0]) / chord_m, (designed[-1] - designed[0]) / designed_chord_m
    is_vertical = bool(abs(designed_chord @ vertical) > np.cos(VERTICAL_RAD))
    if precamber_m and not is_vertical:
        along = ((designed - designed[0]) @ designed_chord / designed_chord_m)[:, None]
        designed = designed + 4.0 * precamber_m * along * (1.0 - along) * _upwards(vertical, designed_chord)
    if elastic is not None:
        designed = designed + elastic.displacement_m
        designed_chord = (designed[-1] - designed[0]) / np.linalg.norm(designed[-1] - designed[0])
    designed_axes = turn(np.array([0.0, 0.0, 1.0]), designed_chord)[:, :2].T
    axes = designed_axes @ turn(designed_chord, chord).T  # [2][3] X and Y across the chord
    step_m = result.fitted_element.segment_length_m
    s_m = step_m * np.arange(n + 1, dtype=np.float64)

    share = (nodes - nodes[0]) @ chord / chord_m
    relative = np.eye(n + 1)  # n_k - n_0 - share_k (n_N - n_0)
    relative[:, 0] -= 1.0 - share
    relative[:, -1] -= share
    offset = (nodes - nodes[0]) @ axes.T - (designed - designed[0]) @ designed_axes.T
    offset[[0, -1]] = 0.0  # but for rounding
    step = np.diff(np.eye(n + 1), axis=0) / step_m
    bend = np.diff(step, axis=0) / step_m
    curvature = bend @ offset
    # The steps across the chord are sines: their length's arcsine is the angle, its slope 1 / cosine.
    sine = step @ offset
    size = np.minimum(np.linalg.norm(sine, axis=1), 1.0)
    slope = sine * np.where(size > 0.0, np.arcsin(size) / np.maximum(size, 1e-300), 1.0)[:, None]
    sections = np.concatenate([element.design.rotations, element.design.rotations[-1:]])[:, :, :2].transpose(0, 2, 1)
    departure = np.einsum("kij,kj->ki", sections, nodes - designed)
    departures = np.einsum("kij,ki->kj", sections, departure)
    # Across the design at each node: of a design that is curved, a slide along it is none between two nodes either.
    aside = bands.projected(np.einsum("kai,kaj->kij", sections, sections))
    at = np.floor(t).astype(int)  # the segment that a place is on, as of nodes: the one after, of the last the same
    off = Sums.of(bands, between @ relative, between @ offset @ axes, axes, t, step_m)
    away = Sums(aside, between, between @ departures, sections[at], t, step_m)
    segments: Array = np.arange(n, dtype=np.float64) + 0.5
    joints: Array = np.arange(1.0, n)

    ends = np.zeros((1, n + 1))
    ends[0, 0], ends[0, -1] = -1.0, 1.0
    last = np.zeros((1, n + 1))
    last[0, -1] = 1.0
    lean = (nodes[-1] - nodes[0]) - (designed[-1] - designed[0])
    lean = lean - (lean @ vertical) * vertical
    no_plumb = Figure(None, None, None, "not near vertical by design")
    slopes = step @ relative / np.maximum(np.sqrt(1.0 - size**2), 1e-9)[:, None]
    twist = twist_rad(result.q) - twist_rad(element.design.angles_rad[:, ::-1].ravel())
    middle = int(np.searchsorted(t, n / 2)) if n / 2 in t else None
    sag, sweep, camber = _vertical_and_sideways(off, middle, chord, vertical, is_vertical)
    return Deviations(
        length_m=element.length_m,
        chord_m=chord_m,
        specified_m=designed,
        vertical=is_vertical,
        joint=bands.joint is not None,
        offset_m=Curve(s_m, offset, both(bands, relative, axes)),
        offset_between_m=Curve(step_m * t, between @ offset, both(bands, off.rows, axes)),
        departure_m=Curve(s_m, departure, _of_sections(bands, np.eye(n + 1), sections)),
        departure_between_m=Curve(
            step_m * t, np.einsum("kij,kj->ki", sections[at], away.vectors), _of_sections(aside, between, sections[at])
        ),
        departure_band_m=Sums(bands, np.eye(n + 1), departures, sections, s_m, step_m).lengths()[1],
        slope_rad=Curve(step_m * segments, slope, both(bands, slopes, axes)),
        curvature_1_m=Curve(s_m[1:-1], curvature, both(bands, bend @ relative, axes)),
        bow_m=off.largest("offsets"),
        sag_m=sag,
        sweep_m=sweep,
        camber_m=camber,
        out_of_plumb_m=length_of(bands, ends, lean, across(vertical)) if is_vertical else no_plumb,
        twist_rad=_twist(result, twist),
        end_displacement_m=length_of(bands, last, nodes[-1] - designed[-1], np.eye(3), node=n),
        departure_max_m=away.largest("offsets"),
        slope_max_rad=Sums.of(bands, slopes, slope @ axes, axes, segments, step_m).largest("segments"),
        curvature_max_1_m=Sums.of(bands, bend @ relative, curvature @ axes, axes, joints, step_m).largest("nodes"),
        length_change_m=Figure(
            chord_m - designed_chord_m,
            float(bands.of_rows(ends, chord[None])[0]),
            None,
            f"of the chord; the length along the axis is {_length_note(result)}",
        ),
        straight_bow_m=bands.largest_of_none(relative, axes, between),
    )


def _vertical_and_sideways(
    off: Sums, middle: int | None, chord: Array, vertical: Array, is_vertical: bool
) -> tuple[Figure, Figure, Figure]:
    """Return sag, sweep and camber of the offsets from the chord, of which one is in the middle, or two about it."""
    if is_vertical:
        none = Figure(None, None, None, "near vertical by design: see bow and plumb")
        return none, none, none
    up = _upwards(vertical, chord)
    side = np.cross(chord, up)
    sag, sweep = (
        replace(off, vectors=np.outer(off.vectors @ e, e), axes=np.broadcast_to(e, (len(off.rows), 1, 3))).largest(
            "offsets", sign
        )
        for e, sign in ((up, -up), (side, None))
    )
    if sag.value is None:
        return sag, sweep, sag
    half, k = np.zeros((1, len(off.rows))), len(off.rows) // 2
    half[0, [k - 1, k] if middle is None else [middle]] = 0.5 if middle is None else 1.0
    band = float(off.bands.of_rows(half @ off.rows, up[None])[0])
    return sag, sweep, Figure(float((half @ off.vectors @ up)[0]), band, None, "at half the length")


def _of_sections(bands: Bands, rows: Array, sections: Array) -> Array:
    """Return the half-widths [K][2] of rows of coefficients along both axes of a section [K][2][3] each."""
    return np.stack([bands.of_rows(rows, sections[:, i]) for i in (0, 1)], axis=-1)


def _length_note(result: FitResult) -> str:
    if result.length_m is None:
        return "taken from the design"
    return f"{result.length_m:.4f} m by the ends of the scan"


def _twist(result: FitResult, twist: float) -> Figure:
    if isinstance(result.element.profile, (Circle, CircleHollow)):
        return Figure(None, None, None, "a round section does not show its twist")
    if result.element.segments == 1:
        return Figure(None, None, None, "one segment cannot twist")
    if result.configuration_covariance is None:
        return Figure(None, None, None, "the result does not say how its joints vary together")
    return Figure(twist, twist_band_rad(result.q, result.configuration_covariance))


def _upwards(vertical: Array, chord: Array) -> Array:
    """Return the unit vector across the chord that is the nearest to the vertical."""
    up = vertical - (vertical @ chord) * chord
    return np.asarray(up / np.linalg.norm(up))
