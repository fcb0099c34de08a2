"""A check on the scale failed."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    return moment.worst(moment.about("scale"))


KIND = EventKind(
    "scale", "Scale", Severity.WARNING, "The scale of a trajectory is doubtful.", detect, lasts=True, quiet_frames=30
)
