"""A pose moves much farther from one step to the next than it usually does."""

from __future__ import annotations

from ispom.methods import method as registered

from ....presentation.decisions import number
from ....presentation.texts import length
from ...verdict import Severity
from ..event import EventKind, Moment

JUMP = 5
"""A step so many times as long as the usual one is a jump."""


def detect(moment: Moment) -> str | bool | None:
    moved, usual = moment.now.get("moved"), moment.now.get("moved_usual")
    if not isinstance(moved, int | float) or not isinstance(usual, int | float):
        return None
    if moved <= JUMP * usual:
        return False
    metric = registered(moment.method).unit == "metric"
    far, often = (length(moved), length(usual)) if metric else (f"{number(moved)} units", number(usual))
    return f"Jump: moved {far} in one step, {number(moved / usual)} times its usual {often}."


KIND = EventKind("jump", "Jump", Severity.WARNING, f"A pose moves more than {JUMP} times as far as usual.", detect)
