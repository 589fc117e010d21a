"""The products of a model: which are of a linear class, which others are in the way, what they are called."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from linear_ik.errors import SettingsError

LINEAR_CLASSES = (
    "IfcBeam",
    "IfcColumn",
    "IfcMember",
    "IfcPile",
    "IfcPipeSegment",
    "IfcDuctSegment",
    "IfcCableCarrierSegment",
    "IfcRail",
    "IfcReinforcingBar",
)
# Of IFC2X3, told apart by their types.
FLOW_SEGMENTS = ("IfcPipeSegment", "IfcDuctSegment", "IfcCableCarrierSegment")
# What is no body that a scanner could see.
UNSEEN = ("IfcFeatureElementSubtraction", "IfcVirtualElement", "IfcFeatureElementAddition")


def check_classes(classes: Iterable[str]) -> tuple[str, ...]:
    """Return the classes.

    Raises:
        SettingsError: none, or one that is not of LINEAR_CLASSES.
    """
    chosen = (classes,) if isinstance(classes, str) else tuple(classes)
    wrong = next((c for c in chosen if c not in LINEAR_CLASSES), None)
    if wrong is not None or not chosen:
        raise SettingsError("classes", repr(wrong) if chosen else "none", "of " + ", ".join(LINEAR_CLASSES))
    return chosen


def linear_products(model: Any, classes: tuple[str, ...]) -> list[tuple[Any, str]]:
    """Return every product of the classes with the name of its class, in the file's order.

    Their standard cases (IfcBeamStandardCase) are among them. An IFC2X3 IfcFlowSegment is of
    the class that its type is of; one without a type is kept, as IfcFlowSegment, where any
    class of such segments is asked for.
    """
    found: dict[int, tuple[Any, str]] = {}
    for name in classes:
        for product in _by_type(model, name):
            found[product.id()] = (product, product.is_a())
    if model.schema == "IFC2X3" and (flow := [c for c in classes if c in FLOW_SEGMENTS]):
        for product in model.by_type("IfcFlowSegment"):
            name = _class_of_type(product)
            if name in flow or name == "IfcFlowSegment":
                found[product.id()] = (product, name)
    return [found[key] for key in sorted(found)]


def other_products(model: Any, linear: set[int]) -> list[Any]:
    """Return the other products that may have a body: elements, and the terrain of a site."""
    out = []
    for product in [*model.by_type("IfcElement"), *model.by_type("IfcSite"), *_by_type(model, "IfcProxy")]:
        if product.id() not in linear and product.Representation is not None:
            if not any(_is_a(product, name) for name in UNSEEN):
                out.append(product)
    return out


def text(value: object) -> str:
    """Return an attribute as one line, empty where the file has none."""
    return " ".join(str(value).split()) if value is not None else ""


def guid_of(product: Any) -> str:
    """Return a product's GlobalId, without the blanks that some writers put in; empty where it has none."""
    return text(product.GlobalId)


def not_named(model: Any) -> dict[int, str]:
    """Return the linear products that no GlobalId names, by id, with the reason; it names the first that has it."""
    out: dict[int, str] = {}
    seen: set[str] = set()
    for product, _ in linear_products(model, LINEAR_CLASSES):
        guid = guid_of(product)
        if not guid:
            out[product.id()] = "it has no GlobalId"
        elif guid in seen:
            out[product.id()] = "its GlobalId is that of another element"
        seen.add(guid)
    return out


def profile_name(product: Any, solid: Any) -> str:
    """Return the name of a product's section: its profile's, else its material profile's, else its type's."""
    import ifcopenshell.util.element as elements

    area = getattr(solid, "SweptArea", None)
    if area is None and solid is not None and solid.is_a("IfcSectionedSolid"):
        area = solid.CrossSections[0]
    if area is not None and area.ProfileName:
        return text(area.ProfileName)
    material = elements.get_material(product, should_skip_usage=True)
    if material is not None and material.is_a("IfcMaterialProfileSet"):
        names = [p.Profile.ProfileName for p in material.MaterialProfiles if p.Profile and p.Profile.ProfileName]
        if names or material.Name:
            return text(names[0] if names else material.Name)
    kind = elements.get_type(product)
    return text(product.ObjectType or (kind.Name if kind is not None else None))


def _class_of_type(product: Any) -> str:
    import ifcopenshell.util.element as elements

    kind = elements.get_type(product)
    return str(kind.is_a()).removesuffix("Type") if kind is not None else "IfcFlowSegment"


def _by_type(model: Any, name: str) -> list[Any]:
    """Return the products of a class, none where the file's version doesn't know it."""
    try:
        return list(model.by_type(name))
    except RuntimeError:
        return []


def _is_a(product: Any, name: str) -> bool:
    return bool(product.is_a(name))
