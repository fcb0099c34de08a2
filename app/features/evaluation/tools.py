"""The comparison of trajectories and its audit, for agents."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from ispom.errors import InputError
from ispom.evaluation.audit.correction import Convention
from ispom.evaluation.trajectory_error import Alignment
from ispom.io.files import confined

from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, answer_of
from .command import MOST_PAIRED, evaluation
from .options import Evaluate
from .written import written

MOST_ESTIMATES = MOST_PAIRED - 1
"""Most estimates of one answer: as many as can be compared with each other."""


def evaluate(
    agents: AgentSession,
    reference: Annotated[str, "File of poses in the folder of runs (as a/ground_truth.tum), or its whole path."],
    estimates: Annotated[list[str], f"The same of 1 to {MOST_ESTIMATES} trajectories of any program."],
    alignment: Annotated[Alignment, "How they are aligned; sim3 where the estimate has no metric unit."] = "se3",
    delta: Annotated[str, "Distance of the poses of a relative error: 10 (poses), 1m, or 1s."] = "1",
    max_difference_s: Annotated[float, "Largest time difference of compared poses [s]."] = 0.01,
    offset: Annotated[float, "Added to the times of the estimates [s]."] = 0.0,
    clock_rate: Annotated[float, "Seconds of the reference per second of the estimates."] = 1.0,
    conventions: Annotated[tuple[Convention, ...], "What the estimates' poses are, if not world_from_body."] = (),
    reference_conventions: Annotated[tuple[Convention, ...], "The same of the reference."] = (),
    body: Annotated[Literal["same", "auto"], "auto: fit the constant pose between both bodies."] = "same",
    exclude: Annotated[tuple[str, ...], "Stretches of the reference that are left out, as FROM:TO [s]."] = (),
    times: Annotated[str, "File with the times of rows, for files without; empty: compared row by row."] = "",
) -> dict[str, Any]:
    """Compares trajectories with a reference, and audits the question. Each of `estimates` has ATE, RPE, errors of
    KITTI, scale and coverage, and `audit`: what is wrong behind the errors (clock, axes, inverse poses, another body,
    the unit, jumps ...), with `sentence`, errors `before` and `after`, and the `option` that corrects it, which is an
    argument here: `--offset -0.3` is offset=-0.3. Nothing is corrected unasked. `protocol` says how it was compared."""
    if not 1 <= len(estimates) <= MOST_ESTIMATES:
        raise InputError(f"{len(estimates)} estimates are given: give 1 to {MOST_ESTIMATES}")
    with confined(agents.places):
        options = Evaluate(
            reference=agents.file(reference),
            estimates=tuple(map(agents.file, estimates)),
            alignment=alignment,
            delta=delta,
            max_difference_s=max_difference_s,
            offset=offset,
            clock_rate=clock_rate,
            conventions=conventions,
            reference_conventions=reference_conventions,
            body=body,
            exclude=exclude,
            times=agents.file(times) if times else None,
        )
        return answer_of(written(evaluation(options)))


TOOLS = (Tool(evaluate),)
