"""The mode Compare, of two runs of the session: the verdict, and in detail what differs from which frame on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from ispom.methods import method as registered
from ispom.methods import names
from ispom.types import Status

from ...engine.differences.compare import DIGEST, POSITION, Difference, Divergence
from ...engine.differences.paths import Path
from ...engine.history.quantities import POSE
from ...engine.history.series import Series
from ...presentation import colours
from ...presentation.texts import length
from ...session.branches.branches import Branch
from ...session.branches.comparison import Comparison
from ...session.branches.state import Branches
from ...session.current_run import CurrentRun
from ...session.state import State
from ..diff.text import distinct
from .compared_method import MethodRun
from .comparison_view import ComparedRun, comparison_view
from .table import Row, alarms, table_message

WORDS = {"new": "new tracks", "alive": "tracks that go on", "revised": "revised poses", "seconds": "computing time"}
"""What quantities are called, where their key says too little."""
MOST_LINES = 4
"""Differences that are listed of one frame."""


def comparison_message(
    state: State, comparison: Comparison, rows: Mapping[int, Row], run_of: Callable[[int], CurrentRun | None]
) -> dict[str, Any]:
    """`rows` has the rows of the session's runs by the number of their branch."""
    numbers = (comparison.shown, comparison.other)
    branches = [b for number in numbers for b in state[Branches].all if b.number == number]
    runs = [run for number in numbers if (run := run_of(number)) is not None]
    view = None
    if len(branches) == len(runs) == 2:
        a, b = (compared_run(run, branch) for run, branch in zip(runs, branches, strict=True))
        view = comparison_view(a, b, runs[0].playback.sequence.times_ns, comparison.start)
    return table_message(list(rows.values())) | {
        "branches": {number: row.key for number, row in rows.items()},
        "numbers": numbers,
        "view": msgspec.to_builtins(view),
        "first": [divergence_message(each) for each in comparison.first if plain(each)],
        "frames": [comparison.start, comparison.stop - 1],
        "done": comparison.done - comparison.start,
        "finished": comparison.finished,
        "apart": comparison.differing_frames,
        "thinned": comparison.thinned,
        "total": state.total,
    }


def compared_run(run: CurrentRun, branch: Branch) -> ComparedRun:
    """What is compared of a run, as far as it is computed."""
    count = len(run.series)
    methods = {
        method: _method_run(run.series, method, count, branch)
        for method in run.opened.methods
        if f"{method}.status" in run.series.quantities
    }
    return ComparedRun(methods, count, sum(alarms(event.severity for event in run.events.events).values()))


def _method_run(series: Series, method: str, count: int, branch: Branch) -> MethodRun:
    frames, statuses = series.values_of(f"{method}.status", count)
    poses = np.stack([series.values_of(f"{method}.{key}", count)[1] for key in POSE], axis=1)
    localised = statuses == tuple(Status).index(Status.TRACKING)
    known = localised & np.isfinite(poses).all(axis=1)  # a pose during the initialisation does not move yet
    path = Path(frames[known], poses[known, :3], poses[known, 3:])
    measured = branch.measured
    return MethodRun(path, frames, localised, measured.errors.get(method), measured.seconds.get(method))


def plain(divergence: Divergence) -> list[Difference]:
    """The differences that a person can read: no digests."""
    return [each for each in divergence.differences if not each.name.endswith(DIGEST)]


def divergence_message(divergence: Divergence) -> dict[str, Any]:
    """The frame, its time, and a line for each of the first differences."""
    found = plain(divergence)
    lines = [_line(each) for each in found[:MOST_LINES]]
    return {"frame": divergence.exposure, "lines": lines, "more": len(found) - len(lines)}


def _line(difference: Difference) -> str:
    """`Monocular new tracks: 0 vs 147 (Δ 147)`."""
    if difference.name.endswith(POSITION) and difference.by is not None:
        method = difference.name.removesuffix(f".{POSITION}")
        distance = length(difference.by) if registered(method).unit == "metric" else f"{difference.by:.3g} (own unit)"
        return f"{colours.label(method)} position: {distance} apart"
    method = next((m for m in _prefixes(difference.name) if m in names()), difference.name.partition(".")[0])
    key = difference.name.removeprefix(f"{method}.")
    key = WORDS.get(key, key.replace("_", " ").replace(".", " "))
    a, b = distinct(difference.a, difference.b)
    by = "" if difference.by is None else f" (Δ {difference.by:.3g})"
    return f"{colours.label(method)} {key}: {a} vs {b}{by}"


def _prefixes(name: str) -> Iterator[str]:
    """Of `a.b.c`: `a.b`, `a`."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name
