"""Quantities and checks over the frames, for agents."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from ispom.errors import InputError
from ispom.methods import method as registered
from ispom.types import Check

from ...engine.history.quantity import Quantity
from ...engine.history.series import Series
from ...session.current_run import CurrentRun
from ..agents.agent_session import AgentSession
from ..agents.tool import Tool, brief, page_of

LIMIT = 100
CAN_FAIL = ("requirement", "warning")
"""Kinds of checks whose failure is one: a trigger that does not fire, and a finding, are none."""
COLUMNS = ("status", "x", "y", "z", "qx", "qy", "qz", "qw", "key_frame", "inliers", "residual_median_px", "error_m")
"""Columns of `steps`."""

First = Annotated[int, "First frame, from 0."]
Last = Annotated[int | None, "Last frame, included; null for the last computed one."]
Start = Annotated[int, "First row of the answer, for paging."]
Limit = Annotated[int, "Number of rows, at most 200."]


def quantities(
    agents: AgentSession,
    contains: Annotated[str, "Only keys or descriptions with this text, in any case; empty for all."] = "",
    method: Annotated[str, "Only those of this method; empty for all."] = "",
    start: Start = 0,
    limit: Limit = LIMIT,
) -> dict[str, Any]:
    """Lists the quantities of a frame that checks_over_time and condition_test know: key (METHOD.KEY), kind (number,
    flag or text with its choices), unit, and help. Each check KEY also has KEY.passed, KEY.margin and
    KEY.threshold."""
    text = contains.lower()
    found = [
        _described(quantity)
        for quantity in agents.run.series.quantities.values()
        if text in f"{quantity.name} {quantity.help}".lower() and method in ("", quantity.method)
    ]
    return page_of(found, start, limit)


def checks_over_time(
    agents: AgentSession,
    key: Annotated[str, "METHOD.KEY of a check or of any other quantity, as in `quantities`."],
    first: First = 0,
    last: Last = None,
    start: Start = 0,
    limit: Limit = LIMIT,
) -> dict[str, Any]:
    """Gives a quantity at each computed frame at which its method stepped and it has a value: rows of [frame, value],
    and for a check rows of [frame, value, threshold, passed] with `failed` (number of frames) and `first_failed`
    (frame). Also unit, least, median and largest value of the whole stretch."""
    series, frames = agents.run.series, agents.stretch(first, last)
    quantity = _quantity(series, key)
    indices, values = series.values_of(key, frames.stop, frames.start)
    known = np.isfinite(values)
    found = {**_described(quantity), "frames": [frames.start, frames.stop - 1]}
    if quantity.kind == "number" and known.any():
        least, median, largest = np.percentile(values[known], [0, 50, 100]).tolist()
        found |= {"least": brief(least), "median": brief(median), "largest": brief(largest)}
    rows = [[int(i), brief(series.value(quantity, int(i)))] for i in indices[known]]
    if (check := _check(quantity)) is not None:
        parts = [series.quantities[f"{key}.{part}"] for part in ("threshold", "passed")]
        rows = [[*row, *(brief(series.value(part, row[0])) for part in parts)] for row in rows]
        failed = [row[0] for row in rows if row[3] is False] if check.kind in CAN_FAIL else []
        found |= {"check": check.kind, "relation": check.relation, "failed": len(failed)}
        found |= {"first_failed": failed[0] if failed else None, "columns": ["frame", "value", "threshold", "passed"]}
    else:
        found["columns"] = ["frame", "value"]
    return {**found, **page_of(rows, start, limit)}


def first_failures(
    agents: AgentSession,
    first: First = 0,
    last: Last = None,
    method: Annotated[str, "Only this method; empty for all."] = "",
    start: Start = 0,
    limit: Limit = 50,
) -> dict[str, Any]:
    """Lists the checks that failed between two frames, the one that failed first at the top: key, kind, name,
    first_frame, frames (at how many it failed), made (at how many it was made), with value and threshold at the first
    frame. Where a fault begins, compare with the frames before it: some checks fail in healthy runs, too."""
    run, frames = agents.run, agents.stretch(first, last)
    if method:
        agents.method(method)
    found = [row for quantity in run.series.quantities.values() if (row := _failure(run, quantity, frames, method))]
    found.sort(key=lambda row: (row["first_frame"], row["kind"] != "requirement", row["key"]))
    return {"frames": [frames.start, frames.stop - 1], **page_of(found, start, limit)}


def steps(
    agents: AgentSession,
    method: Annotated[str, "A method of the run, as in `summary`."],
    first: First = 0,
    last: Last = None,
    start: Start = 0,
    limit: Limit = 50,
) -> dict[str, Any]:
    """Gives what a method reported at each of its steps, as known then: frame, time_s, status, position x y z (in the
    method's own world; metres of a method with metric unit), orientation quaternion qx qy qz qw, key_frame, inliers,
    residual_median_px, and error_m (position error before alignment, only with ground truth)."""
    series, frames = agents.run.series, agents.stretch(first, last)
    columns = [series.quantities[f"{agents.method(method)}.{key}"] for key in COLUMNS]
    time_s = series.quantities["time_s"]
    indices, _ = series.values_of(columns[0].name, frames.stop, frames.start)
    found = page_of(indices.tolist(), start, limit)
    found["rows"] = [
        [i, series.value(time_s, i), *(brief(series.value(column, i)) for column in columns)] for i in found["rows"]
    ]
    unit = "m" if registered(method).unit == "metric" else "own unit of the method"
    return {"columns": ["frame", "time_s", *COLUMNS], "position_unit": unit, **found}


def _described(quantity: Quantity) -> dict[str, Any]:
    found = {"key": quantity.name, "kind": quantity.kind, "unit": quantity.unit, "help": quantity.help}
    return found | ({"choices": list(quantity.choices)} if quantity.choices else {})


def _quantity(series: Series, key: str) -> Quantity:
    """InputError for a key that the run does not have."""
    found = series.quantities.get(key)
    if found is None:
        raise InputError(f"{key[:80]!r} is no quantity of this run: call quantities, which lists all")
    return found


def _check(quantity: Quantity) -> Check | None:
    """The check whose value the quantity is; None for any other one."""
    return registered(quantity.method).checks.get(quantity.key) if quantity.method else None


def _failure(run: CurrentRun, quantity: Quantity, frames: range, method: str) -> dict[str, Any] | None:
    """How a check failed in a stretch; None where it did not, and for what is no check."""
    check = _check(quantity)
    if check is None or check.kind not in CAN_FAIL or method not in ("", quantity.method):
        return None
    series, key = run.series, quantity.name
    indices, passed = series.values_of(f"{key}.passed", frames.stop, frames.start)
    failed = indices[passed == 0]
    if not len(failed):
        return None
    at = int(failed[0])
    return {
        "key": key,
        "kind": check.kind,
        "name": check.name,
        "first_frame": at,
        "frames": len(failed),
        "made": int(np.isfinite(passed).sum()),
        "value": brief(series.value(quantity, at)),
        "relation": check.relation,
        "threshold": brief(series.value(series.quantities[f"{key}.threshold"], at)),
        "unit": check.unit,
    }


TOOLS = (Tool(quantities), Tool(checks_over_time), Tool(first_failures), Tool(steps))
