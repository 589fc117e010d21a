"""The paper's Table 1 as data: twelve clouds of its eleven tests (3a has two radii), and two held at both ends.

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

Case 5 is ours: the paper names elements held at both ends as a gap. Their ends cannot
come nearer without the member sagging, so a known length and a known sag go together:
three hinges of a fixed beam, 82 mm off its axis, and a pinned column bowed by 76 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

from linear_ik.bending import Bend
from linear_ik.element import Element, End, Start
from linear_ik.profile import Circle, IShape, Profile, Rectangle, RectangleHollow
from linear_ik.simulate import Layout, SimulatedScan, simulate

LENGTH_M, SEGMENTS, POINTS, NOISE_M = 2.5, 10, 10_000, 0.001

BEAM = Rectangle(x_dim=0.1, y_dim=0.3)
HEB_300 = IShape(overall_width=0.3, overall_depth=0.3, web_thickness=0.011, flange_thickness=0.019)


@dataclass(frozen=True)
class Published:
    """What the paper's text says of its own fit (its figures carry no numbers).

    Attributes:
        outcome: in its words, or what they come to.
        rmse_mm: its cloud-to-cloud RMSE.
        tip_mm: the deviation of the tip; for case 4 only.
        iterations: until it had converged.
    """

    outcome: str
    rmse_mm: str = "-"
    tip_mm: str = "-"
    iterations: str = "-"


@dataclass(frozen=True)
class Case:
    """One cloud of Table 1.

    Attributes:
        name: as in the table; 3a with its radius.
        profile: of the element.
        bends: that deform it.
        missing: faces left out.
        solved_in_paper: whether the paper calls its own fit of it successful.
        words: what it is, in the table's words.
        published: the paper's own figures.
        start: support.
        end: support.
    """

    name: str
    profile: Profile
    bends: tuple[Bend, ...]
    missing: tuple[str, ...] = ()
    solved_in_paper: bool = True
    words: str = ""
    published: Published = Published("not in the paper")
    start: Start = "fixed"
    end: End = "free"

    @property
    def element(self) -> Element:
        """The design."""
        return Element(self.name, self.profile, LENGTH_M, SEGMENTS, start=self.start, end=self.end)

    @property
    def study(self) -> str:
        """The case study it belongs to, "1" to "4", or ours, "5"."""
        return self.name[0]

    def scan(
        self, seed: int = 1, points: int = POINTS, noise_m: float = NOISE_M, layout: Layout = "random"
    ) -> SimulatedScan:
        """Return the case's cloud; the paper's own lie on a grid (its section 4.1)."""
        return simulate(
            self.element,
            bends=self.bends,
            points=points,
            noise_m=noise_m,
            seed=seed,
            missing=self.missing,
            layout=layout,
        )


SMALL, MODERATE, LARGE = (Bend(8, "x", degrees) for degrees in (9.0, 22.5, 45.0))

_RECTANGLE = Published("aligned", "< 6", iterations="80+")
# The text of section 4.4 gives 4 to 5 mm for the circular sections of case 3, and no figure for case 2.
_COLUMN = Published("aligned", iterations="40 to 60")
_CIRCLE = Published("aligned", "4 to 5", iterations="40 to 60")
_PLANAR = Published("aligned", "6 to 9", iterations="80+")

TABLE_1 = (
    Case("1a", BEAM, (SMALL,), words="beam, 9° at 8", published=_RECTANGLE),
    Case("1b", BEAM, (MODERATE,), words="beam, 22.5° at 8", published=_RECTANGLE),
    Case("1c", BEAM, (LARGE,), solved_in_paper=False, words="beam, 45° at 8", published=Published("complete failure")),
    Case("2a", Circle(0.15), (SMALL,), words="round column, 9° at 8", published=_COLUMN),
    Case("2b", Circle(0.15), (Bend(4, "x", 9.0),), words="round column, 9° at 4", published=_COLUMN),
    Case("3a-150", Circle(0.15), (MODERATE,), words="circle 0.15 m", published=_CIRCLE),
    Case("3a-200", Circle(0.2), (MODERATE,), words="circle 0.2 m", published=_CIRCLE),
    Case("3b", RectangleHollow(0.35, 0.35, 0.01), (MODERATE,), words="box 0.35 m", published=_PLANAR),
    Case("3c", HEB_300, (MODERATE,), words="H-section", published=_PLANAR),
    Case("4a", BEAM, (MODERATE,), ("+x",), words="parallel side missing", published=Published("aligned", tip_mm="15")),
    Case(
        "4b",
        BEAM,
        (MODERATE,),
        ("+y",),
        words="perpendicular side missing",
        published=Published("aligned", tip_mm="48"),
    ),
    Case(
        "4c",
        BEAM,
        (MODERATE,),
        ("+x", "+y"),
        solved_in_paper=False,
        words="both missing (50 %)",
        published=Published("complete failure", tip_mm="> 300"),
    ),
)

BOTH_ENDS = (
    Case(
        "5a",
        BEAM,
        (Bend(2, "x", 4.7), Bend(6, "x", -9.4), Bend(10, "x", 4.7)),
        words="beam fixed at both ends",
        end="fixed",
    ),
    Case(
        "5b",
        Circle(0.15),
        (Bend(1, "x", 6.3), *(Bend(k, "x", -1.4) for k in range(2, 11))),
        words="column pinned at both ends",
        start="pinned",
        end="pinned",
    ),
)

PAPER = TABLE_1 + BOTH_ENDS


def named(name: str) -> Case:
    """Return a case by its name.

    Raises:
        KeyError: there is none of that name.
    """
    return {c.name: c for c in PAPER}[name]


def make(case: Case | str, seed: int = 1) -> tuple[Element, SimulatedScan]:
    """Return the design and the cloud of a case, or of its name."""
    if isinstance(case, str):
        case = named(case)
    return case.element, case.scan(seed)
