"""The rows of the session: the run that is open, and its branches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ispom.types import Status

from ...engine.history.series import Series
from ...engine.options import SourceOptions
from ...session.branches.branches import Branch
from ...session.branches.kept import Kept
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.sources.folders import run_name
from ...session.state import State
from .table import LIVE, Ate, Row, alarms, differing_settings, small_curve


def live_rows(state: State, run_of: Callable[[int], CurrentRun | None], recordings: Path) -> dict[int, Row]:
    """By the number of its branch, in a state in which nothing is covered by a lesson's question."""
    known = state[Branches]
    runs = {b.number: run for b in known.all if (run := run_of(b.number)) is not None}
    source = state.name or run_name(state.source)
    rows = _rows(known.all, runs, source, state.source_options, "", recordings)
    return {number: replace(row, shown=number == known.shown) for number, row in rows.items()}


def kept_rows(kept: Iterable[Kept], open_runs: Iterable[CurrentRun], recordings: Path) -> list[Row]:
    """Of sources that were closed, but for runs that are open in another place."""
    found, known = list[Row](), {_identity(run) for run in open_runs}
    for each in sorted(kept, key=lambda kept: -kept.number):
        rows = _rows(each.branches, each.runs, each.name, each.options, f"{each.number}.", recordings)
        for number, row in rows.items():
            identity = _identity(each.runs[number])
            found += [] if identity in known else [row]
            known.add(identity)
    return found


def _identity(run: CurrentRun) -> object:
    """Of a run that was read, its folder: it may be open twice."""
    return run.stored.path.resolve() if run.stored is not None else id(run)


def kept_of(key: str, kept: Iterable[Kept]) -> tuple[Kept, int] | None:
    """What the key of a row of `kept_rows` names; None for another key, or what is gone."""
    numbers = key.removeprefix(LIVE).split(".")
    if not key.startswith(LIVE) or len(numbers) != 2 or not all(number.isdecimal() for number in numbers):
        return None
    found = next((each for each in kept if each.number == int(numbers[0])), None)
    return (found, int(numbers[1])) if found is not None and int(numbers[1]) in found.runs else None


def _rows(
    branches: Iterable[Branch],
    runs: Mapping[int, CurrentRun],
    source: str,
    options: SourceOptions,
    group: str,
    recordings: Path,
) -> dict[int, Row]:
    """By number of the branch; `group` comes before it in the key."""
    there = [branch for branch in branches if branch.number in runs]
    keys = {b.number: _key(f"{LIVE}{group}{b.number}", runs[b.number], recordings) for b in there}
    return {b.number: _row(b, runs[b.number], source, options, group, keys) for b in there}


def _key(own: str, run: CurrentRun, recordings: Path) -> str:
    """The name of a run that was read from the recordings folder, else its own."""
    if run.stored is not None:
        path, folder = run.stored.path.resolve(), recordings.resolve()
        if path.is_relative_to(folder):
            return path.relative_to(folder).as_posix()
    return own


def _row(
    branch: Branch, run: CurrentRun, source: str, source_options: SourceOptions, group: str, keys: dict[int, str]
) -> Row:
    stored = run.stored is not None
    first = branch.parent is None or stored
    options = vars(source_options) if not stored else {}
    name = run.stored.path.name if run.stored is not None else branch.name
    return Row(
        keys[branch.number],
        "live",
        source,
        name if first or not branch.at else f"{name}: fork at frame {branch.at}",
        "" if first else keys.get(branch.parent or 0, ""),
        differing_settings(run.opened.methods, run.opened.config, options) if first else branch.changes,
        tuple(Ate(name, error.ate_m, error.alignment) for name, error in branch.measured.errors.items()),
        _located(run.series, run.opened.methods),
        alarms(event.severity for event in run.events.events),
        picture=_picture(branch.number, group) if len(run.history) else "",
        curves={method: small_curve(curve.metres) for method, curve in branch.measured.curves.items()},
    )


def _picture(number: int, group: str) -> str:
    return f"frame?branch={number}&width=160" + (f"&kept={group[:-1]}" if group else "")


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
    shown = {row.key for row in live if row.shown}
    known = {row.key for row in recorded}
    rows = [replace(row, shown=True) if row.key in shown else row for row in recorded]
    return [*(row for row in live if row.key not in known), *rows]
