"""Exchange: a product's designed body gives way to its bent one.

What the file shares stays shared: a mapped or common representation is left to the other
products, and only what nothing else uses any more is removed. Styles and presentation layers
go over to the new items.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from linear_ik.asbuilt.bodies import Items
from linear_ik.asbuilt.draft import Draft
from linear_ik.bim.solids import body_representations

# They were computed from the designed body, and would contradict the new one.
DERIVED = ("Box", "CoG", "FootPrint", "Profile", "Lighting", "SurveyPoints")
OPENINGS = "Openings stay where they were designed."
PARTS = "What else the design shows of it is not in the as-built body"
CUTS = "Cuts at the ends, holes and copes of the designed body are not in the as-built one."
LAYERS = ("IfcPresentationLayerAssignment", "IfcPresentationLayerWithStyle")
# One style and a layer or two may be about an item: what is used more often is used by others.
MOST_ABOUT = 16
# What a representation consists of, and so may go with it.
OWN = ("IfcRepresentationItem", "IfcProfileDef", "IfcRepresentationMap", "IfcShapeRepresentation")


class Exchange:
    """Gives products new representations; `finish` removes what is left over."""

    def __init__(self, draft: Draft, keep_design: bool) -> None:
        """Take a file; ``keep_design`` keeps designed bodies as representations named Reference."""
        self._draft = draft
        self._keep_design = keep_design
        self._left_over: list[Any] = []
        self._layers: dict[int, tuple[list[int], list[Any]]] = {}

    def designed_profile(self, product: Any) -> Any:
        """Return the IfcProfileDef of the designed body, or None."""
        for representation in body_representations(product):
            for item in representation.Items:
                solid = _first_operand(item)
                if solid.is_a("IfcSweptAreaSolid"):
                    return solid.SweptArea
        return None

    def notes(self, product: Any, remark: str = "") -> list[str]:
        """Return what a reader should know of a product's new body; ``remark`` is that of the design's member."""
        items = [item for r in body_representations(product) for item in _mapped(r.Items)]
        parts = [f"{PARTS}: {remark}"] if remark and items else []
        cut = any(item.is_a("IfcBooleanResult") for item in items)
        return parts + [CUTS] * cut + [OPENINGS] * bool(getattr(product, "HasOpenings", ()))

    def replace(self, product: Any, body: Items, axis: Items) -> None:
        """Give a product a new body and a new axis.

        Args:
            product: an IfcProduct.
            body: in the product's own coordinates.
            axis: the same.
        """
        draft = self._draft
        bodies = body_representations(product)
        context = bodies[0].ContextOfItems if bodies else self._model_context()
        shape = self._own_shape(product)
        kept, axis_context = [], None
        for representation in shape.Representations:
            identifier = representation.RepresentationIdentifier
            if identifier == "Axis":
                axis_context = representation.ContextOfItems
            if representation in bodies and self._keep_design:
                kept.append(self._as_reference(representation, context))
            elif representation in bodies or identifier in ("Axis", *DERIVED) or not representation.Items:
                self._left_over.append(representation)
            else:
                kept.append(representation)
        new_body = draft.make(
            "IfcShapeRepresentation",
            ContextOfItems=context,
            RepresentationIdentifier="Body",
            RepresentationType=body.kind,
            Items=body.items,
        )
        new_axis = draft.make(
            "IfcShapeRepresentation",
            ContextOfItems=axis_context or draft.subcontext(context, "Axis", "GRAPH_VIEW"),
            RepresentationIdentifier="Axis",
            RepresentationType=axis.kind,
            Items=axis.items,
        )
        self._pass_on(bodies, new_body)
        shape.Representations = [new_axis, new_body, *kept]

    def finish(self) -> None:
        """Update the layers and remove what nothing uses any more."""
        for identifier, (gone, new) in self._layers.items():
            layer, without = self._draft.model.by_id(identifier), set(gone)
            layer.AssignedItems = [item for item in layer.AssignedItems if item.id() not in without] + new
        self._remove_unused(self._left_over)
        for layer in self._draft.model.by_type("IfcPresentationLayerAssignment"):
            if not layer.AssignedItems:
                self._draft.model.remove(layer)

    def _model_context(self) -> Any:
        import ifcopenshell.util.representation as util

        model = self._draft.model
        return util.get_context(model, "Model", "Body", "MODEL_VIEW") or util.get_context(model, "Model")

    def _own_shape(self, product: Any) -> Any:
        """Return a definition shape that no other product has."""
        make, shape = self._draft.make, product.Representation
        if shape is None:
            product.Representation = make("IfcProductDefinitionShape", Representations=[])
        elif len(shape.ShapeOfProduct) > 1:
            product.Representation = make("IfcProductDefinitionShape", Representations=shape.Representations)
        return product.Representation

    def _as_reference(self, representation: Any, context: Any) -> Any:
        """Return the designed body under another name; a shared one as a second representation of its items."""
        context = self._draft.subcontext(context, "Reference", "MODEL_VIEW")
        if len(representation.OfProductRepresentation) > 1:
            self._left_over.append(representation)
            representation = self._draft.make(
                "IfcShapeRepresentation",
                RepresentationType=representation.RepresentationType,
                Items=representation.Items,
            )
        representation.ContextOfItems = context
        representation.RepresentationIdentifier = "Reference"
        return representation

    def _pass_on(self, old: Iterable[Any], new: Any) -> None:
        """Give the new body what the old ones looked like."""
        styles = next((s for r in old for item in r.Items if (s := _styles(item))), None)
        for item in new.Items if styles else ():
            self._draft.make("IfcStyledItem", Item=item, Styles=styles)
        for representation in old:
            self._to_layers(representation.LayerAssignments, representation, [new])
            for item in representation.Items:
                layers = getattr(item, "LayerAssignment", None) or getattr(item, "LayerAssignments", None) or ()
                self._to_layers(layers, item, list(new.Items))

    def _to_layers(self, layers: Iterable[Any], old: Any, new: list[Any]) -> None:
        for layer in layers:
            gone, added = self._layers.setdefault(layer.id(), ([], []))
            if not self._keep_design:
                gone.append(old.id())
            added += new

    def _remove_unused(self, entities: list[Any]) -> None:
        """Remove entities, and what only they used, all the way down."""
        model, waiting = self._draft.model, {e.id(): e for e in entities}
        removed: set[int] = set()
        while waiting:
            identifier, entity = waiting.popitem()
            if identifier in removed:
                continue
            # What only describes it goes with it: removal takes it out of a layer's list.
            uses = model.get_total_inverses(entity)
            if uses > MOST_ABOUT:
                continue
            about = [i for i in model.get_inverse(entity) if i.is_a() in ("IfcStyledItem", *LAYERS)] if uses else []
            if uses > len(about):
                continue
            for described in about:
                if described.is_a("IfcStyledItem"):
                    model.remove(described)
            parts = {p.id(): p for p in model.traverse(entity, max_levels=1)[1:] if any(p.is_a(c) for c in OWN)}
            model.remove(entity)
            removed.add(identifier)
            waiting |= parts


def _mapped(items: Iterable[Any]) -> Iterator[Any]:
    """Yield items, those of a mapped representation in its place."""
    for item in items:
        if item.is_a("IfcMappedItem"):
            yield from _mapped(item.MappingSource.MappedRepresentation.Items)
        else:
            yield item


def _first_operand(item: Any) -> Any:
    """Return the solid that cuts were taken from, in the representation that is mapped."""
    return list(_made_of(item))[-1]


def _styles(item: Any) -> Any:
    """Return the styles of an item, or of what it is made of, or None."""
    return next((styled.Styles for part in _made_of(item) for styled in part.StyledByItem), None)


def _made_of(item: Any) -> Iterator[Any]:
    """Yield an item, then what is cut or mapped in it, down to the solid."""
    while True:
        yield item
        if item.is_a("IfcBooleanResult"):
            item = item.FirstOperand
        elif item.is_a("IfcMappedItem") and item.MappingSource.MappedRepresentation.Items:
            item = item.MappingSource.MappedRepresentation.Items[0]
        else:
            return
