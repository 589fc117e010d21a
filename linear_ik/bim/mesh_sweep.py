"""Meshes and Breps -> Sweep: the direction that runs through the body, and its section where it is cut.

A body is taken for linear when most cuts across its longest direction show one and the same
section, or sections whose corners lie on straight lines, or the same section shifted along a
gentle curve; notches and copes may spoil a few.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from linear_ik.bim.mesh_section import Section, cut
from linear_ik.bim.placed_profile import PlacedProfile
from linear_ik.bim.profiles import ProfileReader
from linear_ik.bim.rounding import without_flat_corners
from linear_ik.bim.sweep import Sweep, into, line_frame, seated
from linear_ik.errors import DesignError, ElementError
from linear_ik.profile import Polygon, Profile
from linear_ik.taper import check_taper

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

CUTS = 11
CURVE_CUTS = 41
FROM, TO = 0.04, 0.96  # of the length
SHARE = 0.6  # of the cuts that show the section
PARALLEL = np.cos(np.radians(6.0))  # the corners of a taper lean to all sides
EXACTLY = np.cos(np.radians(0.05))
CANDIDATES = 3
FLAT = 1 / 3  # of both other sides: a plate


def sweeps_of_mesh(
    vertices: Array, triangles: Triangles, profiles: ProfileReader, slenderness: float, tolerance_m: float
) -> tuple[list[Sweep], str]:
    """Return what sections along what lines a body that is only a mesh may be, the likeliest first.

    Args:
        vertices: [V][3] metres, in the product's coordinates.
        triangles: [T][3].
        profiles: tells what the section is.
        slenderness: least length against the section's larger side.
        tolerance_m: how far the sections of one body may differ.

    Returns:
        The sweeps, and where there are none the reason: not slender, or a section that changes.
    """
    found: list[Sweep] = []
    reason = ""
    for direction in directions(vertices, triangles):
        T = line_frame(np.zeros(3), direction, _side(direction))
        local = into(T, vertices)
        sides = box_sides(local)
        if sides[0] + 1e-6 < slenderness * sides[1]:
            reason = reason or f"it is {shape(sides)}"
            continue
        try:
            found.append(_cut_along(T, local, triangles, profiles, tolerance_m))
        except (DesignError, ElementError) as error:
            reason = f"its body {error.what}"
    return found, reason or "its body has no edge"


def shape(sides: Array, full: bool = True) -> str:
    """Say what a body of these sides [3] is that is not slender; only a full section makes a plate."""
    long, middle, short = np.sort(sides)[::-1]
    kind = "a plate" if full and short < FLAT * middle else "a stub"
    return f"{kind}, not linear: {1000 * long:.0f} x {1000 * middle:.0f} x {1000 * short:.0f} mm"


def box_sides(local: Array) -> Array:
    """Return the length of a body [V][3] along Z, and the sides of the smallest rectangle around it, seen along Z."""
    import shapely

    box = shapely.minimum_rotated_rectangle(shapely.multipoints(local[:, :2]))
    corners = np.array(box.exterior.coords) if box.geom_type == "Polygon" else local[:3, :2]
    sides = np.sort(np.linalg.norm(np.diff(corners[:3], axis=0), axis=1))[::-1]
    return np.array([np.ptp(local[:, 2]), *sides])


def directions(vertices: Array, triangles: Triangles) -> list[Array]:
    """Return the directions [3] that most of a body's sharp edges run in, the longest sum first."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(areas, 1e-12)[:, None]
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    of = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, of = edges[order], of[order]
    pair = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    flat = np.zeros(len(edges), dtype=bool)
    smooth = np.einsum("ij,ij->i", normals[of[pair]], normals[of[pair + 1]]) > 0.9999
    flat[pair[smooth]] = flat[pair[smooth] + 1] = True
    vectors = (vertices[edges[:, 1]] - vertices[edges[:, 0]])[~flat]
    lengths = np.linalg.norm(vectors, axis=1)
    keep = lengths > 1e-6
    vectors, lengths = vectors[keep], lengths[keep]
    units = vectors / lengths[:, None]
    # Edges of one direction may be listed either way.
    found: list[tuple[float, Array]] = []
    left = np.argsort(-lengths)
    while len(left) and len(found) < 6 * CANDIDATES:
        lead = units[left[0]]
        cosines = units[left] @ lead
        same = np.abs(cosines) > PARALLEL
        rows = left[same]
        # Edges of other parts run nearly so; those of a taper lean to all sides.
        exact = np.abs(cosines[same]) > EXACTLY
        whole = float(lengths[rows].sum())
        for some in (exact, ~exact | exact) if not exact.all() else (exact,):
            mean = (units[rows[some]] * (np.sign(cosines[same][some]) * lengths[rows[some]])[:, None]).sum(axis=0)
            found.append((whole, _upright(mean / np.linalg.norm(mean))))
        left = left[~same]
    found.sort(key=lambda one: -one[0])
    return [direction for _, direction in found[: 2 * CANDIDATES]]


