"""Events and their kinds, which are the files of the folder `kinds`. This module uses no viewer and no thread."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from pkgutil import iter_modules
from typing import Literal

from ispom.methods import method as registered
from ispom.types import Check, Decision, Status, Step

from ...presentation.decisions import sentence
from ..events import Bookmark
from ..history.quantity import Value
from ..verdict import Severity, Verdict, alarming, verdict
from . import kinds

Scope = Literal["method", "frame", "person"]


WORSE = 3.0
"""Factor by which the excess of a failed check must exceed that of the event that holds, to be a new event. Smaller
changes are the noise of a value that stays bad."""


@dataclass(frozen=True)
class Alarm:
    """The failed checks that a kind of event finds at a frame."""

    sentence: str
    excess: Mapping[str, float]
    """By key of a failed check, how many times its value is beyond its limit."""
    cause: str = ""
    """Key of the check that the sentence is about; empty where no check says it."""

    def worse_than(self, said: Mapping[str, float]) -> bool:
        """Returns whether a check failed that is not in `said`, or whose excess is more than WORSE times that in
        `said`."""
        return any(value > WORSE * said.get(key, 0.0) for key, value in self.excess.items())


@dataclass(frozen=True)
class RunEvent:
    """Something that a person should look at."""

    kind: str
    method: str
    """Empty for an event without a method: an unreadable image, a bookmark."""
    frame: int
    time_ns: int
    severity: Severity
    sentence: str
    until: int | None = None
    """The first frame at which it no longer held; None while it holds."""
    said: Mapping[str, float] = field(default_factory=dict)
    """Excess of failed checks in this event and those that it continues, see Alarm.excess; not in tables."""
    cause: str = ""
    """Key of the check that made it, see Alarm.cause; not in tables."""

    @property
    def length(self) -> int:
        """The number of frames for which it held; 0 while it holds."""
        return 0 if self.until is None else self.until - self.frame


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame, as the detectors of events see it: a step of one method, or, without a step, the frame alone."""

    frame: int
    time_ns: int
    step: Step | None = None
    now: Mapping[str, Value] = field(default_factory=dict)
    """The method's quantities at this frame, by key."""
    before: Mapping[str, Value] = field(default_factory=dict)
    """Those at its step before; empty at its first one."""
    skipped: str = ""
    """Why no method saw the frame; empty where methods saw it."""
    since: int = 0
    """The first frame of the method's present status."""
    tracked: bool = False
    """Whether the method had a map before."""

    @property
    def method(self) -> str:
        return "" if self.step is None else self.step.method

    @cached_property
    def verdict(self) -> Verdict:
        """ValueError without a step."""
        if self.step is None:
            raise ValueError("a verdict is about a method's step")
        return verdict(self.step, self.frame, self.now)

    @cached_property
    def checks(self) -> Mapping[str, Check]:
        return registered(self.method).checks if self.step is not None else {}

    def became(self, status: Status) -> bool:
        """Whether the method has this status now and had another one before, or none."""
        return self.now.get("status") == status and self.before.get("status") != status

    def about(self, *topics: str) -> list[Decision]:
        """The step's checks about these topics."""
        made = () if self.step is None else self.step.decisions
        return [d for d in made if (check := self.checks.get(d.key)) is not None and check.topic in topics]

    def sentence(self, decision: Decision) -> str:
        return sentence(decision, self.checks.get(decision.key))

    def worst(self, decisions: list[Decision]) -> Alarm | bool | None:
        """Returns the alarm of a kind of warning: its sentence is that of the check with the largest excess. Failed
        requirements come before warnings. False where all checks passed; None without checks."""
        failed = [d for d in decisions if alarming(d)]
        if not failed:
            return False if decisions else None
        worst = max(failed, key=lambda d: (d.failed, _excess(d)))
        return Alarm(self.sentence(worst), {d.key: _excess(d) for d in failed}, worst.key)


def _excess(decision: Decision) -> float:
    """How many times the value of a failed check is beyond its limit, at least 1."""
    value, limit = abs(decision.value), abs(decision.threshold)
    beyond, least = (value, limit) if decision.relation in ("<", "<=") else (limit, value)
    return max(1.0, beyond / least) if least > 0 else math.inf


@dataclass(frozen=True)
class EventKind:
    """A kind of event. To add one, list it in the `KINDS` of a file in `kinds`."""

    name: str
    """Name in tables and addresses; it must not change."""
    label: str
    """One or two words for people: "Lost"."""
    severity: Severity
    help: str
    """One sentence: when it happens."""
    detect: Callable[[Moment], Alarm | str | bool | None] | None = None
    """Called at each frame: returns a sentence while the event holds, False where it does not, and None where the frame
    does not decide it. An event begins at a sentence after False, and where an alarm is worse than the event that
    holds."""
    scope: Scope = "method"
    """Detected at each step of a method, once at each frame, or made by a person."""
    lasts: bool = False
    """Whether the event lasts from a first frame to a last one; otherwise it happens at one frame."""
    quiet_frames: int = 0
    """Most frames after its end within which an event that holds again is still the same event."""
    happened: str = ""
    """Words between the names of the method and the frame: "is lost since", "jumped at". Empty: the label is used."""


@cache
def event_kinds() -> Mapping[str, EventKind]:
    """All kinds by name, the most severe first."""
    modules = [import_module(f"{kinds.__name__}.{found.name}") for found in iter_modules(kinds.__path__)]
    found = [kind for module in modules for kind in module.KINDS]
    order = list(Severity)
    found.sort(key=lambda kind: (-order.index(kind.severity), kind.name))
    by_name = {kind.name: kind for kind in found}
    if len(by_name) < len(found):
        raise ValueError(f"two kinds of events have one name: {', '.join(kind.name for kind in found)}")
    return by_name


def with_bookmarks(events: Iterable[RunEvent], bookmarks: Iterable[Bookmark]) -> list[RunEvent]:
    """Returns all events in the order of their frames; at one frame the most severe comes first."""
    places = {name: place for place, name in enumerate(event_kinds())}
    found = [*events, *map(_of_bookmark, bookmarks)]
    return sorted(found, key=lambda event: (event.frame, places[event.kind], event.method))


def _of_bookmark(mark: Bookmark) -> RunEvent:
    text, severity = f"Bookmark: {mark.note}" if mark.note else "Bookmark", event_kinds()["bookmark"].severity
    return RunEvent("bookmark", "", mark.exposure, mark.time_ns, severity, text, mark.exposure + 1)


def nearest(events: Iterable[RunEvent], frame: int, *, forwards: bool, alarming: bool = False) -> list[RunEvent]:
    """Returns the events at the nearest frame that has any, after or before `frame`. `alarming`: warnings and losses
    only."""
    found = [e for e in events if (e.frame > frame if forwards else e.frame < frame)]
    found = [e for e in found if e.severity.alarming] if alarming else found
    if not found:
        return []
    at = min(e.frame for e in found) if forwards else max(e.frame for e in found)
    return [e for e in found if e.frame == at]
