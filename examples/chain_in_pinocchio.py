"""Load the generated URDF into Pinocchio, set it to the fitted q, and find the fitted nodes again.

Run it with `python examples/chain_in_pinocchio.py`.
"""

import tempfile
from pathlib import Path

import numpy as np
import pinocchio

import linear_ik

ELEMENT = {
    "name": "arm",
    "profile": {"type": "rectangle", "x_dim": 0.1, "y_dim": 0.2},
    "length": 2.0,
    "segments": 5,
    "placement": {"location": [4, 1, 0.5], "axis": [0, 1, 0], "ref_direction": [1, 0, 0]},
}


def main() -> None:
    """Write the URDF, fit, compare Pinocchio's frames with the result."""
    element = linear_ik.element_from_mapping(ELEMENT)
    scan = linear_ik.simulate(element, bends=("2:x:10", "4:y:-6"), points=3000, seed=1)
    result = linear_ik.fit(element, linear_ik.Scan(scan.points))
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "arm.urdf"
        linear_ik.write_urdf(element, urdf)
        model = pinocchio.buildModelFromUrdf(str(urdf))
    print(f"joints: {', '.join(list(model.names)[1:4])}, ... {model.nq} in all")
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, result.q)
    # The URDF is in the element's own frame: base_pose takes it to the scan's coordinates.
    links = [f"segment_{k + 1:02}" for k in range(element.segments)] + ["end"]
    origins = np.array([data.oMf[model.getFrameId(link)].translation for link in links])
    nodes = origins @ result.base_pose[:3, :3].T + result.base_pose[:3, 3]
    print(f"Pinocchio's frames and the result's nodes differ by {np.abs(nodes - result.nodes_m).max():.1e} m at most")
    # The first six variables of the covariance are the base's.
    band = 1.96 * np.degrees(np.sqrt(np.diag(result.configuration_covariance)[6:]))
    print("joint            fitted  95 % band      true (degrees)")
    for name, value, width, truth in zip(list(model.names)[1:], result.q, band, scan.q, strict=True):
        print(f"{name:<14}{np.degrees(value):9.3f}  +- {width:.3f} {np.degrees(truth):9.3f}")


if __name__ == "__main__":
    main()
