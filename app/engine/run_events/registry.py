"""The kinds of events, found by listing the folder `kinds`: new ones are a new file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from ..events import Bookmark
from ..verdict import Severity
from . import kinds
from .event import EventKind, RunEvent


@cache
def event_kinds() -> Mapping[str, EventKind]:
    """All kinds by name, the most severe first."""
    modules = [import_module(f"{kinds.__name__}.{found.name}") for found in iter_modules(kinds.__path__)]
    found = [kind for module in modules for kind in module.KINDS]
    order = list(Severity)
    found.sort(key=lambda kind: (-order.index(kind.severity), kind.name))
    by_name = {kind.name: kind for kind in found}
    if len(by_name) < len(found):
        raise ValueError(f"two kinds of events have one name: {', '.join(kind.name for kind in found)}")
    return by_name


def with_bookmarks(events: Iterable[RunEvent], bookmarks: Iterable[Bookmark]) -> list[RunEvent]:
    """All in the order of their frames; at one frame the most severe first."""
    places = {name: place for place, name in enumerate(event_kinds())}
    found = [*events, *map(_of_bookmark, bookmarks)]
    return sorted(found, key=lambda event: (event.frame, places[event.kind], event.method))


def _of_bookmark(mark: Bookmark) -> RunEvent:
    text, severity = f"Bookmark: {mark.note}" if mark.note else "Bookmark", event_kinds()["bookmark"].severity
    return RunEvent("bookmark", "", mark.exposure, mark.time_ns, severity, text, mark.exposure + 1)


def nearest(events: Iterable[RunEvent], frame: int, *, forwards: bool, alarming: bool = False) -> list[RunEvent]:
    """Those at the nearest frame with any, after a frame or before it; with `alarming`, warnings and losses only."""
    found = [e for e in events if (e.frame > frame if forwards else e.frame < frame)]
    found = [e for e in found if e.severity.alarming] if alarming else found
    if not found:
        return []
    at = min(e.frame for e in found) if forwards else max(e.frame for e in found)
    return [e for e in found if e.frame == at]
