"""Something else moves as one rigid body."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    return moment.worst(moment.about("motion"))


KIND = EventKind(
    "motion",
    "Second motion",
    Severity.WARNING,
    "Another rigid motion explains many points, so a moving object may be taken for the scene.",
    detect,
    lasts=True,
    quiet_frames=30,
)
