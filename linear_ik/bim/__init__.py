"""Building models: the design of linear elements read from IFC."""

from linear_ik.bim.reading import read_design

__all__ = ["read_design"]
