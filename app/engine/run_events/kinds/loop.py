"""A loop was closed."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    closed = [d for d in moment.about("loop") if d.passed]
    return moment.sentence(closed[0]) if closed else False


KIND = EventKind("loop", "Loop closure", Severity.OK, "Earlier keyframes are recognised, and poses corrected.", detect)
