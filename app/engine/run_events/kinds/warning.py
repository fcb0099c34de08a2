"""A check warns of something that has no kind of event of its own."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment

OTHER = ("scale", "motion")
"""Topics that have kinds of their own."""


def detect(moment: Moment) -> str | bool | None:
    if moment.step is None:
        return None
    theirs = {id(decision) for decision in moment.about(*OTHER)}
    return moment.worst([d for d in moment.step.decisions if d.kind == "warning" and id(d) not in theirs])


KIND = EventKind(
    "warning", "Warning", Severity.WARNING, "Another check of a method failed.", detect, lasts=True, quiet_frames=30
)
