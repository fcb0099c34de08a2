"""A trial: a clip is run as `ispom run` does, until its failure happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ispom.errors import InputError
from ispom.methods import Config, kinds_of, require_sensors, with_dependencies
from ispom.types import Sequence

from ...engine.events import Stepped
from ...engine.playback import Builder, Playback
from ...engine.run_events.event import RunEvent
from ...engine.run_events.table import EventRecorder
from .cut import cut, frame_times
from .search import Clip


@dataclass(frozen=True)
class Failure:
    """An event as another run may have it, too."""

    kind: str
    method: str
    """Empty for what is of no method."""
    cause: str
    """Key of the check that made it; empty where none did."""
    from_ns: int
    until_ns: int
    """It may begin at the frames from the one to the other, both included, on the clock of the recording [ns]."""

    @staticmethod
    def of(event: RunEvent, times_ns: list[int], near: int) -> Failure:
        """Returns the failure that begins at most so many frames before the event or after it; `times_ns` are those of
        the frames of the recording."""
        at = next((i for i, t in enumerate(times_ns) if t >= event.time_ns), len(times_ns) - 1)
        first, last = max(at - near, 0), min(at + near, len(times_ns) - 1)
        begin, end = min(times_ns[first], event.time_ns), max(times_ns[last], event.time_ns)
        return Failure(event.kind, event.method, event.cause, begin, end)

    def is_in(self, event: RunEvent) -> bool:
        """Whether this event is the failure: same kind, method and cause, at nearly the same frame."""
        same = (event.kind, event.method, event.cause) == (self.kind, self.method, self.cause)
        return same and self.from_ns <= event.time_ns <= self.until_ns


@dataclass(frozen=True, eq=False)
class Bench:
    """Runs clips of one recording."""

    whole: Sequence
    config: Config
    builder: Builder
    failure: Failure
    advance: Callable[[], None]
    """Called at each frame; raises what ends the command."""

    def fails(self, clip: Clip) -> bool:
        """Whether the failure is in a clip."""
        if self.failure.method and self.failure.method not in with_dependencies(clip.methods):
            return False
        try:
            event = self.found(cut(self.whole, clip), clip.methods)
        except InputError:  # it lacks a camera, or cannot be run: another failure
            return False
        return event is not None and self._follows(event, clip)

    def _follows(self, event: RunEvent, clip: Clip) -> bool:
        """Whether the method's frame before the event is the one of the recording: a larger step could be a failure of
        its own. At the first frame of the clip there is none before."""
        kinds = kinds_of((self.failure.method,)) if self.failure.method else frozenset(clip.cameras)
        own = np.array([kind in kinds and kind in clip.cameras for kind in self.whole.kinds], bool)
        before = self.whole.times_ns[own & (self.whole.times_ns < event.time_ns)]
        kept = np.isin(before, frame_times(self.whole)[list(clip.frames)])
        return not kept.any() or bool(kept[-1])

    def found(self, sequence: Sequence, methods: tuple[str, ...]) -> RunEvent | None:
        """Returns the event where the failure happens, None where it does not. Raises InputError where that cannot be
        run."""
        for event in events_of(sequence, methods, self.config, self.builder, self.advance, self.failure.until_ns):
            if self.failure.is_in(event):
                return event
        return None


def events_of(
    sequence: Sequence,
    methods: tuple[str, ...],
    config: Config,
    builder: Builder,
    advance: Callable[[], None],
    until_ns: int | None = None,
) -> Iterator[RunEvent]:
    """Yields the events of a run as they begin, up to a time on the clock of the recording [ns]. Raises InputError
    where it cannot be run."""
    recorder, count = EventRecorder(), 0
    for stepped in steps_of(sequence, methods, config, builder, advance):
        if until_ns is not None and stepped.exposure.time_ns > until_ns:
            return
        recorder.add(stepped)
        yield from recorder.log.since(count)
        count = len(recorder.log)


def steps_of(
    sequence: Sequence, methods: tuple[str, ...], config: Config, builder: Builder, advance: Callable[[], None]
) -> Iterator[Stepped]:
    """Yields what happens at each frame of a run."""
    require_sensors(methods, sequence.rig)
    playback = Playback(sequence, with_dependencies(methods), config, builder)
    if playback.sequence.prepare:
        playback.sequence.prepare(0)
    while not playback.done:
        advance()
        yield playback.step()
