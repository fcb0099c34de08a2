"""The events of one run, found frame by frame: a frame costs the same however long the run is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from ispom.types import Status, Step

from ..history.quantities import Row
from ..history.record import ExposureRecord
from .event import Alarm, EventKind, Moment, RunEvent, Scope, event_kinds

MOST = 300
"""Events of one kind and method that are kept; more are only counted."""


class EventLog:
    """The events of one run. One thread appends to it, any thread reads it."""

    def __init__(self) -> None:
        self._events: list[RunEvent] = []
        """In the order in which they began."""
        self._latest: dict[tuple[str, str], RunEvent] = {}
        """By kind and method."""
        self._places: dict[tuple[str, str], int] = {}
        """Indices of the latest events; events that were omitted have none."""
        self._statuses: list[tuple[str, int, str]] = []
        """Method, frame and status at each change of the status."""
        self._status: dict[str, tuple[int, str]] = {}
        """By method: the first frame of its present status, and the status."""
        self._tracked: set[str] = set()
        """Methods that had a map before."""
        self._counts: Counter[tuple[str, str]] = Counter()
        self.omitted = 0
        """Events beyond MOST."""

    def __len__(self) -> int:
        return len(self._events)

    @property
    def events(self) -> tuple[RunEvent, ...]:
        return tuple(self._events)

    def since(self, count: int) -> tuple[RunEvent, ...]:
        """Those after the first `count`."""
        return tuple(self._events[count:])

    def append(self, record: ExposureRecord, before: Row, now: Row) -> None:
        """The next frame, with the quantities by method at the frame before and at this one."""
        self.add(record.index, record.time_ns, record.steps, before, now, record.skipped)

    def add(self, frame: int, time_ns: int, steps: Iterable[Step], before: Row, now: Row, skipped: str = "") -> None:
        """Takes a frame without a record."""
        self._look(Moment(frame, time_ns, skipped=skipped), "frame")
        for step in steps:
            earlier, values = before.get(step.method, {}), now.get(step.method, {})
            tracked = step.method in self._tracked
            since = self._status_since(step.method, frame, str(step.status))
            self._look(Moment(frame, time_ns, step, values, earlier, "", since, tracked), "method")

    def until(self, count: int, methods: Iterable[str]) -> EventLog:
        """Returns the events of another run of these methods that has the same first `count` frames."""
        log, shown_methods = EventLog(), {"", *methods}
        for event in self.events:
            if event.frame < count and event.method in shown_methods:
                log._begin(replace(event, until=None if event.until is None or event.until >= count else event.until))
        for method, frame, status in self._statuses:
            if frame < count and method in shown_methods:
                log._status_since(method, frame, status)
        return log

    def _status_since(self, method: str, frame: int, status: str) -> int:
        """The frame from which on a method has the status that it has at this frame."""
        since, before = self._status.get(method, (frame, ""))
        if status != before:
            since = frame
            self._statuses.append((method, frame, status))
            self._status[method] = (since, status)
        if status == Status.TRACKING:
            self._tracked.add(method)
        return since

    def _look(self, moment: Moment, scope: Scope) -> None:
        for kind in event_kinds().values():
            if kind.scope == scope and kind.detect is not None:
                self._take(kind, moment, kind.detect(moment))

    def _take(self, kind: EventKind, moment: Moment, found: Alarm | str | bool | None) -> None:
        latest = self._latest.get((kind.name, moment.method))
        holds = latest is not None and latest.until is None
        if found is False and latest is not None and holds:
            self._change(replace(latest, until=moment.frame))
        if not found:
            return
        alarm = found if isinstance(found, Alarm) else Alarm(str(found), {})
        soon = latest is not None and (holds or moment.frame - (latest.until or 0) < kind.quiet_frames)
        if latest is None or not soon:
            said = dict(alarm.excess)
        elif alarm.worse_than(latest.said):
            said = {**latest.said, **{k: max(v, latest.said.get(k, 0.0)) for k, v in alarm.excess.items()}}
            if holds:
                self._change(replace(latest, until=moment.frame))
        else:
            if not holds:
                self._change(replace(latest, until=None))
            return
        event = RunEvent(kind.name, moment.method, moment.frame, moment.time_ns, kind.severity, alarm.sentence)
        self._begin(replace(event, said=said, cause=alarm.cause))

    def _begin(self, event: RunEvent) -> None:
        name = (event.kind, event.method)
        self._counts[name] += 1
        self._latest[name] = event
        self._places.pop(name, None)
        if self._counts[name] > MOST:
            self.omitted += 1
            return
        self._places[name] = len(self._events)
        self._events.append(event)

    def _change(self, event: RunEvent) -> None:
        """Replaces the latest event of its kind and method."""
        name = (event.kind, event.method)
        self._latest[name] = event
        if name in self._places:
            self._events[self._places[name]] = event
