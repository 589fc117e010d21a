"""Compare two scans of one column: what has moved, and is it more than the scans' own uncertainty?

Run it with `python examples/two_epochs.py`.
"""

import linear_ik

COLUMN = {
    "name": "column",
    "profile": "HEB200",
    "length": 3.0,
    "placement": {"location": [0, 0, 0], "axis": [0, 0, 1], "ref_direction": [1, 0, 0]},
    "start": "free",
}
# The column is bent in both; by the second scan a joint has turned by a twentieth of a degree more.
EPOCHS = {"2024": ("3:x:1.0", "7:x:-1.5"), "2025": ("3:x:1.0", "7:x:-1.5"), "2026": ("3:x:1.05", "7:x:-1.5")}


def main() -> None:
    """Fit each epoch, test each against the first."""
    element = linear_ik.element_from_mapping(COLUMN)
    results = {}
    for seed, (year, bends) in enumerate(EPOCHS.items()):
        scan = linear_ik.simulate(element, bends=bends, points=6000, noise_m=0.0015, seed=seed)
        results[year] = linear_ik.fit(element, linear_ik.Scan(scan.points))
        print(f"{year}: {results[year].status}")
    for year in ("2025", "2026"):
        comparison = linear_ik.compare(results["2024"], results[year], level=0.05)
        (movement,) = comparison.elements
        print(f"2024 to {year}: {movement.verdict}, p = {movement.p_value:.2g}")
        k = int(movement.across_m.argmax())
        across, along = 1e3 * movement.across_m[k], 1e3 * movement.along_m[k]
        print(f"  farthest across the axis: node {k}, {across:.2f} mm; along it {along:.2f} mm")


if __name__ == "__main__":
    main()
