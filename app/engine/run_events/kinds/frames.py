"""What concerns a frame alone."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect_unreadable(moment: Moment) -> str | bool | None:
    return f"Frame skipped: {moment.skipped.removesuffix('.')}." if moment.skipped else False


UNREADABLE = EventKind(
    "unreadable", "Frame skipped", Severity.WARNING, "An image could not be read.", detect_unreadable, scope="frame"
)


BOOKMARK = EventKind("bookmark", "Bookmark", Severity.OK, "A frame that a person marked.", scope="person")

KINDS = (UNREADABLE, BOOKMARK)
