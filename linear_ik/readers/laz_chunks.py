"""Checks of a LAZ file's chunks, ahead of lazrs.

lazrs allocates what the chunk table and the chunks' layers claim to need, and ends the process
when it cannot. The layout is that of the LAZ specification (LASzip 1.4): at the points' start
the offset of the chunk table, or -1 when it stands in the file's last 8 bytes; chunks; the
table: version, number of chunks, compressed sizes. A chunk begins with a point as it is, and
when layered goes on with its number of points and the size of every layer.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

from linear_ik.errors import ScanError
from linear_ik.readers.chunk import check_room

WHOLE = "a complete LAZ file"
LAYERED = 3
# Layers an item of the LASzip record is split into, by its type; those of extra bytes have one a byte.
POINT14, RGB14, RGBNIR14, WAVEPACKET14, BYTE14 = range(10, 15)
LAYERS = {POINT14: 9, RGB14: 1, RGBNIR14: 2, WAVEPACKET14: 1}


def check_chunks(path: Path, lazrs: Any, record: bytes, start: int, points: int) -> list[tuple[int, int]]:
    """Check that everything the chunks ask for is in the file; return the most points and the bytes of each.

    Args:
        path: the file.
        lazrs: the module.
        record: the contents of the file's LASzip record.
        start: byte where the points begin.
        points: how many the header says there are.

    Raises:
        ScanError: a chunk table outside the file, more data in it than the file has, or another
            number of points than ``points``.
    """
    if not points:
        return []
    vlr = lazrs.LazVlr(record)
    with path.open("rb") as file:
        table = _table(path, file, start)
        file.seek(table + 4)
        check_room(path, int.from_bytes(file.read(4), "little"), vlr.item_size(), table - start, "chunks")
        file.seek(start)
        chunks = [(int(most), int(size)) for most, size in lazrs.read_chunk_table(file, vlr)]
        check_room(path, sum(size for _, size in chunks), 1, table - start - 8, "compressed bytes")
        most = sum(count for count, _ in chunks)
        least = most if vlr.uses_variable_size_chunks() else most - vlr.chunk_size() + 1
        if int.from_bytes(record[:2], "little") == LAYERED:
            least = most = _check_layers(path, file, _layers(record), vlr.item_size(), start + 8, chunks)
    if not least <= points <= most:
        held = f"{least}" if least == most else f"{least} to {most}"
        raise ScanError(path, f"the header says {points} points, the chunks hold {held}", WHOLE)
    return chunks


def _table(path: Path, file: BinaryIO, start: int) -> int:
    """Return where the chunk table begins."""
    file.seek(start)
    table = int.from_bytes(file.read(8), "little", signed=True)
    if table == -1:
        file.seek(-8, 2)
        table = int.from_bytes(file.read(8), "little", signed=True)
    if not start + 8 <= table <= path.stat().st_size - 8:
        raise ScanError(path, f"its chunk table is said to be at byte {table}", WHOLE)
    return table


def _layers(record: bytes) -> int:
    """Return how many layers a chunk has, from the items of the LASzip record."""
    (items,) = struct.unpack_from("<H", record, 32)
    kinds = [struct.unpack_from("<HH", record, 34 + 6 * i) for i in range(items)]
    return sum(size if kind == BYTE14 else LAYERS.get(kind, 0) for kind, size in kinds)


def _check_layers(
    path: Path, file: BinaryIO, layers: int, point_bytes: int, at: int, chunks: list[tuple[int, int]]
) -> int:
    """Check every chunk's layers against its size; return the number of points of all."""
    total = 0
    for most, size in chunks:
        if not size:
            continue
        file.seek(at + point_bytes)
        head = file.read(4 + 4 * layers)
        if len(head) < 4 + 4 * layers:
            raise ScanError(path, "ends inside a chunk", WHOLE)
        points, *sizes = struct.unpack(f"<{1 + layers}I", head)
        if points > most:
            raise ScanError(path, f"a chunk says it holds {points} points", f"at most {most}")
        check_room(path, sum(sizes), 1, size - point_bytes - len(head), "bytes in a chunk")
        total += points
        at += size
    return total
