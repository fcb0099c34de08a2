"""A method has made a map."""

from __future__ import annotations

from ispom.methods import method as registered
from ispom.types import Status

from ...verdict import Severity, points
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    if not moment.became(Status.TRACKING) or registered(moment.method).asks:  # those build on the maps of others
        return False
    if moment.before.get("status") != Status.INITIALISING and not moment.about("map"):
        return False
    found = points(moment.now)
    return f"Map initialised: {found}." if found else "Map initialised."


KIND = EventKind("map", "Map initialised", Severity.OK, "A method that had no map has one.", detect)
