"""Candidates of loops, joins and relocalisations, for agents."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from ispom.errors import InputError
from ispom.estimators.modern.trials import collecting_trials
from ispom.stop import check_stop

from ...session.controller import Controller
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, brief, page_of
from .candidate import Candidate
from .docket import Docket
from .truth import errors_ate, with_truth

MOST_FRAMES = 500
"""Frames of one answer, which are computed again."""


def loop_candidates(
    agents: AgentSession,
    first: Annotated[int, "First frame of the later images."],
    last: Annotated[int, "Last frame of them."],
    verdict: Annotated[str, "Only accepted, refused or undecided ones; empty for all."] = "",
    start: Annotated[int, "Row to begin with."] = 0,
    limit: Annotated[int, "Number of rows, at most 200."] = 50,
) -> dict[str, Any]:
    """Lists every candidate of a loop closure, a join of segments or a relocalisation in a stretch of the open run,
    which is computed again for it: frames of both images, `rules` with value and threshold, and `decided_by`, the rule
    that decided. `truth.right` says whether its relative pose is right, where that is known."""
    agents.stretch(first, last)
    if last - first >= MOST_FRAMES:
        raise InputError(f"frames {first} to {last} are more than {MOST_FRAMES}: ask for fewer")

    def work(controller: Controller) -> list[Candidate]:
        run = controller.run
        if run is None:
            raise InputError("no run is open: call list_runs, then open_run")
        run.require_source()
        nearest, before = run.checkpoints.nearest(first), run.playback
        playback = before.forked(last + 1, before.methods, before.config, nearest and nearest.snapshot)
        with Docket(playback.sequence, most=1) as docket:
            while playback.position <= last:
                check_stop()
                at = playback.position
                with collecting_trials() as trials:
                    playback.step()
                if at >= first:
                    docket.add(list(trials.values()))
            docket.finish()
            units_m = {name: unit for name, (_, unit) in errors_ate(playback, run.trajectories()).items()}
            return [with_truth(each, playback.sequence, units_m) for each in docket.candidates()]

    found = agents.carry_out(work)
    return page_of([_row(each) for each in found if verdict in ("", each.verdict)], start, limit)


def _row(each: Candidate) -> dict[str, Any]:
    row = msgspec.to_builtins(each)
    rules = [{k: brief(rule[k]) for k in ("key", "value", "relation", "threshold", "passed")} for rule in row["rules"]]
    return row | {"rules": rules, "decision": each.decision}


TOOLS = (Tool(loop_candidates),)
