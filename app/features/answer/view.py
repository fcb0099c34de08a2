"""One line for the frame shown: what went wrong, since when, why with its number, and what to do about it."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from ispom.errors import counted
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.reruns import Tried
from ispom.plausibility.doubt import Doubt

from ...engine.history.record import with_parts
from ...engine.run_events.event import RunEvent, event_kinds
from ...engine.run_events.stretch import Stretch, event_at, worst_event
from ...engine.verdict import Severity, verdict
from ...presentation import colours
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.view_values import View
from ..doctor.service import CANCELLED
from ..doctor.state import Examined
from ..doctor.view import unexplained, untried

TOO_LOW = {"max_tracks": "only {} tracks are allowed"}
"""By setting: what its value causes if a larger one helps."""

Tone = Literal["quiet", "ok", "warning", "lost"]


class AnswerView(msgspec.Struct, frozen=True):
    """The line; `text` is empty where there is nothing to speak of."""

    tone: Tone
    text: str
    working: bool
    """Whether an examination goes on, which can be cancelled."""
    diagnose: int | None
    """The frame around which the cause can be looked for."""
    thorough: bool
    """Whether it was looked for already, and more time would show more."""
    applies: bool
    """Whether the run can be forked with the setting that is the cause."""
    show: int | None
    """The frame at which it began."""


NOTHING = AnswerView("quiet", "", working=False, diagnose=None, thorough=False, applies=False, show=None)


def answer(state: State, run: CurrentRun | None, frame: int) -> AnswerView:
    """Of the worst event that holds at the frame, with what an examination of it found."""
    if run is None:
        return NOTHING
    examined = state[Examined].at(state)
    if examined.progress is not None:
        return _line("quiet", _progress(examined), working=True)
    if state.displayed is None:
        return NOTHING
    happened = event_shown(run.events.events, frame, examined)
    if happened is None:
        return _without_event(state, run, frame, examined)
    tone: Tone = "lost" if happened.severity == Severity.LOST else "warning"
    show = happened.frame if happened.frame != frame else None
    about = examined.stretch is not None and _is_about(examined.stretch, happened)
    if about and examined.diagnosis is not None:
        return _explained(tone, f"{_what(happened)}: ", examined.diagnosis, happened.frame, show)
    text = f"{_what(happened)}: {_detail(happened)}" if _detail(happened) else f"{_what(happened)}."
    if about and examined.problem not in ("", CANCELLED):
        text += f" No diagnosis: {examined.problem}."
    return _line(tone, text, diagnose=happened.frame, show=show)


def _line(tone: Tone, text: str, **fields: Any) -> AnswerView:
    return msgspec.structs.replace(NOTHING, tone=tone, text=text, **fields)


def _explained(tone: Tone, before: str, found: Diagnosis, at: int, show: int | None) -> AnswerView:
    why, applies = cause(found)
    again = untried(found)
    return _line(tone, before + why, diagnose=at if again else None, thorough=again, applies=applies, show=show)


def event_shown(events: tuple[RunEvent, ...], frame: int, examined: Examined) -> RunEvent | None:
    """The worst warning or loss that holds at a frame; of those as severe, the one that was examined."""
    found = event_at(events, frame)
    worst = worst_event(found)
    stretch = examined.stretch
    known = [e for e in found if stretch is not None and worst is not None and e.severity == worst.severity]
    return next((e for e in known if stretch is not None and _is_about(stretch, e)), worst)


def cause(found: Diagnosis) -> tuple[str, bool]:
    """What a diagnosis says in words, and whether a setting that can be applied is the cause."""
    if not found.causes:
        return _lower(unexplained(found)), False
    helped = None if found.helped is None else found.helped.best
    first = found.causes[0]
    if helped is not None and helped.trial.key == first.suspect.key:
        return _of_setting(helped), True
    return f"{_lower(found.answer)} What to do: {first.suspect.remedy}", False


def _of_setting(best: Tried) -> str:
    trial, reruns = best.trial, len(best.outcomes)
    is_too_low = trial.name in TOO_LOW and trial.value > trial.before
    why = TOO_LOW[trial.name].format(trial.before) if is_too_low else f"{trial.key} is {_value(trial.before)}"
    sure = f", in the worst of {reruns} reruns" if reruns > 1 else ", in one rerun"
    return f"{why}. With {_value(trial.value)}: {best.gain}{sure}."


def _value(value: object) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)


def _is_about(stretch: Stretch, event: RunEvent) -> bool:
    """Whether a stretch was examined for an event, or at the frame where that began."""
    known = stretch.event
    return stretch.at == event.frame or (
        known is not None and (known.kind, known.method, known.frame) == (event.kind, event.method, event.frame)
    )


def _what(event: RunEvent) -> str:
    """What happened, and when: "Monocular is lost since frame 21"."""
    kind, label = event_kinds()[event.kind], colours.label(event.method) if event.method else ""
    if label and kind.happened:
        return f"{label} {kind.happened} frame {event.frame}"
    since = f"since frame {event.frame}" if kind.lasts else f"frame {event.frame}"
    return f"{label}, {since}" if label else f"{since[0].upper()}{since[1:]}"


def _detail(event: RunEvent) -> str:
    """Its sentence, without the headline where `_what` says that already."""
    if not event.method or not event_kinds()[event.kind].happened:
        return event.sentence
    return event.sentence.partition(": ")[2]


def _without_event(state: State, run: CurrentRun, frame: int, examined: Examined) -> AnswerView:
    """Of a frame at which nothing went wrong, or only a check failed of which there is no event."""
    steps = () if state.displayed is None else with_parts(state.displayed.steps)
    found = [verdict(step, frame, {}) for step in steps]
    worst = next((v for severity in ("lost", "warning") for v in found if v.severity == severity), None)
    tone: Tone = "ok" if worst is None else "lost" if worst.severity == Severity.LOST else "warning"
    stretch, known = examined.stretch, examined.diagnosis
    if known is not None and stretch is not None and not stretch.event and stretch.first <= frame <= stretch.last:
        return _explained(tone, f"Frames {stretch.first} to {stretch.last}: ", known, stretch.at, None)
    if worst is not None:
        return _line(tone, f"{colours.label(worst.method)}, frame {frame}: {worst.sentence}", diagnose=frame)
    problems = [event.frame for event in run.events.events if event.severity.alarming]
    doubts = [note for note in state.notes if isinstance(note, Doubt)]
    if not problems and doubts:
        return _line("warning", f"Doubtful source: {doubts[0]}")
    if not problems:
        return _line(tone, "No problem found.")
    nearest = min(problems, key=lambda at: abs(at - frame))
    text = f"No problem found at this frame. The run has {counted(len(problems), 'problem')}"
    return _line(tone, f"{text}{', the nearest' if len(problems) > 1 else ''} at frame {nearest}.", show=nearest)


def _progress(examined: Examined) -> str:
    """What would be answered so far, or else what is tested now; how long that has taken, and how long it has left."""
    progress, stretch = examined.progress, examined.stretch
    if progress is None or stretch is None:
        return ""
    text = (
        f"Diagnosing frames {stretch.first} to {stretch.last}: {progress.doing} ({progress.done} of {progress.total})."
    )
    if progress.known is not None and progress.known.causes:
        text = f"So far: {cause(progress.known)[0]} Still testing."
    if not examined.taken_s:  # the compiler may still work, and its time does not count
        return text
    left = examined.limit_s - examined.taken_s
    return f"{text} {examined.taken_s} s, {f'at most {left} s left' if left > 0 else 'about to end'}."


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


VIEWS = (View("answer", "#answer", 90, answer),)
