"""COPC files, written from the specification (COPC 1.0): laspy reads them only."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LEVELS = 4
VLR_HEADER = 54


def write_copc(path: Path, points: Array, scale: float = 1e-6, pages: bool = True, withheld: int = 0) -> int:
    """Write points [P][3] as an octree of four levels, every node an eighth of what is left; return the nodes.

    Args:
        path: of the file.
        points: metres.
        scale: of the stored coordinates.
        pages: put every node below the second level on a hierarchy page of its parent.
        withheld: how many of the points, the first ones, are marked so.
    """
    import laspy
    import lazrs

    offset = np.floor(points.min(axis=0))
    low = points.min(axis=0) - 1e-3
    half = float((points.max(axis=0) - low).max() / 2 + 1e-3)
    nodes = _octree(points, low, 2 * half)
    record = lazrs.LazVlr.new_for_compression(6, 0, True).record_data()
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), offset
    header.vlrs.append(laspy.VLR("copc", 1, "copc info", bytes(160)))
    header.vlrs.append(laspy.VLR("laszip encoded", 22204, "lazrs", bytes(record)))
    header.are_points_compressed = True
    stored = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    stored.x, stored.y, stored.z = points.T
    stored.withheld[:withheld] = 1
    header.grow(stored)
    raw = stored.array.view(np.uint8).reshape(len(points), -1)
    out = io.BytesIO()
    header.write_to(out)
    start = out.tell()
    compressor = lazrs.LasZipCompressor(out, lazrs.LazVlr(record))
    compressor.reserve_offset_to_chunk_table()
    compressor.compress_chunks([raw[rows].ravel() for _, rows in nodes])
    compressor.done()
    data = bytearray(out.getvalue())
    begin = start + 8
    chunks = lazrs.read_chunk_table(io.BytesIO(_at(data, start)), lazrs.LazVlr(record))
    table = {}
    # lazrs ends with a chunk of nothing.
    for (key, rows), (count, size) in zip(nodes, [chunk for chunk in chunks if chunk[0]], strict=True):
        assert count == len(rows)
        table[key] = (begin, size, count)
        begin += size
    hierarchy = len(data)
    pages_of = _pages(table, hierarchy + 60, pages)
    body = b"".join(pages_of)
    data += struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(body), b"EPT hierarchy") + body
    info = struct.pack("<9d", *(low + half), half, half / 64, 0, 0, 0, 0)[:40]
    info += struct.pack("<QQdd", hierarchy + 60, len(pages_of[0]), 0.0, 0.0)
    data[375 + VLR_HEADER : 375 + VLR_HEADER + len(info)] = info
    struct.pack_into("<QI", data, 235, hierarchy, 1)
    path.write_bytes(data)
    return len(nodes)


def _at(data: bytearray, start: int) -> bytes:
    """Return the file's bytes so that a reader that stands at the points' start finds the table: from 0 on."""
    (table,) = struct.unpack_from("<q", data, start)
    return bytes(struct.pack("<q", table - start)) + bytes(data[start + 8 :])


def _octree(points: Array, low: Array, edge: float) -> list[tuple[tuple[int, int, int, int], npt.NDArray[np.intp]]]:
    rng = np.random.default_rng(0)
    left = np.arange(len(points))
    nodes = []
    for level in range(LEVELS):
        cells = np.floor((points[left] - low) / (edge / 2**level)).astype(int)
        keys, of = np.unique(cells, axis=0, return_inverse=True)
        taken = np.zeros(len(left), dtype=bool)
        for i, key in enumerate(keys):
            rows = np.flatnonzero(of.ravel() == i)
            if level < LEVELS - 1:
                rows = np.sort(rng.permutation(rows)[: max(1, len(rows) // 8)])
            taken[rows] = True
            nodes.append(((level, *map(int, key)), left[rows]))
        left = left[~taken]
    return nodes


def _pages(table: dict[tuple[int, int, int, int], tuple[int, int, int]], at: int, several: bool) -> list[bytes]:
    """Return the root page and, where there are to be several, one a node of the second level."""

    def entry(key: tuple[int, ...], offset: int, size: int, count: int) -> bytes:
        return struct.pack("<iiii", *key) + struct.pack("<Qii", offset, size, count)

    if not several:
        return [b"".join(entry(key, *value) for key, value in table.items())]
    below: dict[tuple[int, ...], list[bytes]] = {}
    root = []
    for key, value in table.items():
        if key[0] == 0:
            root.append(entry(key, *value))
        else:
            shift = key[0] - 1
            below.setdefault((1, *(k >> shift for k in key[1:])), []).append(entry(key, *value))
    place = at + 32 * (len(root) + len(below))
    rest = []
    for parent, rows in below.items():
        page = b"".join(rows)
        root.append(entry(parent, place, len(page), -1))
        place += len(page)
        rest.append(page)
    return [b"".join(root), *rest]
