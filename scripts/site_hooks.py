"""Hooks of the site: shapes such as [N+1][3] in pages and docstrings are shapes, not links."""

from __future__ import annotations

import re
from typing import Any

from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor
from mkdocs.plugins import event_priority

SHAPE = r"(?:\[[A-Z0-9][A-Za-z0-9 +*]{0,12}\]){2,}"
BEFORE_LINKS = 175  # Markdown's own references have 170, code spans 190


class _Shape(InlineProcessor):
    def handleMatch(self, m: re.Match[str], data: str) -> tuple[str, int, int]:  # type: ignore[override] # noqa: N802
        return m.group(0), m.start(0), m.end(0)


class Shapes(Extension):
    """Takes shapes as they are written."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 - Markdown's name
        """Register the pattern."""
        md.inlinePatterns.register(_Shape(SHAPE, md), "shape", BEFORE_LINKS)


@event_priority(100)
def on_config(config: Any) -> Any:
    """Add the extension before anybody copies the list."""
    config["markdown_extensions"].append(Shapes())
    return config
