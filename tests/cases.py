"""The paper's cases, where the benchmarks keep them: `scripts/benchlib/cases.py`."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "scripts"))

from benchlib.cases import (  # noqa: E402
    BEAM,
    BOTH_ENDS,
    HEB_300,
    LARGE,
    LENGTH_M,
    MODERATE,
    NOISE_M,
    POINTS,
    SEGMENTS,
    SMALL,
    TABLE_1,
    Case,
    make,
)

__all__ = [
    "BEAM",
    "BOTH_ENDS",
    "HEB_300",
    "LARGE",
    "LENGTH_M",
    "MODERATE",
    "NOISE_M",
    "POINTS",
    "SEGMENTS",
    "SMALL",
    "TABLE_1",
    "Case",
    "make",
]
