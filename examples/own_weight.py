"""Judge a long beam that hangs under its own weight: what is elastic, what was made crooked.

Run it with `python examples/own_weight.py`.
"""

import linear_ik
from linear_ik.elastic_sag import elastic_sag
from linear_ik.tolerances import material_named

ELEMENT = {
    "name": "long beam",
    "profile": "IPE300",
    "length": 12.0,
    "placement": {"location": [0, 0, 3], "axis": [1, 0, 0], "ref_direction": [0, 1, 0]},
    "start": "free",
}
# Degrees of single joints: the middle hangs 16 mm.
BENDS = ("1:x:0.21", "4:x:-0.14", "6:x:-0.14", "8:x:-0.14")


def main() -> None:
    """Simulate, fit, say what own weight explains, judge with and without it."""
    element = linear_ik.element_from_mapping(ELEMENT)
    scan = linear_ik.simulate(element, bends=BENDS, points=12_000, noise_m=0.0015, seed=3)
    result = linear_ik.fit(element, linear_ik.Scan(scan.points))
    steel, limits = material_named("steel"), linear_ik.load_tolerances("nsss")
    print(f"{steel} ({steel.source})")
    for supports in ("simple", "clamped", "cantilever"):
        print(f"  {supports:<11}{1e3 * elastic_sag(element, supports, steel).largest_m:6.2f} mm off its chord")
    for known in (
        linear_ik.Conditions("self_weight"),
        linear_ik.Conditions("self_weight", supports="simple", material=steel),
        linear_ik.Conditions("self_weight", supports="clamped", material=steel),
    ):
        (verdict,) = linear_ik.verdicts(result, limits, known)
        print(f"{known.supports or 'not stated'}: {verdict.outcome}, {verdict.reason}")


if __name__ == "__main__":
    main()
