"""What moved a pose, for agents."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from ...session.controller import Controller
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, brief
from .found import PoseBlame
from .service import BlameService
from .words import answer

MOST_IDS = 50
"""Ids of tracks that a row lists."""


def blame(
    agents: AgentSession,
    frame: Annotated[int, "Frame, from 0."],
    method: Annotated[str, "Only this method; empty for all."] = "",
) -> dict[str, Any]:
    """Says what moved the pose of a frame, and how far: tracks, groups of tracks, keyframes, priors and sensors, each
    by how the pose would change without it. `answer` has sentences; `moved_m` is null where the unit is not known."""
    agents.frame(frame)
    if method:
        agents.method(method)

    def work(controller: Controller) -> tuple[PoseBlame, ...]:
        return controller.service(BlameService).at(frame)

    found = [each for each in agents.carry_out(work) if method in ("", each.method)]
    return {"frame": frame, "methods": [_row(each) for each in found]}


def _row(of: PoseBlame) -> dict[str, Any]:
    parts = [
        {
            "kind": each.part.kind,
            "name": of.called(each),
            "tracks": list(each.part.tracks[:MOST_IDS]),
            "moved_m": None if of.unit_m is None else brief(each.shift.size * of.unit_m),
            "turned_deg": brief(float(np.degrees(np.linalg.norm(each.shift.rotation)))),
        }
        for each in of.listed()
    ]
    return {"method": of.method, "answer": answer(of), "parts": parts}


TOOLS = (Tool(blame),)
