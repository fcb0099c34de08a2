"""A new segment of a trajectory begins."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    if not moment.now.get("restarted") or not moment.tracked:
        return False
    return "New segment: no observation connects it to earlier frames, so its position and scale are a guess."


KIND = EventKind(
    "segment",
    "New segment",
    Severity.WARNING,
    "A method starts again; nothing connects the new part of its trajectory to the one before.",
    detect,
)
