"""One of every profile, for tests that must hold for all of them."""

from __future__ import annotations

from linear_ik.profile import (
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

SAMPLES: dict[str, Profile] = {
    "rectangle": Rectangle(0.1, 0.3),
    "rectangle_hollow": RectangleHollow(0.1, 0.3, 0.01),
    "circle": Circle(0.15),
    "circle_hollow": CircleHollow(0.15, 0.008),
    "i_shape": IShape(0.3, 0.3, 0.011, 0.019),
    "i_shape_fillet": IShape(0.3, 0.3, 0.011, 0.019, 0.027),
    "l_shape": LShape(0.15, 0.1, 0.012),
    "l_shape_fillet": LShape(0.15, 0.1, 0.012, 0.013),
    "u_shape": UShape(0.3, 0.1, 0.01, 0.016),
    "u_shape_fillet": UShape(0.3, 0.1, 0.01, 0.016, 0.016),
    "t_shape": TShape(0.14, 0.14, 0.015, 0.015),
    "t_shape_fillet": TShape(0.14, 0.14, 0.015, 0.015, 0.01),
    # Off its origin, not convex, with a corner in the middle of an edge.
    "polygon": Polygon([[0.5, 0.1], [0.6, 0.1], [0.7, 0.1], [0.75, 0.3], [0.6, 0.18], [0.52, 0.35]]),
}
