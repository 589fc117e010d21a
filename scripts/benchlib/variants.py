"""Variants of both methods: one choice changed at a time, by a setting, a constant or other correspondences.

The library has no switch for a choice that is never better; the bench changes the
constant, or runs the library's own loop with another pairing, so that chain, step and
terms stay the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from benchlib import pairings
from benchlib.runs import patched
from linear_ik import Element, FitSettings, SimulatedScan, fit
from linear_ik.chain import BASE
from linear_ik.descent import Log, descend
from linear_ik.ik_step import make_solver
from linear_ik.problem import Problem
from linear_ik.stage import Stage
from linear_ik.terms import Objective
from linear_ik.terms.damping import Damping
from linear_ik.terms.point_residual import point_residual
from linear_ik.terms.point_to_point import point_to_point

Array = npt.NDArray[np.float64]


class Fitted(NamedTuple):
    """What a variant found: nodes [N+1][3], its own verdict, iterations, and the seconds it took."""

    nodes_m: Array
    status: str
    iterations: int
    time_s: float


@dataclass(frozen=True)
class Variant:
    """A method with one choice changed.

    Attributes:
        name: what is changed, and to what; the cache knows the variant by it, so it holds
            nothing that another patch might change.
        run: fits a scan.
        ours: what the package has instead, for the table.
    """

    name: str
    run: Callable[[Element, SimulatedScan], Fitted]
    ours: str = ""

    @property
    def title(self) -> str:
        """The name for the table."""
        return f"{self.name} (ours {self.ours})" if self.ours else self.name


@dataclass(frozen=True)
class Changed:
    """The library's fit with other settings or constants.

    Attributes:
        settings: of the fit.
        changes: (module, name, value) of constants and functions.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    changes: Sequence[tuple[Any, str, Any]] = ()

    def __call__(self, element: Element, scan: SimulatedScan) -> Fitted:
        """Fit a scan."""
        given = scan.without_truth()
        with patched(*self.changes):
            started = time.perf_counter()
            result = fit(element, given, FitSettings(**self.settings))
            return Fitted(result.nodes_m, result.status, result.iterations, time.perf_counter() - started)


@dataclass(frozen=True)
class Descending:
    """The library's loop from the design on all points, with a pairing of its own.

    Attributes:
        pairing: makes, from problem and scan, what pairs an iteration's points.
        term: what the pairs ask of the step.
        iterations: of one run of the loop.
        settings: of the fit.
    """

    pairing: Callable[[Problem, SimulatedScan], Any]
    term: Any = point_residual
    iterations: int = 60
    settings: dict[str, Any] = field(default_factory=dict)

    def __call__(self, element: Element, scan: SimulatedScan) -> Fitted:
        """Fit a scan."""
        started = time.perf_counter()
        settings = FitSettings(**self.settings)
        problem, log = Problem.of(element, scan), Log(None, element.placement.T_world_element)
        stage = Stage(
            "plain",
            problem.points,
            # As many as there are unweighted iterations: it may not stop before the weighted ones.
            scales_m=(np.inf,) * (pairings.UNWEIGHTED_ITERATIONS + 2),
            noise_m=1e-3,
            iterations=self.iterations,
            stop_m=2e-5,
            pair=self.pairing(problem, scan),
            term=self.term,
        )
        found = descend(problem, problem.designed, stage, settings, make_solver("osqp"), log)
        T = element.placement.T_world_element
        nodes = found.pose.nodes_m @ T[:3, :3].T + T[:3, 3]
        status = "converged" if found.converged else "max_iterations"
        return Fitted(nodes, status, len(log.records), time.perf_counter() - started)


