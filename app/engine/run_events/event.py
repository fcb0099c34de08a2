"""What an event is, and what a kind of event is. No viewer and no thread in here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from ispom.methods import method as registered
from ispom.types import Check, Decision, Status, Step

from ...presentation.decisions import sentence
from ..history.quantity import Value
from ..verdict import Severity, Verdict, alarming, verdict

Scope = Literal["method", "frame", "person"]


@dataclass(frozen=True)
class RunEvent:
    """Something that a person should look at."""

    kind: str
    method: str
    """Empty for what is of no method: an unreadable image, a bookmark."""
    frame: int
    time_ns: int
    severity: Severity
    sentence: str
    until: int | None = None
    """The first frame at which it no longer held; None while it holds."""

    @property
    def length(self) -> int:
        """The number of frames for which it held; 0 while it holds."""
        return 0 if self.until is None else self.until - self.frame


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame as a kind of event looks at it: of one method, or, without a step, of no method."""

    frame: int
    time_ns: int
    step: Step | None = None
    now: Mapping[str, Value] = field(default_factory=dict)
    """The method's quantities at this frame, by key."""
    before: Mapping[str, Value] = field(default_factory=dict)
    """Those at its step before; empty at its first one."""
    skipped: str = ""
    """Why no method saw the frame; empty where they did."""
    since: int = 0
    """The frame from which on the method has its status."""
    tracked: bool = False
    """Whether it had a map before."""

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

    def worst(self, decisions: list[Decision]) -> str | bool | None:
        """What a kind of warning says: the first failed check's sentence, False where all passed, None without any."""
        failed = [d for d in decisions if alarming(d)]
        return self.sentence(failed[0]) if failed else False if decisions else None


@dataclass(frozen=True)
class EventKind:
    """A kind of event. One file in `kinds` that has it as `KIND` is all that it takes."""

    name: str
    """Stable: in tables and addresses."""
    label: str
    """One or two words for people: "Lost"."""
    severity: Severity
    help: str
    """One sentence: when it happens."""
    detect: Callable[[Moment], str | bool | None] | None = None
    """At each frame: a sentence while it holds, False where it does not, None where the frame says nothing about it. An
    event begins where a sentence follows on False."""
    scope: Scope = "method"
    """Asked for each step of a method, once for each frame, or made by a person."""
    lasts: bool = False
    """Whether it goes on for a while, from a first frame to a last one; else it happens at one frame."""
    quiet_frames: int = 0
    """One that holds again so few frames after it ended is still the same event."""
