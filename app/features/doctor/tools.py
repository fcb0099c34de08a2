"""The doctor, for agents."""

from __future__ import annotations

from typing import Annotated, Any

from ispom.errors import InputError

from ...engine.run_events.stretch import stretch_of
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, answer_of
from .job import examine
from .options import FRAMES, SECONDS
from .origin import Origin
from .written import written

MOST_SECONDS = 600.0
"""An agent waits no longer for one answer."""


def doctor(
    agents: AgentSession,
    at: Annotated[int | None, "Frame that went wrong; null for the worst event."] = None,
    seconds: Annotated[float, f"After this time no new suspect is examined; at most {MOST_SECONDS:g}."] = SECONDS,
    settings: Annotated[
        bool,
        "Whether it is also rerun: settings that differ from their defaults first, other ones last, one at a time.",
    ] = True,
) -> dict[str, Any]:
    """Says which cause explains a bad stretch of the run, by its settings, images, times, tracks and other sensors.
    Ground truth is used only to judge a setting that is set back to its default.
    `answer` is a sentence, `causes` are keys of what was found, the strongest first, and `ranked` has for each suspect
    the evidence, its strength (from 1 on it is found), frames to look at, and what to do. `set_back` and `reruns` have
    for each setting that was tried the frames located, the checks that failed, and the error where it is known. It
    takes about a minute."""
    run = agents.run
    if run.live:
        raise InputError("a live source is still recording: wait for its end")
    run.require_source()
    if at is not None:
        agents.frame(at)
    if not 0 < seconds <= MOST_SECONDS:
        raise InputError(f"seconds is {seconds:g}: give more than 0 and at most {MOST_SECONDS:g}")
    sequence = run.playback.sequence
    stretch = stretch_of(sequence, at, FRAMES, run.events.events)
    origin = agents.carry_out(lambda controller: Origin.of_run(run, stretch)) if settings else None
    return answer_of(written(examine(sequence, stretch, seconds, origin=origin), stretch))


TOOLS = (Tool(doctor),)
