"""A method found its pose in its map again."""

from __future__ import annotations

from ispom.types import Status

from ...verdict import Severity, pose_detail
from ..event import EventKind, Moment


def detect(moment: Moment) -> str | bool | None:
    found = moment.became(Status.TRACKING) and moment.before.get("status") == Status.LOST
    if not found or moment.step is None or moment.now.get("restarted") or moment.about("map"):
        return False
    detail = pose_detail(moment.step, moment.now)
    return f"Relocalised: {detail}." if detail else "Relocalised."


KIND = EventKind("relocalised", "Relocalised", Severity.OK, "A lost method has a pose again, in the same map.", detect)
