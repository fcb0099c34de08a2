"""A frame could not be read, so that no method saw it."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    return f"Frame skipped: {moment.skipped.removesuffix('.')}." if moment.skipped else False


KIND = EventKind("unreadable", "Frame skipped", Severity.WARNING, "An image could not be read.", detect, scope="frame")
