"""From events and a diagnosis to a group, a cause in one line, and what to do about it: in the words of those who found
it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.finding import Suspect

from ...engine.run_events.event import RunEvent
from ...engine.run_events.stretch import worst_event
from ...engine.verdict import Severity
from ...presentation import colours
from ..experiments.plan import LEAST_LOCATED_PERCENT
from ..headless.suspicions import CALIBRATION
from .row import Action, Group, Row

NO_MAP = "no_map"
"""Name of the kind of event."""
SETTINGS = ("setting", "rerun")
"""Where the evidence of suspects is from that are settings of the run."""
OF_RECORDING = frozenset({"unlevel-pair"})
"""Keys of suspects that a better calibration mends, though their evidence is from the images."""
STRETCHES = 3
"""Lost stretches that are named."""


def of_located(shares: Mapping[str, float | None]) -> dict[str, object]:
    """Returns the cause where a method located few of its frames though no event says so, as in a clip that ends before
    there is a map; empty where none did. `shares`: by method [%]."""
    few = {name: share for name, share in shares.items() if share is not None and share < LEAST_LOCATED_PERCENT}
    if not few:
        return {}
    name = min(few, key=lambda each: few[each])
    return {"cause": f"{colours.label(name)} located {few[name]:g} % of its frames only", "action": Action.LOOK}


def group_of(events: Sequence[RunEvent], moved: bool, doubted: bool) -> Group:
    """Returns where a clip belongs that could be run. `moved`: whether any method found a motion; `doubted`: whether
    anything is known against it though nothing went wrong."""
    if not moved:
        return Group.NO_MAP
    if any(event.severity == Severity.LOST for event in events):
        return Group.LOST
    alarming = [event for event in events if event.severity.alarming]
    if any(event.kind == NO_MAP for event in alarming):
        return Group.NO_MAP
    return Group.SUSPICIOUS if alarming or doubted else Group.FINE


def of_events(events: Sequence[RunEvent], frames: int) -> dict[str, object]:
    """Returns cause, frame and stretches by the events alone; empty where nothing went wrong. `frames`: of the run."""
    worst = worst_event(events)
    if worst is None:
        return {}
    who = f"{colours.label(worst.method)}: " if worst.method else ""
    return {
        "cause": f"{who}{worst.sentence}",
        "frame": worst.frame,
        "action": Action.LOOK,
        "where": _where([e for e in events if e.kind == worst.kind and e.method == worst.method], frames),
    }


def of_diagnosis(found: Diagnosis) -> dict[str, object]:
    """Returns what the doctor adds to that, or puts in its place."""
    values: dict[str, object] = {}
    helped = found.helped.best if found.helped is not None else None
    if helped is not None:
        values |= {"setting": helped.trial.option, "gain": helped.gain}
    if not found.causes:
        return values | {"advice": found.answer}
    first = found.causes[0]
    suspect, finding = first.suspect, first.finding
    values |= {
        "cause": found.answer.removeprefix("The likely cause: "),
        "suspect": suspect.key,
        "suspect_name": suspect.name,
        "action": action_of(suspect),
        "advice": suspect.remedy,
    }
    return values | ({"frame": finding.frames[0]} if finding.frames else {})


def action_of(suspect: Suspect) -> Action:
    """Returns what a person does about a cause."""
    if suspect.how in SETTINGS:
        return Action.SETTING
    if suspect.how == CALIBRATION or suspect.key in OF_RECORDING:
        return Action.CORRECT
    return Action.FILM


def _where(events: Sequence[RunEvent], frames: int) -> str:
    """The first stretches in words: "frames 21 to 40, 52"."""
    lasts = [(e.frame, (frames if e.until is None else e.until) - 1) for e in events]
    words = [f"{first} to {last}" if last > first else f"{first}" for first, last in lasts[:STRETCHES]]
    more = f" and {len(lasts) - STRETCHES} more" if len(lasts) > STRETCHES else ""
    return f"frame{'s' if len(lasts) > 1 or lasts[0][1] > lasts[0][0] else ''} {', '.join(words)}{more}"


class Lesson(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to do differently when filming, and how many clips it would have helped."""

    suspect: str
    cause: str
    advice: str
    clips: tuple[str, ...]


def how_to_film(rows: Sequence[Row]) -> list[Lesson]:
    """Returns each cause of clips that are to be filmed again once, those of most clips first."""
    by_key: dict[str, list[Row]] = {}
    for row in rows:
        if row.action == Action.FILM:
            by_key.setdefault(row.suspect, []).append(row)
    lessons = [
        Lesson(key, own[0].suspect_name, own[0].advice, tuple(row.clip for row in own)) for key, own in by_key.items()
    ]
    return sorted(lessons, key=lambda lesson: (-len(lesson.clips), lesson.suspect))
