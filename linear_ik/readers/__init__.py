"""Files in: scans, one module a format, read piece by piece in double precision; and results."""

from linear_ik.readers.registry import CHUNK_POINTS, READERS, iter_scan, read_scan

__all__ = ["CHUNK_POINTS", "READERS", "iter_scan", "read_scan"]
