"""The methods of `bench_peers`: what each is, and where its function is found.

Nothing is imported here but names: every method is loaded in the process that runs it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

OURS, ICP, LEAST_SQUARES = "default", "open3d_icp", "least_squares"


@dataclass(frozen=True)
class Method:
    """One row of the table.

    Attributes:
        name: for --only and the baseline.
        title: for people.
        function: "module:function" below `benchlib.methods`.
        about: what is run, on what, and how it was set.
        package: distribution that it needs beyond the project's own; None when none.
        install: what `pip install` is given to get it.
        arguments: of the function.
        peer: whether it is somebody else's, and counts when peers are compared with ours.
    """

    name: str
    title: str
    function: str
    about: str
    package: str | None = None
    install: tuple[str, ...] = field(default=())
    arguments: tuple[str, ...] = ()
    peer: bool = True

    def load(self) -> Callable[..., Any]:
        """Import what the method needs, and return what it makes."""
        module, function = self.function.split(":")
        loaded: Callable[..., Any] = getattr(import_module(f"benchlib.methods.{module}"), function)(*self.arguments)
        return loaded

    @property
    def installed(self) -> str | None:
        """The version of its package, "" where it needs none, None where that is missing."""
        if self.package is None:
            return ""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return None


def _peer(name: str, title: str, function: str, about: str, package: str | None = None, *install: str) -> Method:
    install = install or ((package,) if package else ())
    return Method(name, title, function, about, package, install)


def _solver(name: str, package: str | None) -> Method:
    return Method(
        f"default_{name}",
        f"default, steps by {name}",
        "ours:with_solver",
        f'FitSettings(solver="{name}"), through qpsolvers.',
        package,
        (package,) if package else (),
        (name,),
        peer=False,
    )


METHODS = (
    Method(
        OURS,
        "linear_ik, default",
        "ours:default",
        "fit(element, scan), with its verdict and covariance.",
        peer=False,
    ),
    Method(
        "icpik",
        "linear_ik, the paper's method",
        "ours:icpik",
        'FitSettings(method="icpik"): ICPIK as built here, to its cap of 100 iterations.',
        peer=False,
    ),
    _peer(
        ICP,
        "Open3D ICP, rigid",
        "rigid:open3d_icp",
        "registration_icp, point to plane, the design's cloud of as many points to the scan, whose normals are "
        "estimated from 20 neighbours; 0.3 m at most, otherwise defaults. It slides along the axis, which no plane "
        "holds. Nodes: the straight ones, moved.",
    ),
    _peer(
        "small_gicp",
        "small_gicp, ICP",
        "rigid:small_gicp",
        "align, both clouds down-sampled to 0.02 m (by default to 0.25 m), all cores. Nodes: the straight ones, moved.",
        "small_gicp",
    ),
    _peer(
        "small_gicp_gicp",
        "small_gicp, GICP",
        "rigid:small_gicp_gicp",
        "The same with its default factor, GICP, which slides along the axis.",
        "small_gicp",
    ),
    _peer(
        "slicing",
        "slicing along the axis",
        "slicing:slicing",
        "Middles of 30 slices, cut across the axis and again across the line so found; nodes at their length along it.",
    ),
    _peer(
        "rustcpd",
        "CPD, rustcpd",
        "nonrigid:rustcpd",
        "Deformable coherent point drift, template of 2,000 points, scan whole; rank 100, 20 neighbours. Nodes: "
        "regressed.",
        "rustcpd",
    ),
    _peer(
        "biocpd",
        "CPD, biocpd",
        "nonrigid:biocpd",
        "The same drift with the same settings in numpy. Nodes: regressed.",
        "biocpd",
    ),
    _peer(
        "pycpd",
        "CPD, pycpd",
        "nonrigid:pycpd",
        "The drift without shortcuts; template SUBSAMPLED to 1,000 points (10,000 would take 10,000 x 10,000 x 3 "
        "numbers several times), scan whole. Nodes: regressed.",
        "pycpd",
    ),
    _peer(
        "probreg",
        "CPD, probreg",
        "nonrigid:probreg",
        "The drift without shortcuts; template SUBSAMPLED to 1,000 points, scan whole. Nodes: regressed.",
        "probreg",
        # It asks for open3d by name, which would be installed over open3d-cpu.
        "--no-deps",
        "probreg",
        "transforms3d",
        "scikit-learn",
        "six",
    ),
    _peer(
        "nricp_amberg",
        "N-ICP Amberg, trimesh",
        "nonrigid:nricp_amberg",
        "Template mesh of 500 vertices, the scan whole; default steps, matches to 0.05 m. Nodes: regressed.",
    ),
    _peer(
        "nricp_sumner",
        "N-ICP Sumner, trimesh",
        "nonrigid:nricp_sumner",
        "Template mesh of 500 vertices, the scan whole; 20 steps, matches to 0.05 m. Nodes: regressed.",
    ),
    _peer(
        LEAST_SQUARES,
        "scipy least_squares, same chain",
        "chain_peers:least_squares",
        "Trust region over the joint angles in their limits, analytic Jacobian, residuals point to plane on the faces "
        "the package's matcher finds at the angles asked for; tr_solver exact (lsmr: the same errors, no faster). BLAS "
        "on one thread, as in ours.",
    ),
    _peer(
        "pink_points",
        "Pink solve_ik, same chain, a task of points",
        "chain_peers:pink_points",
        "A Task of our own a segment that says what its matched points say (the package's matcher and moments), "
        "configuration limits; matching and solve_ik in turns until no node moves 0.01 mm. The strongest use of Pink "
        "that we could find.",
        "pin-pink",
    ),
    _peer(
        "pink_frames",
        "Pink solve_ik, same chain, frame tasks",
        "chain_peers:pink_frames",
        "Its own FrameTask a segment, the target where the segment's matched points want that segment alone (a rigid "
        "point-to-plane step); the same rounds. What a user of Pink would write.",
        "pin-pink",
    ),
    _solver("proxqp", "proxsuite"),
    _solver("piqp", "piqp"),
    _solver("daqp", "daqp"),
    _solver("clarabel", "clarabel"),
)


def named(names: Sequence[str]) -> list[Method]:
    """Return the methods of some names.

    Raises:
        ValueError: one of the names is unknown.
    """
    known = {m.name: m for m in METHODS}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: expected some of {', '.join(known)}")
    return [known[name] for name in names]
