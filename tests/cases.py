"""The paper's Table 1 as data: twelve clouds of its eleven tests (3a has two radii).

What the paper leaves open is read as follows.

- The beam's section is 0.1 m along X and 0.3 m along Y. Case 1 and 4 bend it as a
  cantilever bends under load, in the plane of its depth: about X, the tip moving along Y.
- "Side parallel to the deformation axis" (4a): a face along which the tip moves, one of
  the 0.3 m wide faces, here +x. The paper says that it has the greater area and that
  losing it costs less than losing the perpendicular one (4b, here +y): both true of this
  reading. 4c misses both, half of the surface.
- Case 3 and 4 name no angle: 22.5 degrees at segment 8, the moderate one of case 1.
- The H-section is an HEB 300 without its fillets (300 x 300 x 11 x 19 mm); the box's
  walls are 10 mm thick, which no outside measurement sees.
- The noise is 1 mm, the column of case 2 has its fixed end at the bottom.
"""

from __future__ import annotations

from dataclasses import dataclass

from linear_ik.bending import Bend
from linear_ik.element import Element
from linear_ik.profile import Circle, IShape, Profile, Rectangle, RectangleHollow
from linear_ik.simulate import SimulatedScan, simulate

LENGTH_M, SEGMENTS, POINTS, NOISE_M = 2.5, 10, 10_000, 0.001

BEAM = Rectangle(x_dim=0.1, y_dim=0.3)
HEB_300 = IShape(overall_width=0.3, overall_depth=0.3, web_thickness=0.011, flange_thickness=0.019)


@dataclass(frozen=True)
class Case:
    """One cloud of Table 1.

    Attributes:
        name: as in the table; 3a with its radius.
        profile: of the element.
        bends: that deform it.
        missing: faces left out.
        solved_in_paper: whether the paper calls its own fit of it successful.
    """

    name: str
    profile: Profile
    bends: tuple[Bend, ...]
    missing: tuple[str, ...] = ()
    solved_in_paper: bool = True

    @property
    def element(self) -> Element:
        """The design."""
        return Element(self.name, self.profile, LENGTH_M, SEGMENTS)

    def scan(self, seed: int = 1, points: int = POINTS, noise_m: float = NOISE_M) -> SimulatedScan:
        """Return the case's cloud."""
        return simulate(self.element, bends=self.bends, points=points, noise_m=noise_m, seed=seed, missing=self.missing)


SMALL, MODERATE, LARGE = (Bend(8, "x", degrees) for degrees in (9.0, 22.5, 45.0))

TABLE_1 = (
    Case("1a", BEAM, (SMALL,)),
    Case("1b", BEAM, (MODERATE,)),
    Case("1c", BEAM, (LARGE,), solved_in_paper=False),
    Case("2a", Circle(0.15), (SMALL,)),
    Case("2b", Circle(0.15), (Bend(4, "x", 9.0),)),
    Case("3a-150", Circle(0.15), (MODERATE,)),
    Case("3a-200", Circle(0.2), (MODERATE,)),
    Case("3b", RectangleHollow(0.35, 0.35, 0.01), (MODERATE,)),
    Case("3c", HEB_300, (MODERATE,)),
    Case("4a", BEAM, (MODERATE,), ("+x",)),
    Case("4b", BEAM, (MODERATE,), ("+y",)),
    Case("4c", BEAM, (MODERATE,), ("+x", "+y"), solved_in_paper=False),
)


def make(case: Case | str, seed: int = 1) -> tuple[Element, SimulatedScan]:
    """Return the design and the cloud of a case of `TABLE_1`, or of its name."""
    if isinstance(case, str):
        case = next(c for c in TABLE_1 if c.name == case)
    return case.element, case.scan(seed)