def default_variants() -> list[Variant]:
    """Return the variants of the default method."""
    import qpsolvers

    from linear_ik import basin, settlement, startup

    fitting = import_module("linear_ik.fit")
    out = [Variant("default", Changed())]
    out += [
        Variant(f"{word} {value:g}", Changed({name: value}))
        for word, name, values in (
            ("damping lambda", "damping", (1e-9, 1e-4, 1e-2, 1.0)),
            ("continuity Q", "continuity", (1e-6, 1e-4, 1e-3)),
            ("directional C", "directional", (1e-6, 1e-4, 1e-3)),
        )
        for value in values
    ]
    out += [
        Variant(f"solver {name}", Changed({"solver": name}))
        for name in sorted(qpsolvers.available_solvers)
        if name != "osqp"
    ]
    out += [
        Variant("no turns of doubtful segments", Changed(changes=[(startup.Startup, "turned", lambda self, x, k: x)])),
        Variant("search never", Changed({"search": "never"})),
        Variant("search always", Changed({"search": "always"})),
        Variant("noise given, not estimated", Changed({"range_noise_m": 1e-3})),
        Variant(
            "no prior learnt from the scan",
            Changed(changes=[(settlement, "evidence", lambda problem, *_: (problem.prior_sd, problem.prior_mean))]),
        ),
        Variant(
            "one prior for all joints of an axis",
            Changed(changes=[(import_module("linear_ik.evidence"), "FREEDOM", 1e6)]),
        ),
        Variant("no repair of wrong sides", Changed(changes=[(startup, "repair", lambda problem, x, *_: x)])),
        Variant(
            "no robust weights at the end",
            Changed(
                changes=[(room, "ROBUST_SCALE", 1e6) for room in (fitting, basin)] + [(fitting, "NARROW_SCALE", 1e6)]
            ),
        ),
        Variant(
            "no last step on all points", Changed(changes=[(settlement, "last_step", lambda settled, *_: settled)])
        ),
        Variant("settling on all points", Changed(changes=[(fitting, "SETTLE_POINTS_A_SEGMENT", 10**6)])),
        Variant("first descent on 30 points a segment", Changed(changes=[(fitting, "COARSE_POINTS_A_SEGMENT", 30)])),
        Variant("first descent on all points", Changed(changes=[(fitting, "COARSE_POINTS_A_SEGMENT", 10**6)])),
    ]
    return out


def pairing_variants() -> list[Variant]:
    """Return the ways to pair, each in the same loop from the design on all points, without any search."""
    return [
        Variant("scan to surface, point to plane", Descending(pairings.surface)),
        Variant("the same, threshold from 0.3 m down", Descending(pairings.annealed)),
        Variant("the same, gate on true normals (an oracle)", Descending(pairings.gated)),
        Variant("scan to surface, point to point", Descending(pairings.foot_points, point_to_point)),
        Variant("model to scan, point to plane", Descending(pairings.model_to_scan)),
        Variant("model to scan, point to point", Descending(pairings.model_to_scan_points, point_to_point)),
        Variant(
            "model to scan, point to point, geometric features",
            Descending(pairings.geometric_features, point_to_point),
        ),
    ]


