"""Events, for agents."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from ispom.errors import InputError

from ...engine.run_events.event import RunEvent, event_kinds, with_bookmarks
from ...engine.verdict import Severity
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, page_of
from ..bookmarks.service import Bookmarks

LIMIT = 50


def events(
    agents: AgentSession,
    least_severity: Annotated[
        Literal["ok", "warning", "lost"], "Only events at least as severe: lost > warning > ok (all)."
    ] = "ok",
    method: Annotated[str, "Only those of this method; empty for all."] = "",
    kind: Annotated[str, "Only of this kind, such as 'lost'; empty for all."] = "",
    first: Annotated[int, "First frame, from 0."] = 0,
    last: Annotated[int | None, "Last frame, included; null for the last computed one."] = None,
    start: Annotated[int, "First row of the answer, for paging."] = 0,
    limit: Annotated[int, "Number of rows, at most 200."] = LIMIT,
) -> dict[str, Any]:
    """Lists what happened in the computed frames of the open run, in the order of frames: losses, warnings, jumps,
    restarts, loops, unreadable images, bookmarks. Each row has frame, time_s (clock of the source), method, kind,
    severity, sentence, and `until`: the first frame after the event, null while it holds."""
    if kind and kind not in event_kinds():
        raise InputError(f"{kind[:60]!r} is no kind of event: give one of {', '.join(event_kinds())}")
    if method:
        agents.method(method)
    frames = agents.stretch(first, last)
    order = list(Severity)
    found = [
        _row(event)
        for event in with_bookmarks(agents.run.events.events, agents.state[Bookmarks].marks)
        if event.frame in frames
        and order.index(event.severity) >= order.index(Severity(least_severity))
        and (not method or event.method == method)
        and (not kind or event.kind == kind)
    ]
    return {"omitted": agents.run.events.omitted, **page_of(found, start, limit)}


def _row(event: RunEvent) -> dict[str, Any]:
    return {
        "frame": event.frame,
        "time_s": event.time_ns / 1e9,
        "method": event.method,
        "kind": event.kind,
        "severity": str(event.severity),
        "until": event.until,
        "sentence": event.sentence,
    }


TOOLS = (Tool(events),)
