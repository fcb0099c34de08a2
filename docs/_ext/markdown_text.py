"""Markdown from the words of the code."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def as_cell(text: str) -> str:
    """Returns a text on one line that a table's cell can hold: names in backticks stay, nothing else is markup."""
    parts = re.split(r"(`[^`]+`)", " ".join(text.split()))
    for i, part in enumerate(parts):
        parts[i] = part.replace("|", "\\|") if i % 2 else re.sub(r"([*_|<\[\]{}$\\])", r"\\\1", part)
    return "".join(parts)


def as_prose(text: str) -> str:
    """Returns a docstring as Markdown: its paragraphs, with indented blocks as they stand."""
    blocks = re.split(r"\n\s*\n", text.strip())
    for i, block in enumerate(blocks):
        if block.startswith("    "):
            blocks[i] = "```text\n" + re.sub(r"^    ", "", block, flags=re.MULTILINE) + "\n```"
        else:
            lines = (as_cell(line) for line in block.split("\n"))
            blocks[i] = "\n".join(re.sub(r"^(#|>|\+ )", r"\\\1", line) for line in lines)
    return "\n\n".join(blocks)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a Markdown table of cells that are Markdown already."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell or " " for cell in line) + " |" for line in lines)
