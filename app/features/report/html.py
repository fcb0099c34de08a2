"""Values to HTML by Jinja2, which escapes whatever is not a template's own text."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from ...presentation.templating import TEMPLATES, environment
from .blocks import Compared, MethodName

PACKAGE = __name__.rpartition(".")[0]
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Policy of a page without scripts: the browser refuses all scripts, other files, and addresses."""


def rendered(template: str, **values: Any) -> str:
    """A template of this package, filled in."""
    return _environment().get_template(template).render(**values)


def own_text(name: str) -> Markup:
    """A style or script of this package, which is not escaped: nothing of a run is in it."""
    return Markup(files(PACKAGE).joinpath(TEMPLATES, name).read_text(encoding="utf-8"))


def shown(value: Any) -> str:
    """Any plain value as a page shows it."""
    if value is None or (isinstance(value, float) and value != value):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 10_000 else f"{value:.0f}"
    if isinstance(value, list | tuple):
        return ", ".join(shown(item) for item in value) or "none"
    return str(value)


def signed(difference: float) -> str:
    """With its sign: −0.0123."""
    return "±0" if difference == 0 else f"{difference:+.3g}".replace("-", "−")


def _environment() -> Environment:
    made = environment(PACKAGE)
    made.filters |= {"shown": shown, "signed": signed}
    made.tests |= {
        "method": lambda value: isinstance(value, MethodName),
        "compared": lambda value: isinstance(value, Compared),
    }
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made
