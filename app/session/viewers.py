"""Where viewers in browsers get the run from, guarded: a fault in what draws never stops what computes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from ispom.types import Kind

from ..engine.events import Event, Opened
from ..engine.history.history import History

log = logging.getLogger(__name__)
RESTARTS = 1
"""How often in a run what failed is started again, from the run's first frame on."""


class EventSink(Protocol):
    """Takes the events of one run after the other. Never blocks; what it raises is reported, and the run goes on."""

    def open(self, opened: Opened, history: History, beginning: Path | None = None) -> None:
        """Begins another run. What was computed of it, in `history`, is drawn first, without images; `beginning` is the
        recording of its first frames, which are shown from there until they are computed. InputError as `replay`."""
        ...

    def replay(self, opened: Opened, *recordings: Path, kinds: Sequence[Kind] = ()) -> None:
        """Shows a finished recording, in one file or several, in place of a run; `kinds` are those of its frames.
        InputError where it cannot be read."""
        ...

    def write(self, event: Event) -> None: ...

    def look_at(self, index: int) -> None:
        """A frame is shown: where it was drawn without its images, they are wanted now."""
        ...

    @property
    def watched(self) -> bool:
        """Whether somebody has seen more than one frame of a run that began with a recording."""
        ...

    def check(self) -> None:
        """Raises what went wrong since, if anything did."""
        ...


class Viewers:
    """A sink that may fail. `report` gets one sentence for the person."""

    def __init__(self, sink: EventSink | None, report: Callable[[str], None]) -> None:
        self._configured_sink, self._report = sink, report
        self._sink: EventSink | None = None
        self._restarts = 0
        self._looked_at = -1
        self._begin: Callable[[EventSink], None] = lambda _: None
        """Shows the run that is on the screen."""

    def open(
        self, opened: Opened, history: History, recording: Path | None = None, beginning: Path | None = None
    ) -> None:
        """Begins another run, whatever became of the one before; of one that is over, its recording is shown. The
        `beginning` is that of `EventSink.open`."""
        self._sink, self._restarts, self._looked_at = self._configured_sink, RESTARTS, -1
        kinds: tuple[Kind, ...] = () if recording is None else tuple(record.kind for record in history)
        files = [] if recording is None else [recording, *([opened.map.recording] if opened.map else [])]
        self._begin = lambda sink: (
            sink.replay(opened, *files, kinds=kinds) if files else sink.open(opened, history, beginning)
        )
        self._guarded(self._begin)

    def write(self, event: Event) -> None:
        self._guarded(lambda sink: sink.write(event))

    @property
    def watched(self) -> bool:
        """See `EventSink.watched`; also where nothing is drawn."""
        return self._sink is None or self._sink.watched

    def look_at(self, index: int) -> None:
        """Passes on the frame that is shown now, once."""
        if index >= 0 and index != self._looked_at:
            self._looked_at = index
            self._guarded(lambda sink: sink.look_at(index))

    def check(self) -> None:
        """Notices a sink that failed by itself."""
        self._guarded(lambda sink: sink.check())

    def _guarded(self, action: Callable[[EventSink], None]) -> None:
        if self._sink is None:
            return
        try:
            action(self._sink)
        except Exception as fault:
            log.exception("the live view failed")
            reason = f"{type(fault).__name__}: {fault}"
            if self._restarts:
                self._restarts -= 1
                self._report(f"The live view failed and was started again ({reason}).")
                self._guarded(self._begin)
            else:
                self._sink = None
                self._report(f"Live view stopped ({reason}); computation continues.")
