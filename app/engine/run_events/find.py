"""Which event is next: all that a person can step through, those of the run and the bookmarks."""

from __future__ import annotations

from collections.abc import Iterable

from ..events import Bookmark
from .event import RunEvent
from .registry import event_kinds


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
