"""YAML without its surprises: YAML 1.2's numbers, no tags, no aliases, no key twice.

PyYAML follows YAML 1.1, in which ``1e-3`` is text, ``010`` is 8, ``2:30`` is 150 and
``no`` is False. A file of measures wants none of that.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from typing import Any

import yaml

from linear_ik.errors import ElementError

DEEPEST = 16
NUMBER = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
MOST_DIGITS = 300  # what a double holds, with room to spare


class StrictLoader(yaml.SafeLoader):
    """Loads plain values by YAML 1.2's core schema, and refuses the rest."""

    # A fresh table: the inherited one belongs to every user of PyYAML.
    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}
    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node after a look at what it is."""
        event = self.peek_event()  # type: ignore[no-untyped-call]
        tag = getattr(event, "tag", None)
        if isinstance(event, yaml.AliasEvent) or tag is not None:
            what = f"tag {tag}" if tag is not None else f"alias *{event.anchor}"
            raise yaml.MarkedYAMLError(problem=f"{what} is not used in such a file", problem_mark=event.start_mark)
        if self._depth >= DEEPEST:
            raise yaml.MarkedYAMLError(problem="nested too deeply", problem_mark=event.start_mark)
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """Construct a mapping whose keys are texts, each there once."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key that is no text", problem_mark=key.start_mark)
            if key.value in seen:
                raise yaml.MarkedYAMLError(problem=f"key {key.value} is there twice", problem_mark=key.start_mark)
            seen.add(key.value)
        return {key.value: self.construct_object(value, deep=True) for key, value in node.value}


def whole_number(text: str) -> int:
    """Return an integer (JSON's parse_int).

    Raises:
        ElementError: more digits than any measure has.
    """
    if len(text) > MOST_DIGITS:
        raise ElementError("element", f"a number of {len(text)} digits: {text[:20]}...", "numbers of a reasonable size")
    return int(text)


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return JSON's pairs as a dict (its object_pairs_hook).

    Raises:
        ElementError: a key is there twice.
    """
    mapping: dict[str, Any] = {}
    for key, value in pairs:
        if key in mapping:
            raise ElementError("element", f"key {key} is there twice", "each key once")
        mapping[key] = value
    return mapping


for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+", list("-+0123456789")),
    ("float", rf"{NUMBER}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", list("-+.0123456789")),
):
    StrictLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), _first)


def _whole_number(loader: StrictLoader, node: yaml.ScalarNode) -> int:
    return whole_number(loader.construct_scalar(node))


# SafeLoader's own reads 010 as octal and 1:30 as sexagesimal.
StrictLoader.add_constructor("tag:yaml.org,2002:int", _whole_number)
