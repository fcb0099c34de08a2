"""What is to be shrunk: a recording, what runs over it, and which of its events is the failure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.files import Places, exists, expanded
from ispom.methods import Config, chosen_methods, in_order
from ispom.types import Sequence

from ...engine.playback import Builder
from ...engine.run_events.event import RunEvent, event_kinds
from ...engine.run_events.stretch import events_in
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import EVENTS, RUN
from ...session.review.stored import stored_source
from ..doctor.command import opened as opened_run
from ..doctor.options import Doctor
from .cut import cameras_of, cut, frame_times
from .drawn import drawn, points_of
from .options import Shrink
from .search import Clip, Shrunk, shrunk
from .trial import Bench, Failure, Outcome, events_of, quiet_stretches, steps_of

Seen = Callable[[Clip, Outcome], None]
"""Is called after each trial."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A recording and what runs over it."""

    sequence: Sequence
    methods: tuple[str, ...]
    config: Config
    wanted: Callable[[int, RunEvent], bool]
    """Whether an event of the run, with its number, is the one to look at."""
    external: tuple[str, ...] = ()
    places: Places = None
    """Only what lies here is read, links followed; None: anything."""

    @property
    def whole(self) -> Clip:
        """The clip of the whole recording."""
        return Clip(tuple(range(len(frame_times(self.sequence)))), self.methods, cameras_of(self.sequence))


def subject_of(options: Shrink) -> Subject:
    """Returns what the options name. Raises InputError where the folder holds no such event, the source is gone, or
    the run was forked or live."""
    if options.event is not None and options.kind is not None:
        raise InputError("--event and --kind both name the event: give one of them")
    if options.kind is not None and options.kind not in event_kinds():
        raise InputError(f"--kind is {options.kind[:40]!r}, no kind of event: give one of {', '.join(event_kinds())}")
    folder = expanded(options.run)
    if exists(folder / RUN):
        return _of_run(options, folder, read_run_file(folder))
    sequence = options.open(options.run)
    require_replayable(sequence)
    methods = chosen_methods(options.methods, sequence.rig, options.variant or "modern")

    def wanted(number: int, event: RunEvent) -> bool:
        if options.event is not None:
            return number == options.event
        return event.kind == options.kind if options.kind is not None else event.severity.alarming

    return Subject(sequence, methods, options.config, wanted, options.external)


def require_replayable(sequence: Sequence) -> None:
    """Raises InputError for a live source, which is gone."""
    if sequence.grow is not None:
        if sequence.stop is not None:
            sequence.stop()
        raise InputError(f"{sequence.name} is live, and cannot be run twice: give a recording")


def require_own_frames(forked: Iterable[object]) -> None:
    """Raises InputError for a fork: a clip of it would begin with other methods or settings."""
    if any(forked):
        raise InputError("the run was forked from another one, and a clip of it has no part before: run its settings")


def _of_run(options: Shrink, folder: Path, run: RunFile) -> Subject:
    require_own_frames(run.forked)
    found = events_in(folder)
    event = chosen(found, options.event, options.kind)
    if event is None:
        what = "no warning and no loss"
        if options.kind is not None or options.event is not None:
            what = f"no event {options.event if options.kind is None else options.kind}"
        raise InputError(f"{folder / EVENTS} has {what}: give another run, or one of its events by --event N")

    def wanted(number: int, other: RunEvent) -> bool:
        return (other.kind, other.method, other.time_ns) == (event.kind, event.method, event.time_ns)

    places = stored_source(folder, run, options.source).places
    sequence = opened_run(Doctor(run=folder, source=options.source), run)
    return Subject(sequence, run.methods, run.configs(), wanted, options.external, places)


def chosen(events: Iterable[RunEvent], number: int | None, kind: str | None) -> RunEvent | None:
    """Returns the event of this number, or the first of this kind, or the first warning or loss; None without."""
    for i, event in enumerate(events):
        first = event.kind == kind if kind is not None else event.severity.alarming
        if i == number if number is not None else first:
            return event
    return None


@dataclass(frozen=True)
class Order:
    """How the smallest clip is looked for."""

    near: int
    """Frames by which the event may begin sooner or later."""
    trials: int
    private: bool = False
    """Whether tracked points are drawn in place of the images."""


@dataclass(frozen=True, eq=False)
class Found:
    """A failure, and the smallest clip that has it."""

    event: RunEvent
    """In the whole recording."""
    recorded_frame: int
    """Number of its frame in the recording."""
    bench: Bench
    shrunk: Shrunk
    whole: Clip


def search(subject: Subject, order: Order, builder: Builder, advance: Callable[[], None], seen: Seen) -> Found | None:
    """Returns the smallest clip, or None where the failure does not happen again. Raises InputError where the recording
    cannot be run."""
    sequence, whole = subject.sequence, subject.whole
    events = events_before(subject, whole, builder, advance)
    if events is None:
        return None
    event = events[-1]
    if not event.method:
        raise InputError(f"{event.sentence.removesuffix('.')}: such an image cannot be copied, so give the file itself")
    if event.method and event.method not in whole.methods:  # one that another method builds on
        whole = replace(whole, methods=in_order((*whole.methods, event.method)))
    times_ns = frame_times(sequence).tolist()
    failure = Failure.of(event, times_ns, order.near)
    end = next((i for i, t in enumerate(times_ns) if t >= event.time_ns), len(times_ns) - 1)
    if order.private:
        part = cut(sequence, whole)
        steps = steps_of(part, whole.methods, subject.config, builder, advance)
        until = takewhile(lambda step: step.exposure.time_ns <= failure.until_ns, steps)
        sequence = drawn(sequence, points_of(until, event.method))
    same = [each.time_ns for each in events if failure.at_any_time.is_in(each)]
    quiet = quiet_stretches(np.searchsorted(times_ns, same).tolist(), order.near)
    bench = Bench(sequence, subject.config, builder, failure, advance, quiet)

    def fails(clip: Clip) -> bool:
        known = clip == whole and not order.private  # it was just run
        outcome = Outcome.REMAINS if known else bench.outcome(clip)
        seen(clip, outcome)
        return outcome == Outcome.REMAINS

    smallest = shrunk(whole, end, fails, order.trials)
    return None if smallest is None else Found(event, end, bench, smallest, whole)


def events_before(
    subject: Subject, whole: Clip, builder: Builder, advance: Callable[[], None]
) -> list[RunEvent] | None:
    """Runs the whole recording up to its failure, and returns the events up to that, the last one; None where it does
    not happen."""
    found = list[RunEvent]()
    for event in events_of(cut(subject.sequence, whole), whole.methods, subject.config, builder, advance):
        found.append(event)
        if subject.wanted(len(found) - 1, event):
            return found
    return None
