"""The first differences between two branches, found a little at a time in the worker."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from ispom.errors import InputError

from ...engine.differences.compare import FROM_POINTS, Divergence, MethodRow, divergences, record_rows
from ...engine.history.record import ExposureRecord
from ..current_run import CurrentRun
from .branches import Branch

SLICE_S = 0.015
"""Time that the worker compares without a break. To decode a past record from disk takes about a millisecond."""
ROUNDING = 1e-9
"""Differences of numbers up to this are rounding: relative above 1, absolute below. Digests are not compared."""
MOST = 10
"""Most frames that are listed, of those at which a quantity differs for the first time."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The differences between two branches, in the frames that were compared so far."""

    shown: int
    """The number of the branch that was shown; the first side."""
    other: int
    start: int
    """The frame from which on they may differ."""
    stop: int
    """One beyond the last frame that both had computed."""
    methods: tuple[str, ...]
    done: int = 0
    """The next frame to compare."""
    differing_frames: int = 0
    """Frames at which they differ, so far."""
    thinned: int = 0
    """Number of frames whose tracks and landmarks one history discarded. The other values of these are compared."""
    first: tuple[Divergence, ...] = ()
    """Divergences with quantities that had not differed before; at most MOST."""

    @property
    def finished(self) -> bool:
        return self.done >= self.stop


def begin(branches: tuple[Branch, ...], shown: int, other: int, a: CurrentRun, b: CurrentRun) -> Comparison:
    """Returns a comparison of which nothing is done yet. InputError where there is nothing to compare."""
    if shown == other:
        raise InputError("this branch is shown: choose another one to compare it with")
    methods = tuple(m for m in a.opened.methods if m in b.opened.methods)
    if not methods:
        raise InputError("the branches have no method in common: choose others")
    start, stop = forked_at(branches, shown, other), min(len(a.history), len(b.history))
    if start >= stop:
        raise InputError(f"one of the runs ends before frame {start}, where the other begins: play it on first")
    return Comparison(shown, other, start, stop, methods, start)


def forked_at(branches: tuple[Branch, ...], a: int, b: int) -> int:
    """The frame from which on two branches were computed separately; 0 where a branch between them was deleted."""
    path_a, path_b = (_path(branches, number) for number in (a, b))
    common = next((number for number in path_a if number in path_b), None)
    left = [] if common is None else [path[common] for path in (path_a, path_b)]
    return min((at for at in left if at is not None), default=0)


def _path(branches: tuple[Branch, ...], number: int) -> dict[int, int | None]:
    """Returns the branch and its ancestors, nearest first, each with the frame at which the next branch was forked from
    it; None for the branch itself."""
    by_number, found, left = {b.number: b for b in branches}, dict[int, int | None](), None
    at: int | None = number
    while at is not None:
        found[at] = left
        branch = by_number.get(at)
        at, left = (branch.parent, branch.at) if branch is not None else (None, None)
    return found


def advanced(comparison: Comparison, a: CurrentRun, b: CurrentRun, slice_s: float = SLICE_S) -> Comparison:
    """Returns the comparison after `slice_s` more of work, and after one more frame at least."""
    until, now = time.monotonic() + slice_s, _after(comparison, a, b)
    while not now.finished and time.monotonic() < until:
        now = _after(now, a, b)
    return now


def _after(now: Comparison, a: CurrentRun, b: CurrentRun) -> Comparison:
    records = a.history[now.done], b.history[now.done]
    thinned = any(record.thinned for record in records)
    left, right = (_rows(record, now.methods, thinned) for record in records)
    found = next(divergences(left, right, now.methods, ROUNDING), None)
    seen = frozenset(name for divergence in now.first for name in divergence.names)
    news = found.without(seen) if found is not None and len(now.first) < MOST else None
    return replace(
        now,
        done=now.done + 1,
        differing_frames=now.differing_frames + (found is not None),
        thinned=now.thinned + thinned,
        first=(*now.first, news) if news is not None else now.first,
    )


def _rows(record: ExposureRecord, methods: tuple[str, ...], thinned: bool) -> Iterator[MethodRow]:
    for row in record_rows(record, methods):
        values = {k: v for k, v in row.values.items() if not thinned or k not in FROM_POINTS}
        yield replace(row, values=values)
