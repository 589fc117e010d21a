"""Fit one beam, and read its figures with their 95 % bands.

Run it with `python examples/beam_with_bands.py`.
"""

import numpy as np

import linear_ik

ELEMENT = {
    "name": "main beam",
    "profile": "IPE300",
    "length": 5.0,
    "placement": {"location": [0, 0, 3], "axis": [1, 0, 0], "ref_direction": [0, 1, 0]},
    "start": "free",
}
# Degrees of single joints: the middle hangs some 18 mm, and the beam leans sideways a little.
BENDS = ("2:x:0.4", "6:x:-0.8", "10:x:0.4", "4:y:0.2", "8:y:-0.2")


def main() -> None:
    """Simulate, fit, print."""
    element = linear_ik.element_from_mapping(ELEMENT)
    scan = linear_ik.simulate(element, bends=BENDS, points=8000, noise_m=0.0015, seed=1)
    result = linear_ik.fit(element, linear_ik.Scan(scan.points))
    print(f"status: {result.status}")
    for reason in result.reasons:
        print(f"  {reason}")
    found = linear_ik.deviations(result)
    for name in ("bow_m", "sag_m", "sweep_m", "camber_m", "end_displacement_m"):
        figure = getattr(found, name)
        where = "" if figure.node is None else f" at node {figure.node}"
        print(f"{name[:-2].replace('_', ' '):<18}{1e3 * figure.value:7.2f} +- {1e3 * figure.band:.2f} mm{where}")
    print("bending line w(s), downwards, mm:")
    for s, (_, y), (_, band) in zip(found.offset_m.s_m, found.offset_m.xy, found.offset_m.band, strict=True):
        print(f"  s = {s:4.2f} m {1e3 * (0.0 - y):7.2f} +- {1e3 * band:.2f}")
    error = np.linalg.norm((result.nodes_m - scan.nodes_m)[:, 1:], axis=1).max()
    print(f"largest error of a node across the axis, against the truth: {1e3 * error:.2f} mm")


if __name__ == "__main__":
    main()
