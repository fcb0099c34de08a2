"""Pieces of HTML. Whatever comes from a file is escaped in here, and only here."""

from __future__ import annotations

import json
from collections.abc import Iterable
from html import escape
from typing import Any

from ispom.estimators import ALL_METHODS


def text(value: Any) -> str:
    """Any value as a page shows it."""
    if value is None or (isinstance(value, float) and value != value):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return escape(f"{value:.4g}" if abs(value) < 10_000 else f"{value:.0f}")
    if isinstance(value, list | tuple):
        return ", ".join(text(item) for item in value) or "none"
    return escape(str(value))


def table(head: Iterable[Any], rows: Iterable[Iterable[Any]], numeric: bool = True) -> str:
    """Cells may hold anything; in numeric tables all columns but the first stand on the right."""
    top = "".join(f'<th scope="col">{_cell(cell)}</th>' for cell in head)
    body = "".join("<tr>" + "".join(_td(cell, n) for n, cell in enumerate(row)) + "</tr>" for row in rows)
    kind = "numbers" if numeric else "words"
    return f'<div class="scroll"><table class="{kind}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _td(value: Any, n: int) -> str:
    if n == 0:
        return f'<th scope="row">{_cell(value)}</th>'
    return f"<td>{_cell(value)}</td>"


def _cell(value: Any) -> str:
    """A method's name with its colour beside it."""
    if isinstance(value, str) and value in ALL_METHODS:
        return f'<i class="dot {value}"></i>{value}'
    return text(value)


def section(identity: str, title: str, *content: str) -> str:
    return f'<section id="{identity}"><h2>{escape(title)}</h2>{"".join(content)}</section>'


def details(title: str, content: str, opened: bool = False) -> str:
    return f"<details{' open' if opened else ''}><summary>{escape(title)}</summary>{content}</details>"


def paragraph(words: str, kind: str = "") -> str:
    return f'<p class="{kind}">{escape(words)}</p>' if words else ""


def inline_json(value: Any) -> str:
    """JSON that cannot end the script element which it stands in."""
    told = json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=True)
    return told.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
