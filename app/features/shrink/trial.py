"""A trial: a clip is run as `ispom run` does, until its failure happens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from collections.abc import Sequence as Listed
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from ispom.errors import InputError
from ispom.methods import Config, kinds_of, require_sensors, with_dependencies
from ispom.types import FRAME_KINDS, Kind, Sequence

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
        """Returns the failure that begins at most `near` frames before the event or after it; `times_ns` are the times
        of the frames of the recording."""
        at = next((i for i, t in enumerate(times_ns) if t >= event.time_ns), len(times_ns) - 1)
        first, last = max(at - near, 0), min(at + near, len(times_ns) - 1)
        begin, end = min(times_ns[first], event.time_ns), max(times_ns[last], event.time_ns)
        return Failure(event.kind, event.method, event.cause, begin, end)

    @property
    def at_any_time(self) -> Failure:
        """The same wherever it begins."""
        return replace(self, from_ns=-(1 << 63), until_ns=(1 << 63) - 1)

    def is_in(self, event: RunEvent) -> bool:
        """Whether this event is the failure: same kind, method and cause, at nearly the same frame."""
        same = (event.kind, event.method, event.cause) == (self.kind, self.method, self.cause)
        return same and self.from_ns <= event.time_ns <= self.until_ns


class Outcome(StrEnum):
    """Of a trial."""

    REMAINS = "remains"
    GONE = "gone"
    ANYWHERE = "anywhere"
    """The failure is there, but a clip of the same shape has it also where the recording has none."""


def control_of(clip: Clip, quiet: Iterable[range], kinds: Listed[frozenset[Kind]]) -> Clip | None:
    """Returns the clip of the same shape at the end of the first quiet stretch in which it has room; None without.

    `kinds` (F,) are those of the frames of the recording: the same cameras must have frames at the same places.
    """
    first, last = clip.frames[0], clip.frames[-1]
    for stretch in quiet:
        for end in reversed(stretch[last - first :]):
            moved = tuple(frame + end - last for frame in clip.frames)
            if all(
                kinds[a] & {*clip.cameras} == kinds[b] & {*clip.cameras}
                for a, b in zip(clip.frames, moved, strict=True)
            ):
                return replace(clip, frames=moved)
    return None


def quiet_stretches(frames: Iterable[int], near: int) -> tuple[range, ...]:
    """Returns the stretches between such events, which begin at these frames, and before the first one, that are more
    than `near` frames away from each; the last one first."""
    found, begin = list[range](), 0
    for frame in sorted(frames):
        found.append(range(begin, max(frame - near, begin)))
        begin = frame + near + 1
    return tuple(reversed(found))


@dataclass(frozen=True, eq=False)
class Bench:
    """Runs clips of one recording."""

    whole: Sequence
    config: Config
    builder: Builder
    failure: Failure
    advance: Callable[[], None]
    """Called at each frame; raises what ends the command."""
    quiet: tuple[range, ...] = ()
    """Stretches of frames without such an event in the whole recording, the one next to the failure first."""

    def outcome(self, clip: Clip) -> Outcome:
        """Says what is in a clip. A failure that the same cut makes of a stretch without it, too, is one of the cut:
        a map of two small images is often doubtful."""
        if self.failure.method and self.failure.method not in with_dependencies(clip.methods):
            return Outcome.GONE
        event = self._event(clip, self.failure)
        if event is None or not self._follows(event, clip):
            return Outcome.GONE
        control = control_of(clip, self.quiet, self._kinds)
        anywhere = None if control is None else self._event(control, self.failure.at_any_time)
        return Outcome.REMAINS if anywhere is None else Outcome.ANYWHERE

    @cached_property
    def _kinds(self) -> list[frozenset[Kind]]:
        """By number of the frame in the recording."""
        found: dict[int, frozenset[Kind]] = dict.fromkeys(frame_times(self.whole).tolist(), frozenset())
        for time_ns, kind in zip(self.whole.times_ns.tolist(), self.whole.kinds, strict=True):
            if kind in FRAME_KINDS:
                found[time_ns] |= {kind}
        return list(found.values())

    def _event(self, clip: Clip, failure: Failure) -> RunEvent | None:
        try:
            return replace(self, failure=failure).found(cut(self.whole, clip), clip.methods)
        except InputError:  # it lacks a camera, or cannot be run: another failure
            return None

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
