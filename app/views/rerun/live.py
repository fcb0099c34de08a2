"""The run for browsers. Nothing listens here: the page's server reads the tape and sends it.

live = LiveStream()
live.open(opened, history)               # for each run: a new tape
for event in events:                     # Stepped ..., and Finished at the end
    live.write(event)                    # never waits
live.tape.scene(index)                   # any number of readers, each at its own pace; `live.grown` rings for more
live.close()
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import rerun as rr

from ispom.types import Kind

from ...engine.events import Event, Finished, Opened, Pictured, Stepped
from ...engine.history.feed import Feed
from ...engine.history.history import History
from ...engine.subscribers import Subscribers
from . import blueprint
from .batch import Batch, Entry
from .parts import columns_of, is_part
from .recorder import Recorder
from .rrd import messages
from .stored_tape import AnyTape, BegunTape, StoredTape
from .streams import APPLICATION, release_streams, send
from .tape import Tape

log = logging.getLogger(__name__)
SETTLE_S = 0.3
"""Wait before known frames are drawn again, so that the page's panels come first, and a branch that is shown only for a
moment costs nothing."""
FLUSH_S = 5.0
"""Longest wait for Rerun's own threads."""


class LiveStream:
    """Turns events into `.rrd` bytes on a tape, in a thread of its own; `write` only passes them to it."""

    def __init__(self) -> None:
        self.tape: AnyTape | None = None
        """The tape of the run that is shown; None before the first."""
        self.grown = Subscribers()
        """Called whenever the tape has grown or was replaced."""
        self._feed: Feed | None = None
        self._failure: str | None = None

    @property
    def dropped(self) -> int:
        """Returns the number of frames of this run that came without images, because this thread lagged."""
        return self._feed.dropped if self._feed is not None else 0

    @property
    def watched(self) -> bool:
        """Returns whether somebody has seen more than one frame of a run that began with a recording."""
        return isinstance(self.tape, BegunTape) and self.tape.frames_seen > 1

    def open(self, opened: Opened, history: History, beginning: Path | None = None) -> None:
        """Replaces the run by another one. Frames in its `history` come without images at first. Its other frames are
        those of the recording `beginning`.

        OSError where the user's cache cannot be written, InputError as `replay`.
        """
        kinds = opened.sequence.kinds[: len(history)]
        recorded = None if beginning is None else StoredTape(beginning, kinds=kinds)
        self.close()
        self._failure = None
        feed = self._feed = Feed(opened, history, rereads=False)
        tape = Tape(
            recording_id=opened.recording_id,
            kinds=lambda: opened.sequence.kinds,
            expected=lambda: history.computed,
            request=feed.request,
        )
        self.tape = tape if recorded is None else BegunTape(tape, recorded)
        arguments = (Recorder(opened), feed, tape)
        threading.Thread(target=self._run, args=arguments, daemon=True, name="live stream").start()
        self.grown.notify()

    def replay(self, opened: Opened, *recordings: Path, kinds: Sequence[Kind] = ()) -> None:
        """Shows a finished recording of a run, in one file or several, in place of one that goes on. InputError where
        it cannot be read."""
        tape = StoredTape(*recordings, kinds=kinds, layout=partial(layout_of, opened))
        self.close()
        self._failure = None
        self.tape = tape
        self.grown.notify()

    def write(self, event: Event) -> None:
        """Announces a frame that is in the history, or the end. Returns at once; does nothing before `open`.

        RuntimeError, with the reason, where the thread has failed.
        """
        self.check()
        if self._feed is None:
            return
        if isinstance(event, Finished):
            self._feed.finish(event)
        elif isinstance(event, Stepped):
            self._feed.offer(event)

    def look_at(self, index: int) -> None:
        """Says that a frame is shown. If it was drawn without its images, they come now. Does nothing before `open`."""
        if self._feed is not None:
            self._feed.look_at(index)

    def check(self) -> None:
        """RuntimeError, with the reason, where the thread has failed."""
        if self._failure:
            raise RuntimeError(self._failure)

    def close(self) -> None:
        """Ends the run for its readers; frames that were not drawn yet are lost."""
        feed, tape = self._feed, self.tape
        self._feed = self.tape = None
        if feed is not None:
            feed.close()
        if tape is not None:
            tape.close()
            self.grown.notify()

    def _run(self, recorder: Recorder, feed: Feed, tape: Tape) -> None:
        try:
            tape.open(_opening(recorder))
            self.grown.notify()
            if feed.history.computed:
                feed.pause(SETTLE_S)
            while (event := feed.take()) is not None:
                self._draw(tape, recorder, event)
        except Exception as fault:
            if self._feed is feed:  # otherwise the run is over, and its files are closed
                log.exception("the live stream failed")
                self._failure = f"{type(fault).__name__}: {fault}"

        finally:
            release_streams()

    def _draw(self, tape: Tape, recorder: Recorder, event: Event) -> None:
        batch = recorder.batch(event)
        for entry in batch.entries:
            if isinstance(entry, Entry) and not entry.static and is_part(entry.path):
                tape.put(batch.index, entry.path, columns_of(entry.path, entry.value))
        if isinstance(event, Stepped | Pictured):
            tape.came(event.index, bare=isinstance(event, Stepped) and not event.skipped and not _has_image(batch))
        self.grown.notify()


def layout_of(opened: Opened, recording_id: str) -> bytes:
    """The layout that the page knows, as `.rrd` messages for a recording with this id."""
    return _written(recording_id, lambda stream: blueprint.send(stream, opened))


def _opening(recorder: Recorder) -> bytes:
    """The layout and what holds for the whole run, as `.rrd` messages."""

    def write(stream: rr.RecordingStream) -> None:
        blueprint.send(stream, recorder.opened)
        send(stream, recorder.opening())

    return _written(recorder.recording_id, write)


def _written(recording_id: str, write: Callable[[rr.RecordingStream], None]) -> bytes:
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    unread = rr.binary_stream(stream)
    write(stream)
    content = messages(unread.read(flush_timeout_sec=FLUSH_S))
    stream.disconnect()
    return content


def _has_image(batch: Batch) -> bool:
    return any(isinstance(entry, Entry) and isinstance(entry.value, rr.EncodedImage) for entry in batch.entries)
