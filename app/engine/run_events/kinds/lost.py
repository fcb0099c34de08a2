"""A method has no pose."""

from __future__ import annotations

from ispom.types import Status

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    return moment.verdict.sentence if moment.now.get("status") == Status.LOST else False


KIND = EventKind("lost", "Lost", Severity.LOST, "A method has no pose at a frame that it used.", detect, lasts=True)
