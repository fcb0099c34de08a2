"""What the images do not decide, for agents."""

from __future__ import annotations

from typing import Annotated, Any

from ispom.errors import InputError
from ispom.evaluation.undecided.stretches import of_recording

from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, answer_of
from .command import calibrated
from .options import SECONDS
from .written import written

MOST_STRETCHES = 40
"""Of one answer: each takes some seconds."""


def undecided(
    agents: AgentSession,
    seconds: Annotated[float, "Length of a stretch, and the time to the next one, 0.2 to 60."] = SECONDS,
    start: Annotated[int, "Place of the first stretch of the answer."] = 0,
) -> dict[str, Any]:
    """Says what the images do not decide, for stretches of the open run's recording: the weakest combination of scale,
    focal length, principal point, distortion, clock and mounts, its standard deviation in pixels and in the numbers'
    own units, how the camera moved, and what motion would decide it. `next_start` is where the next call goes on."""
    run = agents.run
    if run.live:
        raise InputError("a live source is still recording: wait for its end")
    run.require_source()
    if not 0.2 <= seconds <= 60:
        raise InputError(f"seconds is {seconds:g}: give 0.2 to 60")
    if start < 0:
        raise InputError(f"start is {start}: give 0 or more")
    sequence = calibrated(run.playback.sequence, run.playback.sequence.name)
    found = list(of_recording(sequence, seconds, seconds, skip=start, most=MOST_STRETCHES))
    if not found:
        raise InputError(f"there is no stretch {start}: give a smaller start, or shorter seconds")
    more = start + MOST_STRETCHES if len(found) == MOST_STRETCHES else None
    return answer_of(written(sequence.name, found)) | {"next_start": more}


TOOLS = (Tool(undecided),)
