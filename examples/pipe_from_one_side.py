"""Bend a pipe, scan it from one side only, and read what the covariance says of the direction that is not seen.

Run it with `python examples/pipe_from_one_side.py`.
"""

import numpy as np

import linear_ik

PIPE = {
    "name": "pipe run",
    "profile": {"type": "circle", "radius": 0.084},
    "length": 4.0,
    "segments": 8,
    "placement": {"location": [0, 0, 2.5], "axis": [1, 0, 0], "ref_direction": [0, 1, 0]},
    "start": "free",
}
BENDS = ("3:y:1.5", "6:x:-1.0")
SCANNER = (2.0, -3.0, 1.5)  # at y = -3 m: it sees the pipe's front from below


def main() -> None:
    """Scan, fit, print the deviations of the middle node along and across the line of sight."""
    element = linear_ik.element_from_mapping(PIPE)
    scan = linear_ik.scan_virtually(element, stations=[SCANNER], bends=BENDS, points=4000, seed=1)
    result = linear_ik.fit(element, scan.without_truth())
    print(f"status: {result.status}")
    for reason in result.reasons:
        print(f"  {reason}")
    middle = element.segments // 2
    sight = result.nodes_m[middle] - SCANNER
    sight[0] = 0.0  # across the pipe
    sight /= np.linalg.norm(sight)
    directions = {
        "along the pipe": np.array([1.0, 0.0, 0.0]),
        "along the line of sight": sight,
        "across it": np.cross([1.0, 0.0, 0.0], sight),
    }
    covariance, error = result.nodes_covariance_m2[middle], result.nodes_m[middle] - scan.nodes_m[middle]
    print(f"node {middle}, 1.96 standard deviations, and the error against the truth:")
    for name, direction in directions.items():
        band = 1.96 * np.sqrt(direction @ covariance @ direction)
        print(f"  {name:<24}{1e3 * band:8.2f} mm {1e3 * (direction @ error):8.2f} mm")
    seen = ", ".join(f"{segment.coverage:.0%}" for segment in result.segments)
    print(f"share of each segment's surface with a point within 2 % of the length: {seen}")


if __name__ == "__main__":
    main()
