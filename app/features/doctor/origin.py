"""A run that the doctor may fork: where it can be gone on from, and what it gave itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from ispom.ensemble import build
from ispom.methods import with_dependencies
from ispom.types import Sequence

from ...engine.differences.compare import MethodRow, in_order, record_rows, stored_pose
from ...engine.playback import Builder, Playback
from ...engine.run_folder.run_file import RunFile
from ...engine.run_folder.step_reader import stored_steps
from ...session.current_run import CurrentRun
from .stretch import Stretch


@dataclass(frozen=True, eq=False)
class Origin:
    """A run, and one of its states before the stretch."""

    playback: Playback
    """At that state: nobody else steps it."""
    rows: Callable[[int, int], Iterator[MethodRow]]
    """What the run gave from one frame to another, both included."""

    @staticmethod
    def of_folder(folder: Path, run: RunFile, sequence: Sequence, builder: Builder = build) -> Origin:
        """Of a stored run, which keeps no states: it is replayed from its first frame. InputError as `builder`."""

        def rows(first: int, last: int) -> Iterator[MethodRow]:
            with stored_steps(folder) as steps:
                for s in takewhile(lambda step: step.exposure <= last, steps):
                    if s.exposure >= first:
                        values = in_order(s.values, s.decisions, stored_pose(s.values))
                        yield MethodRow(s.exposure, s.time_ns, s.method, values)

        return Origin(Playback(sequence, with_dependencies(run.methods), run.configs(), builder, run.earlier), rows)

    @staticmethod
    def of_run(run: CurrentRun, stretch: Stretch) -> Origin:
        """Of the run of a session, from the nearest state that it keeps. For the session's thread."""
        before, history = run.playback, run.history
        nearest = run.checkpoints.nearest(stretch.first)
        snapshot = None if nearest is None else nearest.snapshot
        own = max(stretch.first, *(stage.until for stage in before.earlier), 0)
        playback = before.forked(own, before.methods, before.config, snapshot)

        def rows(first: int, last: int) -> Iterator[MethodRow]:
            for i in range(first, min(last + 1, len(history))):
                yield from record_rows(history[i], before.methods)

        return Origin(playback, rows)
