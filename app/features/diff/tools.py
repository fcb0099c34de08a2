"""The first difference of two runs, for agents."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

from ispom.errors import InputError

from ...engine.differences.compare import Divergence
from ...session.branches.comparison import MOST, advanced, begin
from ...session.branches.state import Branches
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, brief
from .command import compared
from .text import lines

SLICE_S = 60.0
"""For the comparison of two branches."""
MOST_SETTINGS = 50


def diff(
    agents: AgentSession,
    run_a: Annotated[str, "Key of a run from list_runs, or `branch:NUMBER` of the open run (see summary)."],
    run_b: Annotated[str, "The same for the other run; both are runs, or both are branches."],
    tolerance: Annotated[float, "Runs: ignore numbers that differ by less, relative above 1, absolute below."] = 0.0,
    count: Annotated[int, "Number of frames that are described, at most 10."] = 3,
) -> dict[str, Any]:
    """Finds the first frame at which two runs, or two branches of the open run, differ, and in what: tracks, checks,
    poses, landmarks, in the order in which one follows from the other. `first` has that frame, and the next ones at
    which something else differs for the first time; `settings` has what was set differently. Measured times are not
    compared."""
    if not 1 <= count <= MOST:
        raise InputError(f"count is {count}: give 1 to {MOST}")
    if not 0 <= tolerance < math.inf:
        raise InputError(f"tolerance is {tolerance}: give 0 or a positive number")
    numbers = [_branch(each) for each in (run_a, run_b)]
    if None not in numbers:
        return _of_branches(agents, *numbers, count)  # type: ignore[arg-type]
    if numbers != [None, None]:
        raise InputError("a run and a branch cannot be compared: give two runs, or two branches")
    found = compared(agents.folder(run_a), agents.folder(run_b), tolerance, count)
    settings = [{"name": s.name, "a": brief(s.a), "b": brief(s.b)} for s in found.settings[:MOST_SETTINGS]]
    return {
        "alike": not found.first,
        "methods": list(found.methods),
        "settings": settings,
        "differing_frames": found.differing_frames,
        "first": [_divergence(each) for each in found.first[: count + len(found.methods)]],
    }


def _branch(text: str) -> int | None:
    kind, _, number = text.partition(":")
    return int(number) if kind == "branch" and number.isdecimal() else None


def _of_branches(agents: AgentSession, a: int, b: int, count: int) -> dict[str, Any]:
    runs = agents.branch(a), agents.branch(b)
    branches = agents.state[Branches].all
    found = advanced(begin(branches, a, b, *runs), *runs, slice_s=SLICE_S)
    return {
        "alike": not found.first,
        "methods": list(found.methods),
        "settings": [
            {"branch": each.number, "changes": list(each.changes)} for each in branches if each.number in (a, b)
        ],
        "compared_frames": [found.start, found.done - 1],
        "finished": found.finished,
        "differing_frames": found.differing_frames,
        "first": [_divergence(each) for each in found.first[:count]],
    }


def _divergence(divergence: Divergence) -> dict[str, Any]:
    """In the words of `ispom diff`, and the first quantities by key."""
    shown = replace(divergence, differences=divergence.differences[:8])
    return {
        "frame": divergence.exposure,
        "time_s": divergence.time_ns / 1e9,
        "keys": [difference.name for difference in shown.differences],
        "more": len(divergence.differences) - len(shown.differences),
        "lines": list(lines(shown)),
    }


TOOLS = (Tool(diff),)
