"""What a simulated scan was made of, as JSON: the keys of a result that the truth has."""

from __future__ import annotations

import json
import os
from pathlib import Path

from linear_ik.atomic import write_atomically
from linear_ik.simulate import SimulatedScan

SCHEMA = "linear_ik/truth/1"


def write_truth(scan: SimulatedScan, path: str | os.PathLike[str]) -> Path:
    """Write the true nodes (metres), joint angles (radians, x y z) and base pose.

    Raises:
        OutputError: the file cannot be written.
    """
    truth = {
        "schema": SCHEMA,
        "nodes_m": scan.nodes_m.tolist(),
        "q": scan.q.tolist(),
        "joint_angles_rad": scan.joint_angles_rad.tolist(),
        "base_pose": scan.base_pose.tolist(),
    }
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in truth.items())
    return write_atomically(path, "{\n" + lines + "\n}\n")
