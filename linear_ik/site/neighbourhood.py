"""Neighbourhood: where an element's points may be, found for many points and many elements at once.

An element's neighbourhood is its designed body grown by a reach: one box along a straight
axis, one a segment along a curved one. A grid of cells over all boxes names the few that a
point can be in, so that the cost of a point does not grow with the number of elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.element import Element

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

STRETCHES = 32  # of an element's length, each with an equal share of its points
MOST_CELLS = 4_000_000
SMALLEST_CELL_M = 0.25


class Boxes(NamedTuple):
    """Oriented boxes.

    Attributes:
        R: [B][3][3] orientation, R_world_box.
        origin_m: [B][3] of the box's frame, in the world.
        low_m, high_m: [B][3] in the box's frame.
        share: [B][2] of the element's length at which the box's z = 0 is, and for each metre of z.
    """

    R: Array
    origin_m: Array
    low_m: Array
    high_m: Array
    share: Array


class Pairs(NamedTuple):
    """Points in neighbourhoods, each point and member once, ordered by member.

    Attributes:
        row: [M] of the point.
        member: [M] whose neighbourhood it is in.
        stretch: [M] of the member's length that it is beside, 0 to STRETCHES - 1.
    """

    row: Index
    member: Index
    stretch: npt.NDArray[np.uint8]


def boxes_of(element: Element, reach_m: float) -> Boxes:
    """Return the boxes of an element's neighbourhood in the coordinates of its placement (the model's).

    Args:
        element: the design.
        reach_m: how far from the designed surface its points may be, across the axis and
            beyond the ends.
    """
    T = element.placement.T_world_element
    profiles = [p.outline() for p in (element.profile_at(0.0), element.profile_at(1.0))]
    low = np.append(np.min([p.min(axis=0) for p in profiles], axis=0), 0.0) - reach_m
    high = np.append(np.max([p.max(axis=0) for p in profiles], axis=0), 0.0) + reach_m
    if element.axis_points is None:
        high[2] += element.length_m
        share = np.array([[0.0, 1.0 / element.length_m]])
        return Boxes(T[None, :3, :3], T[None, :3, 3], low[None], high[None], share)
    design, n = element.design, element.segments
    high[2] += design.segment_length_m
    share = np.column_stack([np.arange(n) / n, np.full(n, 1 / (n * design.segment_length_m))])
    origins = design.nodes_m[:-1] @ T[:3, :3].T + T[:3, 3]
    return Boxes(T[:3, :3] @ design.rotations, origins, np.tile(low, (n, 1)), np.tile(high, (n, 1)), share)


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """The neighbourhoods of all elements, and the grid that finds them.

    Attributes:
        boxes: of all elements.
        owner: [B] the element of each box.
        low_m: [3] corner of the grid.
        cell_m: size of its cells.
        shape: [3] cells along x, y and z.
        starts: [cells + 1] first entry of each cell in ``candidates``.
        candidates: boxes that reach into a cell.
    """

    boxes: Boxes
    owner: Index
    low_m: Array
    cell_m: float
    shape: Index
    starts: Index
    candidates: Index

    @classmethod
    def of(cls, elements: Sequence[Element], reach_m: Sequence[float]) -> Neighbourhoods:
        """Lay the grid over the neighbourhoods of at least one element, each with its own reach."""
        parts = [boxes_of(element, reach) for element, reach in zip(elements, reach_m, strict=True)]
        boxes = Boxes(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        owner = np.repeat(np.arange(len(parts)), [len(part.R) for part in parts])
        low, high = _bounds(boxes)
        corner, extent = low.min(axis=0), high.max(axis=0) - low.min(axis=0)
        cell_m = max(SMALLEST_CELL_M, float(np.cbrt(np.prod(extent) / MOST_CELLS)))
        shape = (extent / cell_m).astype(np.intp) + 1
        cells, owners = [], []
        for b in range(len(owner)):
            found = _cells(boxes, b, low[b], high[b], corner, cell_m, shape)
            cells.append(found)
            owners.append(np.full(len(found), b))
        cell, candidate = np.concatenate(cells), np.concatenate(owners)
        order = np.argsort(cell, kind="stable")
        starts = np.searchsorted(cell[order], np.arange(int(np.prod(shape)) + 1))
        return cls(boxes, owner, corner, cell_m, shape, starts, candidate[order])

    def pairs(self, points: Array) -> Pairs:
        """Return which of ``points`` [P][3] are in whose neighbourhood."""
        cell = ((points - self.low_m) / self.cell_m).astype(np.intp)
        inside = ((points >= self.low_m).all(axis=1) & (cell < self.shape).all(axis=1)).nonzero()[0]
        flat = (cell[inside, 0] * self.shape[1] + cell[inside, 1]) * self.shape[2] + cell[inside, 2]
        first, count = self.starts[flat], self.starts[flat + 1] - self.starts[flat]
        busy = count > 0
        inside, first, count = inside[busy], first[busy], count[busy]
        row = np.repeat(inside, count)
        nth = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        box = self.candidates[np.repeat(first, count) + nth]
        order = np.argsort(box, kind="stable")
        row, box = row[order], box[order]
        kept_row, kept_box, kept_z = [], [], []
        # One product a box: fewer boxes than points, even of a large site.
        begins = np.flatnonzero(np.diff(box, prepend=-1))
        for start, end in zip(begins, np.append(begins, len(box))[1:], strict=True):
            b = box[start]
            local = (points[row[start:end]] - self.boxes.origin_m[b]) @ self.boxes.R[b]
            within = ((local >= self.boxes.low_m[b]) & (local <= self.boxes.high_m[b])).all(axis=1)
            kept_row.append(row[start:end][within])
            kept_box.append(np.full(int(within.sum()), b))
            kept_z.append(local[within, 2])
        if not kept_row:
            none = np.empty(0, dtype=np.intp)
            return Pairs(none, none, none.astype(np.uint8))
        row, box, z = np.concatenate(kept_row), np.concatenate(kept_box), np.concatenate(kept_z)
        share = self.boxes.share[box]
        stretch = np.clip((share[:, 0] + share[:, 1] * z) * STRETCHES, 0, STRETCHES - 1).astype(np.uint8)
        member = self.owner[box]
        if len(self.owner) > self.owner[-1] + 1:
            # Boxes of a curved element overlap: its point counts once, in the first of them.
            _, once = np.unique(member * len(points) + row, return_index=True)
            row, member, stretch = row[once], member[once], stretch[once]
        return Pairs(row, member, stretch)

    @property
    def bounds_m(self) -> Array:
        """Least and largest x, y and z of each box [B][2][3], in the coordinates of the placements (the model's)."""
        return np.stack(_bounds(self.boxes), axis=1)

    def neighbours(self) -> dict[int, list[int]]:
        """Return for each element those whose boxes reach into a cell that its own reach into, ascending."""
        out: dict[int, set[int]] = {int(e): set() for e in np.unique(self.owner)}
        counts = np.diff(self.starts)
        groups = set()
        for cell in np.flatnonzero(counts > 1):
            group = frozenset(self.owner[self.candidates[self.starts[cell] : self.starts[cell + 1]]].tolist())
            groups.add(group)
        for group in groups:
            for element in group:
                out[element] |= group
        return {element: sorted(others - {element}) for element, others in out.items()}


def _bounds(boxes: Boxes) -> tuple[Array, Array]:
    """Return the least and the largest x, y and z [B][3] of boxes."""
    middle, half = (boxes.low_m + boxes.high_m) / 2, (boxes.high_m - boxes.low_m) / 2
    centre = boxes.origin_m + np.einsum("bij,bj->bi", boxes.R, middle)
    extent = np.einsum("bij,bj->bi", np.abs(boxes.R), half)
    return centre - extent, centre + extent


def _cells(boxes: Boxes, b: int, low: Array, high: Array, corner: Array, cell_m: float, shape: Index) -> Index:
    """Return the cells that box ``b`` may reach into, those of its bounds less the ones that are clearly beside it."""
    first = np.maximum(((low - corner) / cell_m).astype(np.intp), 0)
    last = np.minimum(((high - corner) / cell_m).astype(np.intp), shape - 1)
    grid = np.stack(np.meshgrid(*(np.arange(a, z + 1) for a, z in zip(first, last, strict=True)), indexing="ij"), -1)
    index = grid.reshape(-1, 3)
    local = (corner + (index + 0.5) * cell_m - boxes.origin_m[b]) @ boxes.R[b]
    # Half of what a cell measures along the box's axes.
    half = np.abs(boxes.R[b]).sum(axis=0) * cell_m / 2 + 1e-9
    near = ((local >= boxes.low_m[b] - half) & (local <= boxes.high_m[b] + half)).all(axis=1)
    x, y, z = index[near].T
    return np.asarray((x * shape[1] + y) * shape[2] + z)
