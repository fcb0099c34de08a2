"""A method has had no map for a long time."""

from __future__ import annotations

from ispom.methods import method as registered
from ispom.types import Status

from ...verdict import Severity
from ..event import EventKind, Moment

LONG = 50
"""So many frames without a map are worth a look: two seconds of video."""


def detect(moment: Moment) -> str | bool | None:
    if moment.now.get("status") != Status.INITIALISING or registered(moment.method).asks:
        return False
    if moment.frame - moment.since < LONG:
        return False
    detail = moment.verdict.detail
    return f"No map after {LONG} frames: {detail}." if detail else f"No map after {LONG} frames."


KIND = EventKind(
    "no_map", "No map", Severity.WARNING, f"A method has had no map for {LONG} frames.", detect, lasts=True
)
