"""The kinds of events, found by listing the folder `kinds`: a new kind is a new file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from ..verdict import Severity
from . import kinds
from .event import EventKind


@cache
def event_kinds() -> Mapping[str, EventKind]:
    """All kinds by name, the most severe first."""
    modules = [import_module(f"{kinds.__name__}.{found.name}") for found in iter_modules(kinds.__path__)]
    found = [module.KIND for module in modules]
    order = list(Severity)
    found.sort(key=lambda kind: (-order.index(kind.severity), kind.name))
    by_name = {kind.name: kind for kind in found}
    if len(by_name) < len(found):
        raise ValueError(f"two kinds of events have one name: {', '.join(kind.name for kind in found)}")
    return by_name
