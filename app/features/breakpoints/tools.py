"""Conditions, for agents."""

from __future__ import annotations

from typing import Annotated, Any

from ispom.errors import InputError

from ...engine.conditions.evaluate import matches, values
from ...engine.conditions.parser import parse
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, brief, page_of

LONGEST = 500
"""Characters of a condition."""


def condition_test(
    agents: AgentSession,
    expression: Annotated[
        str, 'Such as `stereo.inliers < 30 and changed(stereo.status)` or `monocular.status == "lost"`.'
    ],
    first: Annotated[int, "First frame, from 0."] = 0,
    last: Annotated[int | None, "Last frame, included; null for the last computed one."] = None,
    start: Annotated[int, "First row of the answer, for paging."] = 0,
    limit: Annotated[int, "Number of rows, at most 200."] = 50,
) -> dict[str, Any]:
    """Finds the computed frames at which a condition holds: `total` is their number, and each row has the frame and
    the values of the quantities that the condition names, by key. Names are those of `quantities`; operators are
    those of Python: and, or, not, comparisons, + - * /; functions are abs(x), increased(x) and changed(x), against
    the frame before. A missing value makes its comparison false."""
    if len(expression) > LONGEST:
        raise InputError(f"the condition has {len(expression)} characters: give at most {LONGEST}")
    series, frames = agents.run.series, agents.stretch(first, last)
    condition = parse(expression, series.quantities)
    found = page_of([i for i in frames if matches(condition, series, i)], start, limit)
    rows = ((i, values(condition, series.row(i, condition.quantities))) for i in found["rows"])
    found["rows"] = [{"frame": i, "values": {name: brief(value) for name, value in of.items()}} for i, of in rows]
    return {"frames": [frames.start, frames.stop - 1], **found}


TOOLS = (Tool(condition_test),)
