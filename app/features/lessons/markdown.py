"""The text of lessons as HTML; HTML in it is text."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from markdown_it import MarkdownIt


def html(markdown: str, values: Mapping[str, float] | None = None) -> str:
    """With the values in their places; without values, as it stands."""
    return _renderer().render(markdown if values is None else markdown.format(**values))


@cache
def _renderer() -> MarkdownIt:
    return MarkdownIt("js-default")
