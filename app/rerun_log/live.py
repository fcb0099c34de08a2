"""The run as browsers see it. Nothing listens here: the page's server reads the tape and passes it on.

live = LiveStream()
live.open(opened)                        # for each run: a new tape
for event in events:                     # Stepped ..., and Finished at the end
    live.write(event)                    # never waits
live.tape.read(first, most_bytes)        # any number of readers, each at its own pace; `live.grown` tells of more
live.close()
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from dataclasses import replace

import rerun as rr

from ..run.events import Event, Opened, without_images
from ..subscribers import Subscribers
from . import blueprint
from .recorder import Batch, Columns, Entry, Recorder
from .rrd import messages
from .streams import APPLICATION, send
from .tape import Tape

log = logging.getLogger(__name__)
FLUSH_S = 5.0
"""Longest wait for Rerun's own threads."""
IMAGES_WAITING = 30
"""Exposures on their way to the tape before the oldest loses its images: a second of video."""


class Mailbox:
    """Events on their way to a thread that may be slow; `put` never waits.

    It keeps at most `images` events with images: then the oldest lose theirs. The rest of an event is what the history
    holds as well, and is delivered however late.
    """

    def __init__(self, images: int = IMAGES_WAITING) -> None:
        self.dropped = 0
        """Events that lost their images."""
        self._images = images
        self._bare: deque[Event] = deque()
        self._full: deque[Event] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def put(self, event: Event) -> None:
        with self._ready:
            self._full.append(event)
            if len(self._full) > self._images:
                self.dropped += 1
                self._bare.append(without_images(self._full.popleft()))
            self._ready.notify()

    def close(self) -> None:
        """Nothing more is delivered; `take` returns None."""
        with self._ready:
            self._closed = True
            self._ready.notify()

    def take(self) -> Event | None:
        """The oldest event, waiting for it; None once closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._closed or self._bare or self._full)
            return None if self._closed else (self._bare or self._full).popleft()

    @property
    def empty(self) -> bool:
        return not (self._bare or self._full)


class LiveStream:
    """Its own thread turns events into `.rrd` bytes on a tape; `write` only hands over."""

    def __init__(self) -> None:
        self.tape: Tape | None = None
        """Of the run that is shown; None before the first."""
        self.grown = Subscribers()
        """Told whenever there is more on the tape, or another tape."""
        self._mailbox: Mailbox | None = None
        self._failure: str | None = None

    @property
    def dropped(self) -> int:
        """Exposures of this run whose images the viewers miss, because this thread lagged."""
        return self._mailbox.dropped if self._mailbox is not None else 0

    def open(self, opened: Opened) -> None:
        """Begins another run, in place of the one before. OSError where the user's cache cannot be written."""
        self.close()
        self._failure = None
        tape, mailbox = self.tape, self._mailbox = Tape(), Mailbox()
        arguments = (Recorder(opened), mailbox, tape)
        threading.Thread(target=self._run, args=arguments, daemon=True, name="live stream").start()
        self.grown.notify()

    def write(self, event: Event) -> None:
        """Returns at once. Does nothing before `open`. RuntimeError, with the reason, where the thread has failed."""
        if self._failure:
            raise RuntimeError(self._failure)
        if self._mailbox is not None:
            self._mailbox.put(event)

    def close(self) -> None:
        """Ends the run for its readers; what is still on its way is lost."""
        mailbox, tape = self._mailbox, self.tape
        self._mailbox = self.tape = None
        if mailbox is not None and tape is not None:
            mailbox.close()
            tape.close()
            self.grown.notify()

    def _run(self, recorder: Recorder, mailbox: Mailbox, tape: Tape) -> None:
        try:
            with _Encoder(recorder) as encoder:
                blueprint.send(encoder.lasting, recorder.opened)
                encoder.send(recorder.opening())
                self._append(tape, encoder)
                while (event := mailbox.take()) is not None:
                    encoder.send(recorder.batch(event))
                    if mailbox.empty:  # in haste, several exposures share their chunks
                        self._append(tape, encoder)
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
        for stream in self._streams:
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
