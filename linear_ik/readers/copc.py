"""COPC: which points of a LAZ file are near given boxes, from the octree that the file carries.

Layout of COPC 1.0: the first header record says where the hierarchy is; its pages hold one entry
a node: key (level, x, y, z), place and length of the node's LAZ chunk, number of points. A number
of -1 stands for a node that another page goes on with. A node's points lie in its cube, and each
point is in one node.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import Array

ENTRY = np.dtype([("level", "<i4"), ("cell", "<i4", 3), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
ELSEWHERE = -1
DEEPEST = 62  # of an octree that double precision can number
WHOLE = "a complete COPC file"


class Run(NamedTuple):
    """Chunks that follow each other in the file.

    Attributes:
        offset: byte of the first.
        chunks: points and bytes of each.
    """

    offset: int
    chunks: list[tuple[int, int]]

    @property
    def points(self) -> int:
        """Of all chunks."""
        return sum(points for points, _ in self.chunks)

    @property
    def bytes(self) -> int:
        """Of all chunks."""
        return sum(size for _, size in self.chunks)


def info_of(header: Any) -> Any | None:
    """Return the COPC record of a file that laspy has opened, None where it is no COPC file."""
    first = header.vlrs[0] if len(header.vlrs) else None
    return first if type(first).__name__ == "CopcInfoVlr" else None


def runs_within(
    path: Path, info: Any, start: int, chunks: Sequence[tuple[int, int]], within: Array, slack: float, most: int
) -> list[Run]:
    """Return the chunks that may hold a point of the boxes, in file order.

    The coarsest node, a thin sample of everything, is always among them: it tells where the scan is.

    Args:
        path: the file.
        info: its COPC record, as laspy reads it.
        start: byte where the points begin.
        chunks: points and bytes of each chunk, in file order.
        within: [B][2][3] least and largest x, y and z of boxes, in the file's coordinates.
        slack: how far a point may be outside its node's cube, by rounding.
        most: points of a run, unless one chunk has more.

    Raises:
        ScanError: a hierarchy that is damaged, or is not about these chunks.
    """
    entries = _entries(path, int(info.hierarchy_root_offset), int(info.hierarchy_root_size))
    nodes = entries[entries["points"] > 0]
    nodes = nodes[np.argsort(nodes["offset"], kind="stable")]
    runs, begin = [], start + 8  # behind the place of the chunk table
    for count, size in chunks:
        if count:
            runs.append(Run(begin, [(count, size)]))
        begin += size
    if [(run.offset, *run.chunks[0]) for run in runs] != nodes[["offset", "points", "bytes"]].tolist():
        named = int(nodes["points"].sum(dtype=np.int64))
        raise ScanError(
            path, f"its octree has {len(nodes)} nodes with {named} points, its data {len(runs)} others", WHOLE
        )
    if not ((nodes["level"] >= 0) & (nodes["level"] <= DEEPEST)).all():
        raise ScanError(path, "a node of its octree has no level", WHOLE)
    edge = 2.0 * float(info.halfsize) / np.exp2(nodes["level"])[:, None]
    low = np.asarray(info.center) - float(info.halfsize) + nodes["cell"] * edge - slack
    high = low + edge + 2.0 * slack
    wanted = nodes["level"] == nodes["level"].min(initial=DEEPEST)
    for box in within:
        wanted |= ((low <= box[1]) & (high >= box[0])).all(axis=1)
    return joined([runs[i] for i in np.flatnonzero(wanted)], most)


def joined(runs: Sequence[Run], most: int) -> list[Run]:
    """Return runs of one chunk each with those put together that follow each other, up to ``most`` points."""
    out: list[Run] = []
    # Running sums: a run of a million small chunks is not counted through again for each of them.
    end, held = -1, 0
    for run in runs:
        (points, size) = run.chunks[0]
        if run.offset == end and held + points <= most:
            out[-1].chunks.append((points, size))
            held += points
        else:
            out.append(Run(run.offset, [(points, size)]))
            held = points
        end = run.offset + size
    return out


def _entries(path: Path, offset: int, size: int) -> npt.NDArray[np.void]:
    """Return the entries of all pages of the hierarchy."""
    room = path.stat().st_size
    pages, seen, out = [(offset, size)], set[int](), [np.empty(0, dtype=ENTRY)]
    with path.open("rb") as file:
        while pages:
            offset, size = pages.pop()
            # A page that leads back to itself would never end.
            if offset in seen or not 0 <= size <= room - offset or size % ENTRY.itemsize:
                raise ScanError(path, f"a page of its octree is said to be {size} bytes at byte {offset}", WHOLE)
            seen.add(offset)
            file.seek(offset)
            page = np.frombuffer(file.read(size), dtype=ENTRY)
            out.append(page)
            further = page[page["points"] == ELSEWHERE]
            pages += zip(further["offset"].tolist(), further["bytes"].tolist(), strict=True)
    return np.concatenate(out)
