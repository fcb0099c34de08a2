"""How HTML is made everywhere here: by Jinja2, which escapes whatever is not a template's own text."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

TEMPLATES = "templates"
"""Folder of a package's templates."""


def environment(package: str) -> Environment:
    """For the templates of this package; each is read once."""
    return Environment(
        loader=PackageLoader(package, TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
