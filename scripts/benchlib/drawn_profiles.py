"""Profiles drawn at random: every type, in sizes that are built."""

from __future__ import annotations

import numpy as np

from linear_ik import (
    Circle,
    CircleHollow,
    IShape,
    LShape,
    Polygon,
    Profile,
    Rectangle,
    RectangleHollow,
    TShape,
    UShape,
)

# Width, depth, web and flange thickness in mm, as rolled: slim beams, columns, channels.
I_MM = ((82, 160, 5, 7.4), (100, 200, 5.6, 8.5), (150, 300, 7.1, 10.7), (200, 200, 9, 15), (300, 300, 11, 19))
U_MM = ((50, 100, 6, 8.5), (75, 200, 8.5, 11.5), (100, 300, 10, 16))
L_MM = ((80, 80, 8), (100, 100, 10), (150, 100, 12), (150, 150, 15), (200, 200, 20))
T_MM = ((100, 100, 11), (140, 140, 15), (200, 200, 20))

OPEN = (IShape, LShape, TShape, UShape)
TYPES = (
    "rectangle",
    "rectangle_hollow",
    "circle",
    "circle_hollow",
    "i_shape",
    "l_shape",
    "u_shape",
    "t_shape",
    "polygon",
)


def drawn(kind: str, rng: np.random.Generator) -> Profile:
    """Return a profile of a type, in a size drawn at random.

    Raises:
        KeyError: no such type.
    """
    return {
        "rectangle": _rectangle,
        "rectangle_hollow": _rectangle_hollow,
        "circle": lambda r: Circle(float(r.uniform(0.05, 0.25))),
        "circle_hollow": lambda r: CircleHollow(float(r.uniform(0.04, 0.16)), 0.006),
        "i_shape": lambda r: IShape(*_metres(I_MM, r)),
        "l_shape": lambda r: LShape(*_metres(L_MM, r)),
        "u_shape": _u_shape,
        "t_shape": _t_shape,
        "polygon": _polygon,
    }[kind](rng)


def _metres(table: tuple[tuple[float, ...], ...], rng: np.random.Generator) -> list[float]:
    return [1e-3 * v for v in table[int(rng.integers(len(table)))]]


def _rectangle(rng: np.random.Generator) -> Profile:
    x, y = rng.uniform(0.08, 0.4), rng.uniform(0.08, 0.5)
    return Rectangle(round(x, 2), round(y, 2))


def _rectangle_hollow(rng: np.random.Generator) -> Profile:
    x, y = rng.choice([0.06, 0.08, 0.1, 0.15, 0.2, 0.3], 2)
    return RectangleHollow(float(x), float(y), 0.006)


def _u_shape(rng: np.random.Generator) -> Profile:
    width, depth, web, flange = _metres(U_MM, rng)
    return UShape(depth, width, web, flange)


def _t_shape(rng: np.random.Generator) -> Profile:
    depth, width, thickness = _metres(T_MM, rng)
    return TShape(depth, width, thickness, thickness)


def _polygon(rng: np.random.Generator) -> Profile:
    """Return a convex section of five or six corners, or a stepped sill that is not convex."""
    size = rng.uniform(0.12, 0.35)
    if rng.random() < 0.3:
        corners = np.array([[0, 0], [1, 0], [1, 0.4], [0.5, 0.4], [0.5, 1], [0, 1]])
        return Polygon((size * (corners - 0.5)).round(4).tolist())
    count = int(rng.integers(5, 7))
    angle = (np.arange(count) + rng.uniform(-0.2, 0.2, count)) * (2 * np.pi / count)
    corners = size * np.column_stack([0.5 * np.cos(angle), rng.uniform(0.4, 0.6) * np.sin(angle)])
    return Polygon(corners.round(4).tolist())
