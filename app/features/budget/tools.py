"""The error budget, for agents."""

from __future__ import annotations

from typing import Annotated, Any

from ispom.errors import InputError
from ispom.methods import with_dependencies
from ispom.stop import check_stop

from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, answer_of
from .bench import Bench
from .command import require_budget
from .options import MOST_REPEATS, REPEATS
from .split import budgets
from .written import written


def budget(
    agents: AgentSession,
    method: Annotated[str, "Only this method; empty for all."] = "",
    repeats: Annotated[int, f"Repetitions with other noise, 1 to {MOST_REPEATS}."] = REPEATS,
) -> dict[str, Any]:
    """Splits the absolute trajectory error of the run by its causes: calibration, clock, noise, outliers, scale and
    initial map. Each is removed in reruns, for which ground truth says what was wrong. `methods` has a share of the
    squared error for each cause, with the interval that holds with the probability `level`, or why it cannot be told;
    shares and `rest` make `ate_m` squared. It takes as long as two dozen runs."""
    run = agents.run
    if run.live:
        raise InputError("a live source is still recording: wait for its end")
    run.require_source()
    if method:
        agents.method(method)
    if not 1 <= repeats <= MOST_REPEATS:
        raise InputError(f"repeats is {repeats}: give 1 to {MOST_REPEATS}")
    playback = run.playback
    require_budget(playback.sequence, bool(playback.earlier))
    methods = with_dependencies(playback.methods)
    bench = Bench(playback.sequence, methods, playback.config, playback.builder, check_stop)
    found = budgets(bench, repeats, (method,) if method else playback.methods)
    return answer_of(written(found))


TOOLS = (Tool(budget),)
