"""Events of a method's checks."""

from __future__ import annotations

from ...verdict import Severity
from ..event import Alarm, EventKind, Moment


def detect_scale(moment: Moment) -> Alarm | bool | None:
    return moment.worst(moment.about("scale"))


SCALE = EventKind(
    "scale",
    "Scale",
    Severity.WARNING,
    "The scale of a trajectory is doubtful.",
    detect_scale,
    lasts=True,
    quiet_frames=30,
    happened="is unsure of its scale since",
)


def detect_motion(moment: Moment) -> Alarm | bool | None:
    return moment.worst(moment.about("motion"))


MOTION = EventKind(
    "motion",
    "Second motion",
    Severity.WARNING,
    "Another rigid motion explains many points, so a moving object may be taken for the scene.",
    detect_motion,
    lasts=True,
    quiet_frames=30,
    happened="sees a second motion since",
)


OTHER = ("scale", "motion")
"""Topics that have kinds of their own."""


def detect_warning(moment: Moment) -> Alarm | bool | None:
    if moment.step is None:
        return None
    theirs = {id(decision) for decision in moment.about(*OTHER)}
    return moment.worst([d for d in moment.step.decisions if d.kind == "warning" and id(d) not in theirs])


WARNING = EventKind(
    "warning",
    "Warning",
    Severity.WARNING,
    "Another check of a method failed.",
    detect_warning,
    lasts=True,
    quiet_frames=30,
)


def detect_loop(moment: Moment) -> str | bool | None:
    closed = [d for d in moment.about("loop") if d.passed]
    return moment.sentence(closed[0]) if closed else False


LOOP = EventKind(
    "loop", "Loop closure", Severity.OK, "Earlier keyframes are recognised, and poses corrected.", detect_loop
)


def detect_pair(moment: Moment) -> Alarm | bool | None:
    corrected = [d for d in moment.about("pair") if d.passed]
    return Alarm(moment.sentence(corrected[0]), {}, corrected[0].key) if corrected else False


PAIR = EventKind(
    "pair",
    "Pair levelled",
    Severity.WARNING,
    "The two images of the pairs are not level: the calibration is wrong, and is corrected from here on.",
    detect_pair,
)

KINDS = (SCALE, MOTION, WARNING, LOOP, PAIR)
