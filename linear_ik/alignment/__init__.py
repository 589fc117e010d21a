"""Alignment: the rigid motion that takes a scan into a design's coordinates."""
