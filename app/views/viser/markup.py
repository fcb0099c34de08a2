"""The panels' HTML, from templates that escape all they are given: names and notes come from files."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from ispom.errors import as_text

from ...presentation.templating import environment


def renderer(package: str | None) -> Callable[..., str]:
    """Returns what renders a template of this package, or a shared one: `render("name.html", key=value)`."""

    @cache
    def templates() -> Any:
        return environment(*([package] if package else []), __package__ or "")

    def render(template: str, **values: Any) -> str:
        return as_text(templates().get_template(template).render(values))  # viser sends text only

    return render
