"""The stretch of a run that is examined."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.types import Sequence

from ..run_folder.run_folder import EVENTS
from ..verdict import Severity
from .event import RunEvent
from .table import read_events

BEFORE = 2 / 3
"""Share of the stretch that is before the requested frame: a cause comes before its effect."""


@dataclass(frozen=True)
class Stretch:
    """First and last measurement of the stretch, and the event for which it is examined."""

    first: int
    last: int
    at: int
    event: RunEvent | None = None
    quiet: bool = False
    """Whether the run had no warning and no loss in it."""


def worst_event(events: Iterable[RunEvent]) -> RunEvent | None:
    """Returns the most severe warning or loss; of these the longest, then the first. None where nothing went wrong."""
    order = list(Severity)
    found = [event for event in events if event.severity.alarming]
    # an event without an end held until the end of the run
    lengths = {id(event): event.length if event.until is not None else float("inf") for event in found}
    return max(found, key=lambda e: (order.index(e.severity), lengths[id(e)], -e.frame), default=None)


def event_at(events: Iterable[RunEvent], frame: int) -> list[RunEvent]:
    """Returns the warnings and losses that hold at a frame."""
    return [e for e in events if e.severity.alarming and (e.frame == frame or e.frame < frame < (e.until or frame + 1))]


def events_in(folder: Path) -> list[RunEvent]:
    """Returns the events of a run's folder; none where it has no events.csv."""
    return read_events(folder / EVENTS) if exists(folder / EVENTS) else []


def stretch_of(sequence: Sequence, at: int | None, frames: int, events: Iterable[RunEvent]) -> Stretch:
    """Returns the stretch around a frame, or around the worst event, or the middle of the run.

    Raises InputError where the sequence has neither a video camera nor a pair, or no such frame.
    """
    main = "video" if sequence.rig.video is not None else "stereo"
    own = [i for i, kind in enumerate(sequence.kinds) if kind == main]
    if len(own) < 4:
        raise InputError(f"{sequence.name} has {len(own)} {main} frames, and the doctor needs 4: give a longer run")
    events = list(events)
    event = worst_event(events if at is None else event_at(events, at))
    frame = at if at is not None else event.frame if event is not None else len(sequence) // 2
    if not 0 <= frame < len(sequence):
        raise InputError(f"frame {frame} is not in the run: give one from 0 to {len(sequence) - 1}")
    here = sum(i <= frame for i in own) - 1
    start = max(0, min(here - round(BEFORE * frames), len(own) - frames))
    end = min(len(own) - 1, start + frames - 1)
    first, last = own[start], own[end]
    troubles = [e for e in events if e.severity.alarming and e.frame <= last and (e.until is None or e.until > first)]
    return Stretch(first, last, frame, event, not troubles)
