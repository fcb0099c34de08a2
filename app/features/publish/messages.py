"""What the session would tell a page of a finished run, computed in advance: the page plays it without a server.

`run_message` is the whole of it but for the HTML of the left pane (panels.py) and the stage (stage.py). The page's
script `published_session.js` reads it.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from typing import Any

from ...session import commands as do
from ...session.actions import actions
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.rerun.blueprint import hidden_in_world, hidden_paths
from ...views.rerun.layers import LAYERS, OPTIONAL
from ...views.web.messages import keys, message_of
from ...views.web.numbers import over_time
from ...views.web.time_axis import AxisNews
from ..branches.stage import entity_of
from ..events.commands import StepToEvent
from ..layers.state import Layers
from ..plots.commands import DEFAULT_PLOTS, ERROR, Plots
from ..plots.page_message import PlotNews, choices
from ..stage.page_message import StageNews

ALONE = {"driving": True, "driver": 1, "you": 1, "others": [], "may_drive": True}
"""The people at a published page: each reader has it alone."""
LAYOUT = ("eye", "layout", "curves")
"""What of the eyes is the same at all frames."""
OF_FRAME = ("index", "time_s", "methods")
"""What of a message differs from frame to frame."""


def run_message(state: State, run: CurrentRun) -> dict[str, Any]:
    """The message of the first frame, and what differs at the others. `state` is a `finished_state`."""
    first = _message(state, run, 0)
    return {
        "message": first | {"keys": _keys(), "people": ALONE, "looking": None, "own": None, "refused": [0, ""]},
        "axis": _all_of(AxisNews(), state, run),
        "eye": {key: value for key, value in _eyes(state, run).items() if key in LAYOUT},
        "frames": list(_frames(state, run)),
        "plots": _plots(state, run),
        "paths": _paths(state),
    }


def finished_state(state: State, name: str) -> State:
    """As a published page has it: the run is called so, nothing goes on, and nothing was said before."""
    kept = tuple(note for note in state.notes if not note.startswith("stored run "))
    state = replace(state, source=name, notes=kept, activity=None, playing=False, compiling="")
    return replace(state, notices=(), notice_count=0)


def _message(state: State, run: CurrentRun, index: int) -> dict[str, Any]:
    return message_of(replace(state, displayed=run.history[index]))


def _keys() -> list[dict[str, Any]]:
    """Those that need no estimator."""
    kept = {a.name for a in actions() if isinstance(a.command, do.Moves | StepToEvent)}
    return [key for key in keys() if key["name"] in kept]


def _frames(state: State, run: CurrentRun) -> Iterator[dict[str, Any]]:
    """Of each frame: what differs, and where the eye of the 3-D view may stand."""
    news = StageNews()
    known = _eyes(state, run, news)
    for index in range(len(run.history)):
        at = replace(state, displayed=run.history[index])
        known |= news.since(at, run) or {}
        found = message_of(at)
        yield {name: found[name] for name in OF_FRAME} | {"stage": {k: v for k, v in known.items() if k not in LAYOUT}}


def _eyes(state: State, run: CurrentRun, news: StageNews | None = None) -> dict[str, Any]:
    """Those at the last frame: what is framed there is framed at every frame."""
    return (news or StageNews()).since(replace(state, displayed=run.history.last), run) or {}


def _all_of(news: AxisNews | PlotNews, state: State, run: CurrentRun) -> dict[str, Any]:
    """The whole of what comes to a page in increments."""
    found: dict[str, Any] = {}
    while more := news.since(state, run):
        for key, value in more.items():
            found[key] = [*found.get(key, []), *value] if isinstance(value, list) else value
    return found


def _plots(state: State, run: CurrentRun) -> dict[str, Any]:
    """Everything that can be plotted: `rows` by name, and the `values` of their curves by id."""
    named = list(choices(run.series.quantities))
    rows: dict[str, Any] = {}
    values: dict[str, Any] = {}
    for name, _ in named:
        found = _all_of(PlotNews(), state.having(Plots((name,))), run)
        for row in found.get("plots", ()):
            rows[row["name"]] = row
        for curve, frames, numbers in [*found.get("values", ()), *found.get("errors", ())]:
            before = values.setdefault(curve, [[], []])
            if name == ERROR or not before[0] or before[0][-1] < frames[0]:
                before[0] += frames
                before[1] += numbers
    shown = [[name, title] for name, title in named if name in rows]
    return {"choices": shown, "usual": list(DEFAULT_PLOTS), "rows": rows, "values": values}


def numbers_message(run: CurrentRun) -> dict[str, Any]:
    """The table that "Save this view" makes CSV files of: a row for each frame, a column for each of the `quantities`
    (name, unit, meaning)."""
    head, *rows = csv.reader(StringIO(over_time(run.series, len(run.series)), newline=""))
    quantities = [run.series.quantities[name] for name in head]
    return {"quantities": [[q.name, q.unit, q.help] for q in quantities], "rows": rows}


def _paths(state: State) -> dict[str, list[str]]:
    """By each layer, method and branch that can be hidden: the paths that are hidden then in addition."""
    colouring = state[Layers].colour_by
    always = set(hidden_paths(state.methods, OPTIONAL, colouring, state.cameras))
    found = {}
    for name in (*state.methods, *LAYERS):
        if name not in OPTIONAL:
            paths = hidden_paths(state.methods, {name, *OPTIONAL}, colouring, state.cameras)
            found[name] = [path for path in paths if path not in always]
    for branch in state[Branches].all[1:]:
        found[branch_layer(branch.number)] = [hidden_in_world(entity_of(branch.number))]
    return found


def branch_layer(number: int) -> str:
    """What the page's session calls the trajectories of a branch among the layers."""
    return f"branch:{number}"
