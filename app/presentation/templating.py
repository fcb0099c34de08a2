"""How HTML is made everywhere here: by Jinja2, which escapes whatever is not a template's own text."""

from __future__ import annotations

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

TEMPLATES = "templates"
"""Folder of a package's templates."""


def environment(*packages: str) -> Environment:
    """For the templates of these packages; each is read once. The first package that has a name provides it."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(package, TEMPLATES) for package in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
