"""Swept disks of as-built files: the body is where the fit says, however finely a kernel draws it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from captured import DATA

ifcopenshell = pytest.importorskip("ifcopenshell")

from asbuilt_samples import random_result  # noqa: E402

from linear_ik.bim import read_design  # noqa: E402
from linear_ik.exports.asbuilt_ifc import write_asbuilt_ifc  # noqa: E402

PILES = DATA.parent / "ifc" / "16_foot_piles_typed.ifc"


@pytest.fixture(scope="module")
def piles(tmp_path_factory):
    """A file of four hollow piles, in feet, with two of them bent: the kernel takes its time over each."""
    if not PILES.exists():
        pytest.skip(f"{PILES} is not there (LINEAR_IK_DATA)")
    results = {m.guid: random_result(m.element, i) for i, m in enumerate(read_design(PILES).members) if i in (0, 2)}
    assert len(results) == 2
    return write_asbuilt_ifc(PILES, results, tmp_path_factory.mktemp("disks") / "out.ifc"), results


def off_the_axes(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """How far points [P] are from the line through each segment [N][P]."""
    along = np.diff(nodes, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    off = points - nodes[:-1, None]
    return np.linalg.norm(off - np.einsum("kpi,ki->kp", off, along)[:, :, None] * along[:, None], axis=2)


@pytest.mark.parametrize("deflection", [None, 1e-4])
def test_every_corner_that_the_kernel_draws_is_on_the_tube(piles: tuple[Path, dict], deflection: float | None) -> None:
    import ifcopenshell.geom

    path, results = piles
    model = ifcopenshell.open(str(path))
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    if deflection is not None:
        settings.set("mesher-linear-deflection", deflection)
        settings.set("mesher-angular-deflection", 0.1)
    for guid, result in results.items():
        geometry = ifcopenshell.geom.create_shape(settings, model.by_guid(guid)).geometry
        corners = np.array(geometry.verts).reshape(-1, 3)
        tube, nodes = result.element.profile, result.nodes_m
        away = off_the_axes(corners, nodes)
        radii = np.array([tube.radius, tube.radius - tube.wall_thickness])
        # Corners, not chords: those of a coarse ring are up to 2 mm inside such a pile.
        assert np.abs(away[:, :, None] - radii).min(axis=(0, 2)).max() < 5e-5
        along = np.diff(nodes, axis=0) / result.element.segment_length_m
        for end, own, before in ((nodes[0], along[0], along[1]), (nodes[-1], along[-1], along[-2])):
            # The ring of an end, whole and about the node. The kernel may leave it square to the segment before:
            # at its rim, that is radius times the last angle away from where it should be.
            kink = np.arccos(np.clip(own @ before, -1.0, 1.0))
            ring = corners[np.linalg.norm(corners - end, axis=1) < tube.radius + 1e-5]
            assert len(ring) >= 90
            assert np.abs(np.linalg.norm(ring - end, axis=1)[:, None] - radii).min(axis=1).max() < 1e-5
            assert np.abs((ring - end) @ own).max() < 1e-5 + tube.radius * kink


def test_the_axis_reads_back_to_a_hundredth_of_a_millimetre(piles: tuple[Path, dict]) -> None:
    path, results = piles
    for member in read_design(path).members:
        if member.guid not in results:
            continue
        element, nodes = member.element, results[member.guid].nodes_m
        T = element.placement.T_world_element
        read = element.design.nodes_m @ T[:3, :3].T + T[:3, 3]
        assert element.segments == 25
        np.testing.assert_allclose(read, nodes, rtol=0, atol=1e-5)
