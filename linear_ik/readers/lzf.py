"""LZF, the compression inside binary_compressed PCD files.

The format (liblzf's): a byte below 32 precedes that many + 1 literal bytes; otherwise its upper
three bits are the length of a match - 2 (7 meaning: plus the next byte), its lower five bits and
the following byte the distance back - 1. No binding of liblzf comes as a wheel; a million points
take 0.3 to 2 s here, less than importing a library that has it inside.
"""

from __future__ import annotations

LARGEST_RATIO = 264 / 3


def decompress(source: bytes, size: int) -> bytearray:
    """Return the ``size`` bytes that ``source`` was made from.

    Raises:
        ValueError: ``source`` isn't LZF, or not of that many bytes.
    """
    if size > len(source) * LARGEST_RATIO:
        raise ValueError("more bytes than LZF can pack")
    out = bytearray()
    at = to = 0
    try:
        while at < len(source):
            control = source[at]
            if control < 32:
                end = at + control + 2
                out += source[at + 1 : end]
                to += control + 1
                at = end
                continue
            length, at = (control >> 5, at + 1) if control < 224 else (7 + source[at + 1], at + 2)
            start, at, length = to - ((control & 31) << 8) - source[at] - 1, at + 1, length + 2
            if start < 0:
                raise ValueError("a match before the first byte")
            if start + length <= to:
                out += out[start : start + length]
            else:
                period = out[start:to]
                out += (period * (length // len(period) + 1))[:length]
            to += length
    except IndexError:
        raise ValueError("the end is missing") from None
    if not to == size == len(out):
        raise ValueError(f"{to} bytes instead of {size}")
    return out
