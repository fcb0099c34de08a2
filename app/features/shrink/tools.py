"""The smallest clip with a failure, for agents."""

from __future__ import annotations

import shlex
import time
from typing import Annotated, Any

from ispom.errors import InputError

from ...engine.run_events.event import RunEvent, event_kinds
from ...engine.run_events.stretch import events_in
from ...session.review.stored import Stored
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool
from .options import NEAR
from .search import Clip, Spent
from .subject import Found, Order, Subject, chosen, require_own_frames, require_replayable, search
from .trial import Outcome

MOST_TRIALS, MOST_SECONDS = 200, 600.0
"""An agent waits no longer for one answer."""


def shrink(
    agents: AgentSession,
    frame: Annotated[int | None, "Frame at which the event begins, as in `events`; null for any."] = None,
    kind: Annotated[str, "Kind of the event, such as 'lost'; empty for the first warning or loss."] = "",
    method: Annotated[str, "Only events of this method; empty for all."] = "",
    trials: Annotated[int, f"Most clips that are run; at most {MOST_TRIALS}."] = 60,
    seconds: Annotated[float, f"After this time no clip is run any more; at most {MOST_SECONDS:g}."] = 120.0,
) -> dict[str, Any]:
    """Finds the smallest clip of the open run in which one of its events remains: same kind, method and failed check,
    at nearly the same frame. `frames` are numbers of the recording, `complete` says whether the event is gone without
    any single frame, method or camera, and `tried` has each clip that was run: the event `remains`, is `gone`, or
    happens `anywhere`, as a clip of this shape has it where the recording has none. Nothing is written: `command`
    writes the clip as a folder, and is null where the run is not stored."""
    run = agents.run
    require_replayable(run.playback.sequence)
    require_own_frames(run.playback.earlier)
    run.require_source()
    if kind and kind not in event_kinds():
        raise InputError(f"{kind[:60]!r} is no kind of event: give one of {', '.join(event_kinds())}")
    if not 1 <= trials <= MOST_TRIALS:
        raise InputError(f"trials is {trials}: give 1 to {MOST_TRIALS}")
    if not 0 < seconds <= MOST_SECONDS:
        raise InputError(f"seconds is {seconds:g}: give more than 0 and at most {MOST_SECONDS:g}")
    own = (each for each in run.events.events if method in ("", each.method) and frame in (None, each.frame))
    event = chosen(own, None, kind or None)
    if event is None:
        raise InputError("the computed frames have no such event: call events, or compute")

    def wanted(number: int, other: RunEvent) -> bool:
        return _identity(other) == _identity(event)

    subject = Subject(run.playback.sequence, run.playback.methods, run.playback.config, wanted)
    tried, end_s = list[dict[str, Any]](), time.monotonic() + seconds

    def advance() -> None:
        if time.monotonic() > end_s:
            raise Spent

    def seen(clip: Clip, outcome: Outcome) -> None:
        tried.append({"clip": clip.words(), "outcome": str(outcome)})

    try:
        found = search(subject, Order(NEAR, trials), run.playback.builder, advance, seen)
    except Spent:
        raise InputError(f"the run was not repeated up to its event in {seconds:g} s: give more seconds") from None
    if found is None:
        raise InputError("the event does not happen when the run is repeated, so no clip of it can be relied on")
    return {**_plain(found), "tried": tried, "command": _command(run.stored, event)}


def _identity(event: RunEvent) -> tuple[str, str, int]:
    return event.kind, event.method, event.time_ns


def _plain(found: Found) -> dict[str, Any]:
    clip, event = found.shrunk.clip, found.event
    return {
        "event": {"kind": event.kind, "method": event.method, "cause": event.cause, "frame": event.frame},
        "sentence": event.sentence,
        "frames": list(clip.frames),
        "of_frames": found.whole.count,
        "methods": list(clip.methods),
        "cameras": list(clip.cameras),
        "halvings": clip.halvings,
        "complete": found.shrunk.complete,
    }


def _command(stored: Stored | None, event: RunEvent) -> str | None:
    """The command that writes the clip; None where no folder of a run has the event."""
    rows = [] if stored is None or not stored.path.is_dir() else events_in(stored.path)
    number = next((i for i, row in enumerate(rows) if _identity(row) == _identity(event)), None)
    if stored is None or number is None:
        return None
    return f"ispom shrink {shlex.quote(str(stored.path))} --event {number}"


TOOLS = (Tool(shrink),)
