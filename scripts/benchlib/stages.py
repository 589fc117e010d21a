"""Where the time of a fit goes, seen from outside: every function of the package is wrapped, by module.

Nothing in the package knows of it. A function's time is its own: what it spends in
functions of another stage counts there.
"""

from __future__ import annotations

import functools
import inspect
import sys
import time
from collections.abc import Callable
from types import FunctionType
from typing import Any

REST = "rest"
QUERY = "closest-point query"

# Modules of the package; the longest name that fits decides.
STAGE_OF = {
    "linear_ik.problem": "preparation",
    "linear_ik.scan": "preparation",
    "linear_ik.duplicates": "preparation",
    "linear_ik.sampling": "preparation",
    "linear_ik.coordinates": "preparation",
    "linear_ik.sights": "correspondence",
    "linear_ik.tapered_surface": "correspondence",
    "linear_ik.urdf": "preparation",
    "linear_ik.profile": "preparation",
    "linear_ik.outline": "preparation",
    "linear_ik.section": "preparation",
    "linear_ik.correspondence": "correspondence",
    "linear_ik.cloud_pairs": "correspondence",
    "linear_ik.icpik": "correspondence",
    "linear_ik.surface": "correspondence",
    "linear_ik.tally": "correspondence",
    "linear_ik.terms": "assembly",
    "linear_ik.descent": "assembly",
    "linear_ik.ik_step": "QP",
    "linear_ik.chain": "kinematics",
    "linear_ik.startup": "search",
    "linear_ik.distance_field": "search",
    "linear_ik.repair": "search",
    "linear_ik.basin": "search",
    "linear_ik.settlement": "statistics, verdict",
    "linear_ik.evidence": "statistics, verdict",
    "linear_ik.conclusion": "statistics, verdict",
    "linear_ik.assessment": "statistics, verdict",
    "linear_ik.uncertainty": "statistics, verdict",
    "linear_ik.section_check": "statistics, verdict",
    "linear_ik.ends": "statistics, verdict",
    "linear_ik.doubts": "statistics, verdict",
    "linear_ik.fit": "statistics, verdict",
}
STAGES = (QUERY, *dict.fromkeys(STAGE_OF.values()), REST)


class StageClock:
    """Adds up the time that each stage has the word."""

    def __init__(self) -> None:
        """Start with the rest."""
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.current = REST
        self._since = time.perf_counter()

    def switch(self, stage: str) -> str:
        """Give the word to a stage, and return the one that had it."""
        now = time.perf_counter()
        self.seconds[self.current] += now - self._since
        self._since = now
        previous, self.current = self.current, stage
        return previous

    def reset(self) -> None:
        """Forget what was added up."""
        self.switch(self.current)
        self.seconds = dict.fromkeys(STAGES, 0.0)

    def shares(self) -> dict[str, float]:
        """Return each stage's share of the time since the last reset."""
        self.switch(self.current)
        total = sum(self.seconds.values())
        return {stage: seconds / total for stage, seconds in self.seconds.items()}

    def wrapped(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """Return a function that gives the word to ``stage`` while it runs."""

        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            if self.current == stage:
                return function(*args, **kwargs)
            previous = self.switch(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self.switch(previous)

        return timed


def instrument() -> StageClock:
    """Wrap every function of the package, as far as it is imported, for good; and Open3D's closest-point query."""
    clock = StageClock()
    modules = [m for name, m in sorted(sys.modules.items()) if name.startswith("linear_ik") and m is not None]
    instead: dict[int, Callable[..., Any]] = {}
    kept: list[FunctionType] = []
    for module in modules:
        stage = stage_of(module.__name__)
        if stage is None:
            continue
        for value in list(vars(module).values()):
            if isinstance(value, FunctionType) and value.__module__ == module.__name__:
                instead[id(value)] = clock.wrapped(value, stage)
                kept.append(value)
            elif inspect.isclass(value) and value.__module__ == module.__name__:
                _wrap_methods(value, stage, clock)
    for module in modules:
        for name, value in list(vars(module).items()):
            if id(value) in instead:
                module.__dict__[name] = instead[id(value)]
            elif isinstance(value, FunctionType):
                _renew_defaults(value, instead)
            elif inspect.isclass(value) and isinstance(vars(value).get("__init__"), FunctionType):
                _renew_defaults(vars(value)["__init__"], instead)
    for function in kept:
        _renew_defaults(function, instead)

    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene
    scene.compute_closest_points = clock.wrapped(scene.compute_closest_points, QUERY)
    return clock


def stage_of(module: str) -> str | None:
    """Return the stage of a module of the package, None for one that is of none."""
    fitting = [name for name in STAGE_OF if module == name or module.startswith(name + ".")]
    return STAGE_OF[max(fitting, key=len)] if fitting else None


def _wrap_methods(of: type, stage: str, clock: StageClock) -> None:
    for name, value in list(vars(of).items()):
        if isinstance(value, FunctionType):
            # A dataclass's __init__ keeps its defaults on the function below the wrapper.
            setattr(of, name, clock.wrapped(value, stage) if name != "__init__" else value)
        elif isinstance(value, classmethod):
            setattr(of, name, classmethod(clock.wrapped(value.__func__, stage)))


def _renew_defaults(function: FunctionType, instead: dict[int, Callable[..., Any]]) -> None:
    if function.__defaults__:
        function.__defaults__ = tuple(instead.get(id(d), d) for d in function.__defaults__)
