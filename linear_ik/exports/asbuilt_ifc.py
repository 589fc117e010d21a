"""The as-built model: the design's IFC file with the fitted elements as they were found (extra bim)."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, get_args

import numpy as np

from linear_ik.asbuilt.bodies import Body, axis_items, body_items
from linear_ik.asbuilt.draft import Draft
from linear_ik.asbuilt.exchange import Exchange
from linear_ik.asbuilt.output import write_model
from linear_ik.asbuilt.properties import PropertySets
from linear_ik.asbuilt.shape import AsBuiltError, bent_shape
from linear_ik.atomic import check_writable
from linear_ik.bim.broken import BROKEN, said
from linear_ik.bim.file import open_model
from linear_ik.bim.products import LINEAR_CLASSES, guid_of, linear_products, not_named, text
from linear_ik.errors import LinearIkError, SettingsError
from linear_ik.result import FitResult


def write_asbuilt_ifc(
    design_path: str | os.PathLike[str],
    results: Mapping[str, FitResult],
    out_path: str | os.PathLike[str],
    *,
    body: Body = "extrusions",
    keep_design: bool = False,
    when: datetime | None = None,
    remarks: Mapping[str, str] | None = None,
    on_left: Callable[[str, str], None] | None = None,
) -> Path:
    """Write the design file with each fitted element's body replaced by its bent shape.

    GlobalIds, types, materials, placements and relations stay, openings too, where they were
    designed. A mapped or shared body is left to the other products. Cuts of the designed body
    (boolean results) are not in the new one. Every fitted element, and every other one of a linear
    class, gets the property set LinearIK_AsBuilt: status, figures with their 95 % bands, date;
    one that was not found or not fitted stays as designed and says so. Figures against the vertical take the
    model's z as up.

    Args:
        design_path: an IFC file (.ifc or .ifczip): IFC2X3, IFC4 or IFC4X3.
        results: GlobalId -> result, in the model's coordinates.
        out_path: the new file; may be the design's.
        body: "extrusions": one a segment with the design's own profile, cut square, so that at a kink of angle a
            neighbours overlap or gap by tan(a / 2) times the half depth; a round section is one IfcSweptDiskSolid along
            a line with an arc at each kink (in IFC2X3 where square cuts would gap by more than 1 mm); a tapered one
            is triangulated. "triangles": one closed mesh, mitred
            (IfcTriangulatedFaceSet, in IFC2X3 IfcFacetedBrep).
        keep_design: keep each replaced body as a second representation with the identifier Reference.
        when: date of the results; now when left out.
        remarks: GlobalId -> what of the designed body is not in the element (`Member.remark`), for the property set.
        on_left: called with the GlobalId of an element whose result contradicts itself, and what is wrong; it stays
            as designed and says so. Without it that is an error.

    Returns:
        The path.

    Raises:
        DesignError: a design that cannot be read.
        AsBuiltError: a GlobalId that the design has not, a result that contradicts itself.
        OutputError: a path that cannot be written to.
        SettingsError: another ``body``.
    """
    if body not in get_args(Body):
        raise SettingsError("body", repr(body), "one of " + ", ".join(get_args(Body)))
    target = check_writable(out_path)
    date = datetime.now(timezone.utc) if when is None else when
    draft = Draft(open_model(design_path).model, Path(design_path))
    linear, nameless = [p for p, _ in linear_products(draft.model, LINEAR_CLASSES)], not_named(draft.model)
    products: dict[str, Any] = {}
    for product in (*(p for p in linear if p.id() not in nameless), *draft.model.by_type("IfcProduct")):
        products.setdefault(guid_of(product), product)
    results = {text(guid): result for guid, result in results.items()}
    unknown = next((guid for guid in results if guid not in products), None)
    if unknown is not None:
        raise AsBuiltError(unknown, f"no product of {design_path}", "the GlobalId of an element of the design")
    sheets, exchange = PropertySets(draft, date), Exchange(draft, keep_design)
    for guid, result in results.items():
        product = products[guid]
        if result.status == "not_scanned":
            sheets.of_not_found(product, result)
            continue
        try:
            shape = bent_shape(result)
            T_product_model = np.asarray(np.linalg.inv(draft.T_model_product(product)), dtype=np.float64)  # noqa: N806 (T_target_source)
            # What may fail comes before the body is replaced.
            said_of_it = sheets.of_fitted(result, exchange.notes(product, (remarks or {}).get(guid, "")))
            items = body_items(draft, shape, T_product_model, body, exchange.designed_profile(product))
            exchange.replace(product, items, axis_items(draft, shape, T_product_model))
            sheets.attach([product], said_of_it)
        except (LinearIkError, *BROKEN) as error:
            known = isinstance(error, LinearIkError)
            what = f"{error.subject}: {error.what}" if isinstance(error, LinearIkError) else said(error)
            if on_left is None:
                expected = error.expected if isinstance(error, LinearIkError) else "a product that its schema allows"
                raise AsBuiltError(guid, what, expected) from None
            sheets.of_not_found(product, result, [f"The fitted shape cannot be drawn: {error if known else what}"])
            on_left(guid, what)
    exchange.finish()
    for reason in ("", *sorted(set(nameless.values()))):
        some = [p for p in linear if nameless.get(p.id(), "") == reason]
        sheets.of_not_fitted([p for p in some if reason or guid_of(p) not in results], reason)
    return write_model(draft.model, target, date)
