"""A quicker start: Open3D without the web server that it imports for its plots.

`import open3d` takes about two seconds, three quarters of them for dash and plotly, which
only `open3d.visualization.draw_plotly` uses. In the process of a command, and in workers, that
module waits until somebody calls it. The Python API leaves Open3D as it is.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

PLOTS = "open3d.visualization.draw_plotly"
FUNCTIONS = ("get_plotly_fig", "draw_plotly", "draw_plotly_server")


def defer_plots() -> None:
    """Let a later `import open3d` go without dash and plotly."""
    if "open3d" in sys.modules or PLOTS in sys.modules:
        return
    stand_in = ModuleType(PLOTS)
    for name in FUNCTIONS:
        setattr(stand_in, name, _later(name))
    sys.modules[PLOTS] = stand_in


def _later(name: str) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        sys.modules.pop(PLOTS, None)
        return getattr(import_module(PLOTS), name)(*args, **kwargs)

    return call
