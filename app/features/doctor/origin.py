"""A run that the doctor may fork: where it can be gone on from, and what it gave itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

from ispom.ensemble import build
from ispom.methods import with_dependencies
from ispom.types import Sequence

from ...engine.differences.compare import FROM_POINTS, MethodRow, in_order, record_rows, stored_pose
from ...engine.playback import Builder, Playback
from ...engine.run_events.stretch import Stretch
from ...engine.run_folder.run_file import RunFile
from ...engine.run_folder.step_reader import stored_steps
from ...session.current_run import CurrentRun


@dataclass(frozen=True, eq=False)
class Origin:
    """A run, and one of its states before the stretch."""

    begin: Callable[[], Playback]
    """The run at that state; nobody else steps it. Raises InputError where it cannot be had."""
    rows: Callable[[int, int], Iterator[MethodRow]]
    """What the run gave from one frame to another, both included."""
    afresh: Callable[[], Playback]
    """The run before its first frame; nobody else steps it. Raises InputError where it cannot be had."""

    @staticmethod
    def of_folder(folder: Path, run: RunFile, sequence: Sequence, builder: Builder = build) -> Origin:
        """Of a stored run, which keeps no states: it is replayed from its first frame."""

        def rows(first: int, last: int) -> Iterator[MethodRow]:
            with stored_steps(folder) as steps:
                for s in takewhile(lambda step: step.exposure <= last, steps):
                    if s.exposure >= first:
                        values = in_order(s.values, s.decisions, stored_pose(s.values))
                        yield MethodRow(s.exposure, s.time_ns, s.method, values)

        def begin() -> Playback:
            return Playback(sequence, with_dependencies(run.methods), run.configs(), builder, run.earlier)

        return Origin(begin, rows, begin)

    @staticmethod
    def of_run(run: CurrentRun, stretch: Stretch) -> Origin:
        """Of the run of a session, from the nearest state that it keeps. For the session's thread."""
        before, history = run.playback, run.history
        nearest = run.checkpoints.nearest(stretch.first)
        snapshot = None if nearest is None else nearest.snapshot
        own = max(stretch.first, *(stage.until for stage in before.earlier), 0)
        playback = before.forked(own, before.methods, before.config, snapshot)
        start = max((stage.until for stage in before.earlier), default=0)
        afresh = before.forked(start, before.methods, before.config)

        def rows(first: int, last: int) -> Iterator[MethodRow]:
            for i in range(first, min(last + 1, len(history))):
                found, thinned = record_rows(history[i], before.methods), history[i].thinned
                yield from map(without_points, found) if thinned else found

        return Origin(lambda: playback, rows, lambda: afresh)


def without_points(row: MethodRow) -> MethodRow:
    """Returns the row as that of a frame whose points were given up to keep the history small."""
    return replace(row, values={key: value for key, value in row.values.items() if key not in FROM_POINTS})