def _cut_along(T: Array, local: Array, triangles: Triangles, profiles: ProfileReader, tolerance_m: float) -> Sweep:
    low, high = float(local[:, 2].min()), float(local[:, 2].max())
    single = _cuts(local, triangles, low, high, CUTS)
    if len(single) < SHARE * CUTS:
        raise DesignError("its body", "is cut into several pieces across its length")
    group = max((_alike(single, one, tolerance_m) for one in single), key=len)
    if len(group) >= SHARE * CUTS:
        placed = profiles.drawn(group[0].outline, group[0].holes)
        return Sweep(_at(seated(T, placed), low), placed.profile, high - low)
    curved = _curved(T, local, triangles, low, high, profiles, tolerance_m)
    return curved or _tapered(T, single, low, high, profiles, tolerance_m)


def _cuts(local: Array, triangles: Triangles, low: float, high: float, count: int) -> list[Section]:
    """Return the cuts that show one piece; what is in another one's hole is not seen from outside."""
    shares = np.linspace(FROM, TO, count) + 1.37e-4  # away from the round numbers where vertices are
    cuts = [visible(cut(local, triangles, low + share * (high - low))) for share in shares]
    return [pieces[0] for pieces in cuts if len(pieces) == 1]


def _curved(
    T: Array, local: Array, triangles: Triangles, low: float, high: float, profiles: ProfileReader, tolerance_m: float
) -> Sweep | None:
    """Return a sweep along the middles of sections that are the same but shifted, as of a cambered beam, or None."""
    sections = _cuts(local, triangles, low, high, CURVE_CUTS)
    if len(sections) < 0.9 * CURVE_CUTS:
        return None
    middles = np.array([(s.outline.min(axis=0) + s.outline.max(axis=0)) / 2 for s in sections])
    moved = [replace(s, outline=s.outline - m) for s, m in zip(sections, middles, strict=True)]
    if len(_alike(moved, moved[len(moved) // 2], tolerance_m)) < 0.9 * CURVE_CUTS:
        return None
    k = len(moved) // 2
    placed = profiles.drawn(moved[k].outline, tuple(hole - middles[k] for hole in sections[k].holes))
    line = np.column_stack([middles + placed.t_m, [s.z_m for s in sections]])
    for end, before, z in ((0, 1, low), (-1, -2, high)):
        leg = line[end] - line[before]
        line[end] = line[end] + leg * ((z - line[end, 2]) / leg[2])
    start = line_frame(line[0], line[1] - line[0], np.append(placed.R[:, 0], 0.0))
    axis = into(start, line)
    length_m = float(np.linalg.norm(np.diff(axis, axis=0), axis=1).sum())
    return Sweep(T @ start, placed.profile, length_m, axis_m=axis)


def visible(pieces: list[Section]) -> list[Section]:
    """Return the pieces of a cut, the largest first, that are not inside the largest one's outline."""
    import shapely

    if len(pieces) < 2:
        return pieces
    pieces = sorted(pieces, key=lambda piece: -shapely.Polygon(piece.outline).area)
    outer = shapely.Polygon(pieces[0].outline)
    return [pieces[0], *(p for p in pieces[1:] if not outer.contains(shapely.Point(*p.outline[0])))]


def _tapered(
    T: Array, sections: list[Section], low: float, high: float, profiles: ProfileReader, tolerance_m: float
) -> Sweep:
    """Return a sweep whose corners lie on straight lines from its first section to its last."""
    changes = DesignError("its body", "changes its section along its length")
    outlines = [without_flat_corners(np.asarray(Polygon(s.outline).outline())) for s in sections]  # type: ignore[arg-type]
    if len({len(outline) for outline in outlines}) != 1:
        raise changes
    rings = [outlines[0]]
    for outline in outlines[1:]:
        rings.append(min((np.roll(outline, k, axis=0) for k in range(len(outline))), key=lambda r: _far(r, rings[-1])))
    z = np.array([s.z_m for s in sections])
    corners = np.array(rings)
    flat = corners.reshape(len(z), -1)
    A = np.column_stack([np.ones_like(z), z])
    line, *_ = np.linalg.lstsq(A, flat, rcond=None)
    if np.abs(A @ line - flat).max() > tolerance_m:
        raise changes
    first, last = (np.asarray((line[0] + at * line[1]).reshape(-1, 2)) for at in (low, high))
    # The line through the middles of both ends, where it leans: sections are square to it.
    holes = sections[0].holes, sections[-1].holes
    ends = [profiles.drawn(outline, hole) for outline, hole in zip((first, last), holes, strict=True)]
    middles = [T[:3, :3] @ np.append(end.t_m, at) for end, at in zip(ends, (low, high), strict=True)]
    leaning = bool(np.linalg.norm(ends[0].t_m - ends[1].t_m) > tolerance_m)
    profile, profile_end = _pair(ends, leaning, first, last)
    if leaning:
        seat = PlacedProfile(profile, np.eye(2), ends[0].t_m)
        return Sweep(_at(seated(T, seat), low), profile, high - low, profile_end)
    frame = line_frame(middles[0], middles[1] - middles[0], T[:3, :3] @ np.append(ends[0].R[:, 0], 0.0))
    return Sweep(frame, profile, float(np.linalg.norm(middles[1] - middles[0])), profile_end)


def _pair(ends: list[PlacedProfile], leaning: bool, first: Array, last: Array) -> tuple[Profile, Profile]:
    start, end = ends[0].profile, ends[1].profile
    if not leaning and np.abs(ends[0].R - ends[1].R).max() < 1e-3:
        try:
            check_taper(start, end)
            return start, end
        except ElementError:
            pass
    origin = ends[0].t_m
    return Polygon(first - origin), Polygon(last - origin)  # type: ignore[arg-type]


def _alike(sections: list[Section], one: Section, tolerance_m: float) -> list[Section]:
    """Return those of the sections that are the same as one, the one first."""
    import shapely

    def same(other: Section) -> bool:
        return bool(shapely.hausdorff_distance(ring, shapely.linearrings(other.outline)) <= tolerance_m)

    ring = shapely.linearrings(one.outline)
    return [one, *(s for s in sections if s is not one and same(s))]


def _far(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max())


def _at(T: Array, z_m: float) -> Array:
    """Return a frame moved along its own Z."""
    moved = np.array(T)
    moved[:3, 3] += z_m * T[:3, 2]
    return moved


def _upright(direction: Array) -> Array:
    """Return a direction so that its largest component is positive: a mesh has no start of its own."""
    return np.asarray(direction if direction[np.abs(direction).argmax()] > 0 else -direction)


def _side(direction: Array) -> Array:
    """Return the axis of the product's coordinates that is most across a direction."""
    return np.asarray(np.eye(3)[np.abs(direction).argmin()])
