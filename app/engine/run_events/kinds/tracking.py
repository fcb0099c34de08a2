"""Events of a method's pose and map."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ispom.methods import method as registered
from ispom.types import Status

from ....presentation.decisions import number
from ....presentation.texts import length
from ...history.quantity import Value
from ...history.step_quantities.motion import WAY
from ...verdict import Severity, points, pose_detail
from ..event import Alarm, EventKind, Moment


def detect_lost(moment: Moment) -> Alarm | bool | None:
    return _of_verdict(moment, moment.verdict.sentence) if moment.now.get("status") == Status.LOST else False


def _of_verdict(moment: Moment, sentence: str) -> Alarm:
    """Returns the alarm of the check that decided the verdict."""
    decisive = moment.verdict.decisive
    return Alarm(sentence, {}, "" if decisive is None else decisive.key)


LOST = EventKind(
    "lost",
    "Lost",
    Severity.LOST,
    "A method has no pose at a frame that it used.",
    detect_lost,
    lasts=True,
    happened="is lost since",
)


LONG = 50
"""Number of frames without a map from which on it is an event: two seconds of video."""


def detect_no_map(moment: Moment) -> Alarm | bool | None:
    if moment.now.get("status") != Status.INITIALISING or registered(moment.method).asks:
        return False
    if moment.frame - moment.since < LONG:
        return False
    detail = moment.verdict.detail
    return _of_verdict(moment, f"No map after {LONG} frames: {detail}." if detail else f"No map after {LONG} frames.")


NO_MAP = EventKind(
    "no_map",
    "No map",
    Severity.WARNING,
    f"A method has had no map for {LONG} frames.",
    detect_no_map,
    lasts=True,
    happened=f"had no map in {LONG} frames, up to",
)


def resumed(moment: Moment) -> bool:
    """Returns whether a method that was initialising a new map continues in its earlier map."""
    making = moment.before.get("status") == Status.INITIALISING and moment.tracked
    return making and not moment.now.get("restarted") and not moment.about("map")


def detect_map(moment: Moment) -> str | bool | None:
    if resumed(moment):
        return False
    if not moment.became(Status.TRACKING) or registered(moment.method).asks:  # these use the maps of other methods
        return False
    if moment.before.get("status") != Status.INITIALISING and not moment.about("map"):
        return False
    if not moment.now.get("landmarks") and not moment.about("map"):  # a method without a map, as one of flow
        return False
    found = points(moment.now)
    return f"Map initialised: {found}." if found else "Map initialised."


MAP = EventKind("map", "Map initialised", Severity.OK, "A method that had no map has one.", detect_map)


def detect_relocalised(moment: Moment) -> str | bool | None:
    found = moment.became(Status.TRACKING) and (moment.before.get("status") == Status.LOST or resumed(moment))
    if not found or moment.step is None or moment.now.get("restarted") or moment.about("map"):
        return False
    detail = pose_detail(moment.step, moment.now)
    return f"Relocalised: {detail}." if detail else "Relocalised."


RELOCALISED = EventKind(
    "relocalised", "Relocalised", Severity.OK, "A lost method has a pose again, in the same map.", detect_relocalised
)


def detect_segment(moment: Moment) -> Alarm | str | bool | None:
    if not moment.now.get("restarted") or not moment.tracked:
        return False
    lost = [d for d in moment.about("scale") if d.failed]
    if lost:
        return Alarm(f"New segment: {moment.sentence(lost[0])}", {}, lost[0].key)
    return "New segment: no observation connects it to earlier frames, so its position and scale are a guess."


SEGMENT = EventKind(
    "segment",
    "New segment",
    Severity.WARNING,
    "A method starts again; nothing connects the new part of its trajectory to the one before.",
    detect_segment,
    happened="began a new segment at",
)


JUMP_RATIO = 5
"""A jump is a step longer than this multiple of the usual step, and of the step before it."""
JUMP_SIGMAS = 3
"""A jump is also longer than this many of its standard deviations, where they are known."""
AT_REST = 0.35
"""The length of the mean step, relative to the mean length of steps, below which a pose trembles about its place: its
usual step is noise, and the first step of a drive is many times as long. From 5 steps on a straight way gives more."""


def detect_jump(moment: Moment) -> str | bool | None:
    moved, usual = moment.now.get("moved"), moment.now.get("moved_usual")
    if not isinstance(moved, int | float) or not isinstance(usual, int | float):
        return None
    if moment.now.get("provisional") or moment.before.get("provisional"):
        return None  # such a pose is not metric yet
    if moved <= max(JUMP_RATIO * usual, JUMP_RATIO * _known(moment.before, "moved"), JUMP_SIGMAS * _sigma(moment)):
        return False
    if math.hypot(*(_known(moment.before, key) for key in WAY)) < AT_REST * usual:
        return None
    metric = registered(moment.method).unit == "metric"
    far, often = (length(moved), length(usual)) if metric else (f"{number(moved)} units", number(usual))
    return f"Jump: moved {far} in one step, {number(moved / usual)} times its usual {often}."


def _sigma(moment: Moment) -> float:
    """Returns the standard deviation of the step, from those of both poses where they are known."""
    return math.hypot(*(_known(values, "sigma_position") for values in (moment.before, moment.now)))


def _known(values: Mapping[str, Value], key: str) -> float:
    """A number, 0 where it is not known."""
    value = values.get(key)
    return float(value) if isinstance(value, int | float) else 0.0


JUMP = EventKind(
    "jump",
    "Jump",
    Severity.WARNING,
    f"A pose that moves on goes more than {JUMP_RATIO} times as far as usual, and than its uncertainty allows.",
    detect_jump,
    happened="jumped at",
)

KINDS = (LOST, NO_MAP, MAP, RELOCALISED, SEGMENT, JUMP)