def icpik_variants() -> list[Variant]:
    """Return the paper's method with each choice that the paper leaves open changed in turn."""
    from linear_ik import cloud_pairs, descent, icpik
    from linear_ik.terms import damping

    ours = FitSettings(method="icpik")

    def changed(name: str, *changes: tuple[Any, str, Any], like: str = "", **settings: Any) -> Variant:
        return Variant(name, Changed({"method": "icpik", **settings}, changes), like)

    def constant(word: str, module: Any, name: str, *values: float) -> list[Variant]:
        own = f"{getattr(module, name):g}"
        return [changed(f"{word} {value:g}", (module, name, value), like=own) for value in values]

    def setting(word: str, name: str, own: float, *values: float) -> list[Variant]:
        return [changed(f"{word} {value:g}", like=f"{own:g}", **{name: value}) for value in values]

    def adapted(word: str, name: str, *values: float) -> list[Variant]:
        own = f"{getattr(damping.Damping(1.0), name):g}"
        return [
            changed(f"{word} {value:g}", (descent, "Damping", bounded_damping(**{name: value})), like=own)
            for value in values
        ]

    return [
        changed("icpik"),
        changed("no inverse-distance weights", (icpik, "inverse_distance", unweighted)),
        *constant("exponent of the inverse-distance weight", icpik, "WEIGHT_EXPONENT", 1, 4),
        *constant("distance of a quarter weight, m", icpik, "QUARTER_WEIGHT_M", 0.005, 0.1),
        changed("no segment weights", (icpik, "segment_weights", unweighted)),
        *(
            changed(
                f"segment weight by the share to the power {power:g}",
                (icpik, "segment_weights", share_weights(icpik.segment_weights, power)),
                like="1",
            )
            for power in (-1.0, 0.5, 2.0)
        ),
        *constant("threshold decay", icpik, "THRESHOLD_DECAY", 0.9, 0.95, 0.99, 1.0),
        *constant("least threshold, m", icpik, "LEAST_THRESHOLD_M", 0.005, 0.05),
        *constant("model points", icpik, "MODEL_POINTS", 3_000, 30_000),
        *setting("seed of the model's cloud", "seed", ours.seed, 1, 2),
        *constant("inner iterations", cloud_pairs, "INNER_ITERATIONS", 1, 100),
        *setting("lambda", "damping", ours.weights.damping, 1e-6, 1e-1),
        *constant("damping eased by", damping, "EASED", 1, 10),
        *constant("damping hardened by", damping, "HARDENED", 1, 10),
        *adapted("damping's floor", "least", 1e-6, 1e-3),
        *adapted("damping's ceiling", "most", 1.0),
        *setting("largest step, rad", "max_step_rad", ours.max_step_rad, 0.03, 0.1, 1.0),
        *setting("Q", "continuity", ours.weights.continuity, 0.0, 1e-5, 1e-1),
        *setting("C", "directional", ours.weights.directional, 0.0, 1e-1),
        changed("C without its penalty on twist", (descent, "directional_constraint", bends_only)),
        changed(
            "C and Q pull the angles, not only the step",
            (descent, "shape_damping", pulling_angles(descent.shape_damping)),
        ),
        changed("Q 1e-05 and one inner iteration", (cloud_pairs, "INNER_ITERATIONS", 1), continuity=1e-5),
        changed(
            "Q 1e-05, one inner iteration, no inverse-distance weights",
            (cloud_pairs, "INNER_ITERATIONS", 1),
            (icpik, "inverse_distance", unweighted),
            continuity=1e-5,
        ),
    ]


def unweighted(pairs: Any) -> Array:
    """Return ones [P] for weights."""
    return np.ones(len(pairs.distance_m))


def share_weights(shares: Callable[[Any], Array], power: float) -> Callable[[Any], Array]:
    """Return segment weights as another power of the segment's share; -1 gives each segment the same say."""
    return lambda pairs: shares(pairs) ** power


def bounded_damping(**bounds: float) -> Callable[..., Damping]:
    """Return a maker of dampings with another ``least`` or ``most``."""
    own = Damping(1.0, **bounds)
    return lambda weight, least=own.least, most=own.most: Damping(weight, least, most)


def bends_only(x: Array, weight: float) -> Objective:
    """Return the directional constraint without what it says of twist."""
    from linear_ik.terms.directional_constraint import directional_constraint

    H, c = (a.copy() for a in directional_constraint(x, weight))
    twist = np.arange(BASE, len(x), 3)
    H[twist], H[:, twist], c[twist] = 0.0, 0.0, 0.0
    return Objective(H, c)


def pulling_angles(shape_damping: Callable[..., Objective]) -> Callable[..., Objective]:
    """Return C and Q as costs of the angles themselves: their gradient is H x.

    The paper's eq. 4 adds C and Q on the left, where they only shorten the step; read as
    priors of the shape they would pull the chain straight as well.
    """

    def terms(x: Array, information: float, weights: Any) -> Objective:
        H = shape_damping(x, information, weights).H
        return Objective(H, H @ x)

    return terms


def all_variants() -> dict[str, Variant]:
    """Return every variant by its name."""
    return {v.name: v for v in (*default_variants(), *pairing_variants(), *icpik_variants())}
