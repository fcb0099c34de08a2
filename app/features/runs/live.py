"""The rows of the session: the run that is open, and its branches."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ispom.types import Status

from ...engine.history.series import Series
from ...session.current_run import CurrentRun
from ...session.sources.folders import run_name
from ...session.state import State
from ..branches.branches import Branch
from ..branches.state import Branches
from .table import LIVE, Ate, Row, alarms, differing_settings


def live_rows(state: State, run_of: Callable[[int], CurrentRun | None], recordings: Path) -> dict[int, Row]:
    """By the number of its branch, in a state in which nothing is covered by a lesson's question."""
    keys = {b.number: _key(b, run_of(b.number), recordings) for b in state[Branches].all}
    found = {}
    for branch in state[Branches].all:
        run = run_of(branch.number)
        if run is not None:
            found[branch.number] = _row(branch, run, state, keys)
    return found


def _key(branch: Branch, run: CurrentRun | None, recordings: Path) -> str:
    """The name of a run that was read from the recordings folder, else LIVE and its number."""
    if run is not None and run.stored is not None:
        path, folder = run.stored.path.resolve(), recordings.resolve()
        if path.is_relative_to(folder):
            return path.relative_to(folder).as_posix()
    return f"{LIVE}{branch.number}"


def _row(branch: Branch, run: CurrentRun, state: State, keys: dict[int, str]) -> Row:
    stored = run.stored is not None
    first = branch.parent is None or stored
    options = vars(state.source_options) if not stored else {}
    name = run.stored.path.name if run.stored is not None else branch.name
    return Row(
        keys[branch.number],
        "live",
        state.name or run_name(state.source),
        name if first or not branch.at else f"{name}: fork at frame {branch.at}",
        "" if first else keys.get(branch.parent or 0, ""),
        differing_settings(run.opened.methods, run.opened.config, options) if first else branch.changes,
        tuple(Ate(name, error.ate_m, error.alignment) for name, error in branch.measured.errors.items()),
        _located(run.series, run.opened.methods),
        alarms(event.severity for event in run.events.events),
        picture=f"frame?branch={branch.number}&width=160",
        shown=branch.number == state[Branches].shown,
    )


def _located(series: Series, methods: tuple[str, ...]) -> dict[str, float]:
    """By method, the share of its frames so far at which it tracked."""
    tracking, found = tuple(Status).index(Status.TRACKING), {}
    for method in methods:
        if f"{method}.status" in series.quantities:
            statuses = series.values_of(f"{method}.status", len(series))[1]
            if len(statuses):
                found[method] = float(np.mean(statuses == tracking))
    return found


def merged(live: Iterable[Row], recorded: list[Row]) -> list[Row]:
    """All rows; a recorded run that the session has open is one row, with what its folder says."""
    live = list(live)
    shown = {row.key: row.shown for row in live}
    known = {row.key for row in recorded}
    rows = [replace(row, shown=shown[row.key]) if row.key in shown else row for row in recorded]
    return [*(row for row in live if row.key not in known), *rows]
