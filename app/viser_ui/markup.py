"""The panels' HTML, from templates that escape all they are given: names and notes come from files."""

from __future__ import annotations

from functools import cache
from typing import Any

from jinja2 import Environment

from ispom.errors import as_text

from ..templating import environment


def render(template: str, **values: Any) -> str:
    """One of the templates beside this file. viser sends text only: what is none in names from the disk is escaped."""
    return as_text(_environment().get_template(template).render(values))


@cache
def _environment() -> Environment:
    return environment(__package__ or "")
