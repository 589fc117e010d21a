"""As-built shape of linear building elements from laser scans.

The public names. Each module is imported when one of its names is first used, so that
`import linear_ik` costs next to nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from linear_ik.align import Alignment, align
    from linear_ik.bending import Bend
    from linear_ik.bim import read_design
    from linear_ik.chain import Chain
    from linear_ik.compare import Comparison, compare
    from linear_ik.comparison_table import write_comparison
    from linear_ik.design_model import DesignModel, LeftOut, MapConversion, Member, Obstacle
    from linear_ik.deviation import Deviations, deviations
    from linear_ik.element import Element, Placement, PlacementTolerance
    from linear_ik.element_file import element_from_mapping, element_to_mapping, load_element
    from linear_ik.errors import LinearIkError
    from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc
    from linear_ik.exports.fitted_urdf import write_fitted_urdf
    from linear_ik.exports.glb import write_glb, write_smooth_glb
    from linear_ik.exports.result_json import result_to_mapping, write_result
    from linear_ik.exports.scan_file import write_scan
    from linear_ik.fit import fit
    from linear_ik.model_fit import ModelFit, ModelFitOptions, fit_model
    from linear_ik.profile import (
        Circle,
        CircleHollow,
        IShape,
        LShape,
        Polygon,
        Profile,
        Rectangle,
        RectangleHollow,
        TShape,
        UShape,
    )
    from linear_ik.readers import read_scan
    from linear_ik.readers.result_json import read_result
    from linear_ik.result import FitResult, IterationRecord, SegmentResult
    from linear_ik.scan import Scan
    from linear_ik.settings import FitSettings
    from linear_ik.simulate import SimulatedScan, simulate
    from linear_ik.smooth_axis import SmoothAxis, smooth_axis
    from linear_ik.tolerances import Conditions, load_tolerances, verdicts
    from linear_ik.urdf import generate_urdf, write_urdf
    from linear_ik.viewer import Viewer
    from linear_ik.virtual_scanner import scan_virtually

    __version__: str

_MODULES = {
    "align": ("Alignment", "align"),
    "bending": ("Bend",),
    "bim": ("read_design",),
    "chain": ("Chain",),
    "deviation": ("Deviations", "deviations"),
    "compare": ("Comparison", "compare"),
    "comparison_table": ("write_comparison",),
    "design_model": ("DesignModel", "LeftOut", "MapConversion", "Member", "Obstacle"),
    "element": ("Element", "Placement", "PlacementTolerance"),
    "element_file": ("element_from_mapping", "element_to_mapping", "load_element"),
    "errors": ("LinearIkError",),
    "exports.asbuilt_ifc": ("write_asbuilt_ifc",),
    "exports.fitted_urdf": ("write_fitted_urdf",),
    "exports.glb": ("write_glb", "write_smooth_glb"),
    "smooth_axis": ("SmoothAxis", "smooth_axis"),
    "exports.result_json": ("result_to_mapping", "write_result"),
    "exports.scan_file": ("write_scan",),
    "fit": ("fit",),
    "model_fit": ("ModelFit", "ModelFitOptions", "fit_model"),
    "profile": (
        "Circle",
        "CircleHollow",
        "IShape",
        "LShape",
        "Polygon",
        "Profile",
        "Rectangle",
        "RectangleHollow",
        "TShape",
        "UShape",
    ),
    "readers": ("read_scan",),
    "readers.result_json": ("read_result",),
    "result": ("FitResult", "IterationRecord", "SegmentResult"),
    "scan": ("Scan",),
    "settings": ("FitSettings",),
    "simulate": ("SimulatedScan", "simulate"),
    "tolerances": ("Conditions", "load_tolerances", "verdicts"),
    "urdf": ("generate_urdf", "write_urdf"),
    "viewer": ("Viewer",),
    "virtual_scanner": ("scan_virtually",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Alignment",
    "Bend",
    "Chain",
    "Circle",
    "CircleHollow",
    "Conditions",
    "Deviations",
    "Comparison",
    "DesignModel",
    "Element",
    "FitResult",
    "FitSettings",
    "IShape",
    "IterationRecord",
    "LShape",
    "LeftOut",
    "LinearIkError",
    "MapConversion",
    "Member",
    "ModelFit",
    "ModelFitOptions",
    "Obstacle",
    "Placement",
    "PlacementTolerance",
    "Polygon",
    "Profile",
    "Rectangle",
    "RectangleHollow",
    "Scan",
    "SmoothAxis",
    "SegmentResult",
    "SimulatedScan",
    "TShape",
    "UShape",
    "Viewer",
    "__version__",
    "deviations",
    "align",
    "compare",
    "element_from_mapping",
    "element_to_mapping",
    "fit",
    "fit_model",
    "generate_urdf",
    "load_element",
    "load_tolerances",
    "read_design",
    "read_result",
    "read_scan",
    "result_to_mapping",
    "scan_virtually",
    "simulate",
    "smooth_axis",
    "verdicts",
    "write_asbuilt_ifc",
    "write_comparison",
    "write_fitted_urdf",
    "write_glb",
    "write_result",
    "write_scan",
    "write_smooth_glb",
    "write_urdf",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("linear_ik")
    elif name in _MODULE_OF:
        value = getattr(import_module(f"linear_ik.{_MODULE_OF[name]}"), name)
    else:
        raise AttributeError(f"module 'linear_ik' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """Keeps `linear_ik.fit` and `linear_ik.simulate` the functions.

    Importing the modules of the same names would otherwise put those in their place.
    """

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute; of a module that is named as its function, the function."""
        if isinstance(value, ModuleType) and _MODULE_OF.get(name) == name:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
