"""Element + urdf_templates -> URDF: the chain as any robotics tool reads it."""

from __future__ import annotations

import hashlib
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from linear_ik.atomic import check_writable, write_atomically
from linear_ik.element import Element
from linear_ik.errors import OutputError
from linear_ik.profile import Circle, Rectangle
from linear_ik.section import body_inertia, extruded_mesh

if TYPE_CHECKING:
    import jinja2

TEMPLATE = "element.urdf.j2"
# No motor drives these joints: bounds that no tool's simulation runs into, yet finite as URDF wants them.
EFFORT_NM = 1e6
VELOCITY_RAD_S = 10.0
RGBA = (0.60, 0.64, 0.70, 1.0)


def generate_urdf(element: Element, mesh_folder: str | None = None) -> str:
    """Return the URDF of an element's chain, in the element's own frame.

    Links: ``base``, ``segment_01`` ... , ``end``, and two massless links a segment.
    Joints: ``segment_01_z``, ``segment_01_y``, ``segment_01_x``, ``segment_02_z``, ... all
    coincident at the segment's start node, so that its orientation is R = Rz Ry Rx and
    Pinocchio's q is (z, y, x) a segment. The numbers have as many digits as the count
    needs, two at least. Lengths in metres, angles in radians, every number exact.

    Args:
        element: what was designed; its placement stays outside.
        mesh_folder: folder of the meshes, as the URDF should name it. Only rectangles and
            circles that do not taper do without; the others have no visual and no
            collision geometry when it is None. `write_urdf` writes the meshes as well.

    Returns:
        XML text without a declaration, which is UTF-8 by definition.
    """
    return _template().render(
        name=_printable(element.name),
        segments=_segments(element, mesh_folder),
        length_m=element.segment_length_m,
        effort_nm=EFFORT_NM,
        velocity_rad_s=VELOCITY_RAD_S,
        rgba=RGBA,
    )


def write_urdf(element: Element, path: str | os.PathLike[str]) -> list[Path]:
    """Write an element's URDF, and the mesh of a segment that is no box or cylinder.

    The mesh, one for all segments or, of a tapered element, one for each, goes to
    ``<name>_meshes/`` beside the URDF, which names it relative to itself. Its file name
    is a digest of the section and length, so that elements of one name in one folder
    keep their own.

    Args:
        element: what was designed.
        path: of the URDF; missing folders are made.

    Returns:
        The paths written, the URDF first.

    Raises:
        OutputError: a path that cannot be written to.
    """
    target = check_writable(path)
    if not needs_mesh(element):
        return [write_atomically(target, generate_urdf(element))]
    from trimesh.exchange.stl import export_stl

    folder, paths = f"{file_stem(element.name)}_meshes", []
    # The meshes first: a URDF never names a file that is not there.
    for k in range(element.segments if element.is_tapered else 1):
        start, end = element.segment_profiles(k)
        content = export_stl(extruded_mesh(start, element.segment_length_m, end))
        paths.append(write_atomically(target.parent / folder / mesh_name(element, k), content))
    return [write_atomically(target, generate_urdf(element, folder)), *paths]


def segment_names(segments: int) -> list[str]:
    """Return the links' names in chain order, which is also their sorted order."""
    width = max(2, len(str(segments)))
    return [f"segment_{k:0{width}d}" for k in range(1, segments + 1)]


def joint_names(segments: int) -> list[str]:
    """Return the joints' names in the order of Pinocchio's q: z, y, x of each segment."""
    return [f"{name}_{axis}" for name in segment_names(segments) for axis in "zyx"]


def needs_mesh(element: Element) -> bool:
    """Say whether URDF has no primitive of this element's segments."""
    return element.is_tapered or not isinstance(element.profile, (Rectangle, Circle))


def mesh_name(element: Element, k: int = 0) -> str:
    """Return the file name of the mesh of segment k (from 0), which all share where nothing tapers."""
    start, end = element.segment_profiles(k)
    shape = f"{start!r} {element.segment_length_m!r}" + (f" {end!r}" if end is not None else "")
    return f"{element.profile.type}_{hashlib.sha256(shape.encode()).hexdigest()[:8]}.stl"


def file_stem(name: str) -> str:
    """Return a name that is safe in any file system and in a URDF's mesh path."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:80] or "element"


def template_folder() -> Path:
    """Return the folder of the URDF templates.

    Raises:
        OutputError: a broken installation.
    """
    package = Path(__file__).resolve().parent
    for folder in (package / "urdf_templates", package.parent / "urdf_templates"):
        if (folder / TEMPLATE).is_file():
            return folder
    raise OutputError(package / "urdf_templates", "is missing", "linear_ik installed with its urdf_templates")


def _segments(element: Element, mesh_folder: str | None) -> list[dict[str, object]]:
    """Return name, joint limits, inertia and geometry of each segment, as the template takes them."""
    bodies: list[dict[str, object]] = []
    for k in range(element.segments if element.is_tapered else 1):
        start, end = element.segment_profiles(k)
        inertia = body_inertia(start, element.segment_length_m, element.density_kg_m3, end)
        bodies.append({"body": inertia, "geometry": _geometry(element, k, mesh_folder)})
    names, limits = segment_names(element.segments), element.joint_limits_rad.tolist()
    return [
        {"name": name, "limits_rad": dict(zip("xyz", limits[k], strict=True)), **bodies[min(k, len(bodies) - 1)]}
        for k, name in enumerate(names)
    ]


def _geometry(element: Element, k: int, mesh_folder: str | None) -> dict[str, object]:
    profile = element.profile
    if isinstance(profile, Rectangle) and not element.is_tapered:
        return {"kind": "box", "size_m": (profile.x_dim, profile.y_dim)}
    if isinstance(profile, Circle) and not element.is_tapered:
        return {"kind": "cylinder", "radius_m": profile.radius}
    if mesh_folder is None:
        return {"kind": "none"}
    folder = mesh_folder.rstrip("/")
    file = mesh_name(element, k)
    return {"kind": "mesh", "file": f"{folder}/{file}" if folder else file}


@lru_cache(maxsize=1)
def _template() -> jinja2.Template:
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder()), undefined=jinja2.StrictUndefined, autoescape=True
    )
    # repr is the shortest text that reads back as the same double.
    environment.filters["exact"] = lambda value: Markup(repr(float(value)))
    return environment.get_template(TEMPLATE)


def _printable(name: str) -> str:
    """Replace the characters that XML 1.0 cannot hold (its production 2)."""
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", name)
