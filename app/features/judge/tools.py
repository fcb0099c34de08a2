"""The judge of poses, for agents."""

from __future__ import annotations

import time
from typing import Annotated, Any

from ispom.errors import InputError
from ispom.io.files import confined
from ispom.stop import check_stop

from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, answer_of
from .options import FrameOfPoses
from .question import Question, require_images
from .written import written

SECONDS, MOST_SECONDS = 120.0, 600.0
"""An agent waits no longer for one answer."""


def judge(
    agents: AgentSession,
    poses: Annotated[str, "File of poses of any program, in the folder of runs (as a/stereo.tum), or its whole path."],
    frame: Annotated[FrameOfPoses, "Whose poses it has: those of the main camera, or of the rig."] = "auto",
    times: Annotated[str, "File with the times of its rows, where it has none; empty: row N is frame N."] = "",
    seconds: Annotated[float, f"After this time no image is read; at most {MOST_SECONDS:g}."] = SECONDS,
) -> dict[str, Any]:
    """Says whether the images of the open run's recording contradict poses: `verdict` is agrees, contradicted or cannot
    tell. `all_poses` has what all poses may have wrong (clock, mount, lever, axes, inverse, drifts; `found`), and
    `smoothing` the shake that they lack. `places` has jumps, steps of the scale and rest, with frames of the main
    camera. `stretches` has how far tracks are from epipolar lines. Neither ground truth nor a method takes part."""
    run = agents.run
    if run.live:
        raise InputError("a live source is still recording: wait for its end")
    run.require_source()
    if not 0 < seconds <= MOST_SECONDS:
        raise InputError(f"seconds is {seconds:g}: give more than 0 and at most {MOST_SECONDS:g}")
    sequence, end_s = run.playback.sequence, time.monotonic() + seconds
    require_images(sequence, sequence.name)
    with confined(agents.places):
        question = Question.of_files(agents.file(poses), frame, agents.file(times) if times else None)

    def advance() -> None:
        check_stop()
        if time.monotonic() > end_s:
            raise InputError(f"the images were not all read in {seconds:g} s: give more seconds, or `ispom judge`")

    return answer_of(written(question.answer(sequence, sequence.name, advance)))


TOOLS = (Tool(judge),)
