"""The run as browsers see it. Nothing listens here: the page's server reads the tape and passes it on.

live = LiveStream()
live.open(opened, history)               # for each run: a new tape
for event in events:                     # Stepped ..., and Finished at the end
    live.write(event)                    # never waits
live.tape.read(first, most_bytes)        # any number of readers, each at its own pace; `live.grown` tells of more
live.close()
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace
from pathlib import Path

import rerun as rr

from ..run.events import Event, Finished, Opened, Stepped
from ..run.history.feed import Feed
from ..run.history.history import History
from ..subscribers import Subscribers
from . import blueprint
from .batch import Batch, Columns, Entry
from .recorder import Recorder
from .rrd import messages
from .stored_tape import AnyTape, StoredTape
from .streams import APPLICATION, send
from .tape import Tape

log = logging.getLogger(__name__)
SHARED_S = 0.1
"""Longest time whose exposures go to the tape together."""
SETTLE_S = 0.3
"""Before what is known already is drawn again: the page's own panels come first, and a branch that is shown but for a
moment costs nothing."""
FLUSH_S = 5.0
"""Longest wait for Rerun's own threads."""


class LiveStream:
    """Its own thread turns events into `.rrd` bytes on a tape; `write` only hands over."""

    def __init__(self) -> None:
        self.tape: AnyTape | None = None
        """Of the run that is shown; None before the first."""
        self.grown = Subscribers()
        """Told whenever there is more on the tape, or another tape."""
        self._feed: Feed | None = None
        self._failure: str | None = None

    @property
    def dropped(self) -> int:
        """Exposures of this run whose images the viewers miss, because this thread lagged."""
        return self._feed.dropped if self._feed is not None else 0

    def open(self, opened: Opened, history: History) -> None:
        """Begins another run, in place of the one before. What its `history` holds already comes without images.

        OSError where the user's cache cannot be written.
        """
        self.close()
        self._failure = None
        tape, feed = self.tape, self._feed = Tape(), Feed(opened, history, rereads=False)
        arguments = (Recorder(opened), feed, tape)
        threading.Thread(target=self._run, args=arguments, daemon=True, name="live stream").start()
        self.grown.notify()

    def replay(self, *recordings: Path) -> None:
        """Shows a finished recording, in one file or several, in place of a run. InputError where it cannot be read."""
        tape = StoredTape(*recordings)
        self.close()
        self._failure = None
        self.tape = tape
        self.grown.notify()

    def write(self, event: Event) -> None:
        """Tells of an exposure that is in the history, or of the end. Returns at once; does nothing before `open`.

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
        """An exposure is shown: where it was drawn without its images, they come now. Does nothing before `open`."""
        if self._feed is not None:
            self._feed.look_at(index)

    def check(self) -> None:
        """RuntimeError, with the reason, where the thread has failed."""
        if self._failure:
            raise RuntimeError(self._failure)

    def close(self) -> None:
        """Ends the run for its readers; what is still on its way is lost."""
        feed, tape = self._feed, self.tape
        self._feed = self.tape = None
        if feed is not None:
            feed.close()
        if tape is not None:
            tape.close()
            self.grown.notify()

    def _run(self, recorder: Recorder, feed: Feed, tape: Tape) -> None:
        try:
            with _Encoder(recorder) as encoder:
                blueprint.send(encoder.lasting, recorder.opened)
                encoder.send(recorder.opening())
                self._append(tape, encoder)
                if len(feed.history):
                    feed.pause(SETTLE_S)
                due_s = 0.0
                while (event := feed.take()) is not None:
                    encoder.send(recorder.batch(event))
                    if feed.empty or time.monotonic() > due_s:  # in haste, several exposures share their chunks
                        self._append(tape, encoder)
                        due_s = time.monotonic() + SHARED_S
        except Exception as fault:
            if self.tape is tape:  # else the run is over, and its files are closed
                log.exception("the live stream failed")
                self._failure = f"{type(fault).__name__}: {fault}"

    def _append(self, tape: Tape, encoder: _Encoder) -> None:
        tape.append(*encoder.read())
        self.grown.notify()


class _Encoder:
    """Batches -> `.rrd` bytes, those of images apart."""

    def __init__(self, recorder: Recorder) -> None:
        self.lasting = rr.RecordingStream(APPLICATION, recording_id=recorder.recording_id)
        self._images = rr.RecordingStream(APPLICATION, recording_id=recorder.recording_id, send_properties=False)
        self._streams = {stream: rr.binary_stream(stream) for stream in (self.lasting, self._images)}

    def __enter__(self) -> _Encoder:
        return self

    def __exit__(self, *_: object) -> None:
        for stream, unread in self._streams.items():
            unread.read(flush_timeout_sec=FLUSH_S)  # Rerun warns, on the terminal, of what nobody read
            stream.disconnect()

    def send(self, batch: Batch) -> None:
        send(self.lasting, replace(batch, entries=tuple(e for e in batch.entries if not _is_image(e))))
        send(self._images, replace(batch, entries=tuple(e for e in batch.entries if _is_image(e))))

    def read(self) -> tuple[bytes, bytes]:
        """What was sent since the last time: all but images, and images."""
        lasting, images = (messages(stream.read(flush_timeout_sec=FLUSH_S)) for stream in self._streams.values())
        return lasting, images


def _is_image(entry: Entry | Columns) -> bool:
    return isinstance(entry, Entry) and isinstance(entry.value, rr.EncodedImage)
