"""Sections by the name that drawings give them: HEB340, IPE 200, CHS 168.3x5, L 100x100x10.

The European rolled I and U sections (HEA, HEB, HEM, IPE, UPE, UPN) come from a table; the
others say their own dimensions in millimetres:

- ``CHS 168.3x5``: round tube, diameter x wall;
- ``SHS 100x6``, ``RHS 200x100x8``: square and rectangular tube, depth x width x wall;
- ``L 100x100x10``, ``L 100x10``: angle, depth x width x thickness, without its fillet;
- ``FL 100x10``: flat bar, width x thickness; ``SQ 30``: square bar;
- ``RD 20``: round bar, diameter.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable

from linear_ik.errors import ElementError
from linear_ik.profile import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Profile,
    Rectangle,
    RectangleHollow,
    UShape,
)
from linear_ik.rolled_sections import SERIES

EXPECTED = "a section's name, such as HEB340, IPE200, CHS 168.3x5, SHS 100x6, RHS 200x100x8, L 100x100x10, RD 20"
MOST_CHARACTERS = 40
_NAME = re.compile(r"([A-Z]+)(\d+(?:\.\d+)?(?:X\d+(?:\.\d+)?)*)")
_WIDE_FLANGE = re.compile(r"HE(\d+)([ABM])")
# Other words for the same.
_ALIASES = {"UNP": "UPN", "RO": "CHS", "ROR": "CHS", "QRO": "SHS", "RRO": "RHS", "D": "RD", "PL": "FL"}


def section(name: str) -> Profile:
    """Return the section of a name; capitals, blanks and the kind of times sign don't matter.

    Raises:
        ElementError: said of ``profile``: no such section.
    """
    key = re.sub(r"[\s_-]+", "", name[: MOST_CHARACTERS + 1].upper())
    key = re.sub(r"[×*]", "X", key).replace(",", ".").replace("Ø", "RD").replace("/", "X")
    if wide := _WIDE_FLANGE.fullmatch(key):
        key = f"HE{wide[2]}{wide[1]}"
    found = _NAME.fullmatch(key)
    if found is not None and len(key) <= MOST_CHARACTERS:
        kind = _ALIASES.get(found[1], found[1])
        sizes = [float(number) for number in found[2].split("X")]
        if kind in SERIES:
            return _rolled(name, kind, sizes)
        make = _MADE_OF.get((kind, len(sizes)))
        if make is not None:
            try:
                return make(*(size / 1000 for size in sizes))
            except ElementError as error:
                raise ElementError("profile", f"{name!r}: {error.what}", EXPECTED) from None
    raise ElementError("profile", f"unknown section {name[:MOST_CHARACTERS]!r}", EXPECTED)


def _rolled(name: str, kind: str, sizes: list[float]) -> Profile:
    table = SERIES[kind]
    if len(sizes) != 1 or sizes[0] not in table:
        names = [f"{kind}{size}" for size in table]
        asked = f"{kind}{sizes[0]:g}"
        near = difflib.get_close_matches(asked, names, n=3, cutoff=0.6)
        raise ElementError(
            "profile",
            f"unknown section {name[:MOST_CHARACTERS]!r}",
            f"{', '.join(near)}, or another of {names[0]} to {names[-1]}" if near else "one of " + ", ".join(names),
        )
    depth, width, web, flange, fillet = (value / 1000 for value in table[int(sizes[0])])
    if kind in ("UPE", "UPN"):
        return UShape(depth, width, web, flange, fillet)
    return IShape(width, depth, web, flange, fillet)


_MADE_OF: dict[tuple[str, int], Callable[..., Profile]] = {
    ("CHS", 2): lambda diameter, wall: CircleHollow(diameter / 2, wall),
    ("SHS", 2): lambda side, wall: RectangleHollow(side, side, wall),
    ("SHS", 3): lambda depth, width, wall: RectangleHollow(width, depth, wall),
    ("RHS", 3): lambda depth, width, wall: RectangleHollow(width, depth, wall),
    ("L", 2): lambda side, thickness: LShape(side, side, thickness),
    ("L", 3): lambda depth, width, thickness: LShape(depth, width, thickness),
    ("FL", 2): lambda width, thickness: Rectangle(thickness, width),
    ("SQ", 1): lambda side: Rectangle(side, side),
    ("RD", 1): lambda diameter: Circle(diameter / 2),
}
