"""Runs that are made to be published: each once, into a folder, and with all that the facts of lessons are found in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from ispom.ensemble import build
from ispom.methods import named_methods
from ispom.types import images_of

from ....engine.events import Finished, Stepped
from ....engine.history.history import History
from ....engine.history.record import ExposureRecord
from ....engine.history.series import Series
from ....engine.options import settings_of
from ....engine.playback import Builder, Playback
from ...headless.command import played_into
from ...headless.console import silent
from ...headless.options import Run
from ...headless.seen import Seen
from ...lessons.lesson import RunRequest
from ...lessons.ran import Ran

MEMORY_BYTES = 20_000_000
"""Most memory for the frames of one run; older frames are read from the disk."""


class Kept(Seen):
    """All frames of a run, and its trajectories as of some of them."""

    def __init__(self, playback: Playback, ends: frozenset[int]) -> None:
        super().__init__()
        self._playback, self._ends = playback, ends
        self._opened = playback.opened
        self._history, self._series = History(MEMORY_BYTES), Series(playback.methods)
        self._finished: dict[int, Finished] = {}
        self.images = 0
        """Of all cameras."""

    def add(self, event: Stepped) -> None:
        super().add(event)
        self.images += len(images_of(event.exposure))
        record = ExposureRecord.of(event, self._history.last)
        self._history.append(record)
        self._series.append(record)
        if record.index in self._ends:
            self._finished[record.index] = self._playback.finish()

    def ran(self, to: int | None) -> Ran:
        """The run up to a frame at which it was kept, or to its end (None)."""
        if to is None or to >= len(self._history) - 1:
            assert self.finished is not None
            return Ran(self._opened, self._history, self._series, self.finished)
        records = _First(self._history, to + 1)
        return Ran(self._opened, records, self._series.until(to + 1, self._playback.methods), self._finished[to])


@dataclass(frozen=True, eq=False)
class _First:
    """The first frames of a history."""

    records: History
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> ExposureRecord:
        if not -self.count <= index < self.count:
            raise IndexError(index)
        return self.records[index % self.count]

    def __iter__(self) -> Iterator[ExposureRecord]:
        return (self.records[i] for i in range(self.count))


@dataclass(frozen=True, eq=False)
class KeptRun:
    folder: Path
    kept: Kept


@dataclass
class Runs:
    """By what was asked for."""

    place: Path
    """Their folders are below it."""
    ends: Iterable[int]
    """Frames up to which somebody may want to have a run."""
    builder: Builder = build
    _made: dict[str, KeptRun] = field(default_factory=dict)

    def of(self, asked: RunRequest) -> KeptRun:
        """The run. InputError as `ispom run`."""
        key = repr(asked)
        if key not in self._made:
            self._made[key] = self._run(asked, self.place / str(len(self._made)))
        return self._made[key]

    def require(self, asked: RunRequest) -> None:
        """Raises InputError where a source cannot be opened, or a method not be made for it: before anything is run."""
        rig = _options(asked).open(asked.source).rig
        self.builder(asked.config, named_methods(asked.methods, rig), rig)

    def _run(self, asked: RunRequest, folder: Path) -> KeptRun:
        options = replace(_options(asked), out=folder)
        sequence, ends = options.open(asked.source), frozenset(self.ends)
        job = played_into(options, sequence, self.builder, progress=silent, seen=lambda p: Kept(p, ends))
        assert isinstance(job.seen, Kept)
        return KeptRun(folder, job.seen)


def _options(asked: RunRequest) -> Run:
    """Those of `ispom run` for it."""
    return Run(source=asked.source, methods=asked.methods, settings=settings_of(asked.config))
