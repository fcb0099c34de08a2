"""Where a run is shown and kept: a file that misses nothing, and a live stream that never makes the worker wait.

    live = LiveStream()                      # once; live.url is what the Rerun viewer connects to, live.port its port
    live.open(opened)                        # for each run: same port, the viewer follows
    with FileRecording(path, opened) as file:
        for event in events:                 # Stepped ..., and Finished at the end
            live.write(event)
            file.write(event)
    live.close()

A file or live stream that starts in the middle of a run is given the earlier events first; where their images are not
at hand, `without_images(event)` is enough for trajectories, clouds, plots and text. `file.failure` says why a
recording stopped on its own (disk full): the run goes on, and what was written stays readable.
"""

from __future__ import annotations

import os
import shutil
import socket
import threading
from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
import rerun as rr

from ispom.errors import InputError
from ispom.types import StereoPair, VideoFrame

from ..run.playback import Opened, Stepped
from . import blueprint
from .recorder import Batch, Columns, Event, Recorder

APPLICATION = "ispom"
FLUSH_S = 5.0
"""Longest wait for the disk."""
FULL_BYTES = 1 << 20
"""With less free space than this, it was for lack of space that writing failed."""
FLUSH_EVERY = 10
"""Events between two flushes of a file: what a crash may lose."""
PICTURES_WAITING = 30
"""Images on their way to the viewers before the oldest is given up: a second of video."""
SERVER_MEMORY = "512MiB"
"""How much of the run a browser that comes late is given."""


class FileRecording:
    """One `.rrd` file. It is readable at any moment, also after a crash; `close` writes its index."""

    def __init__(self, path: Path, opened: Opened) -> None:
        """InputError where the file cannot be written."""
        self.path = Path(path)
        self.failure: str | None = None
        """Why the recording stopped on its own, one sentence; None while all is well."""
        self._recorder = Recorder(opened)
        self._since_flush, self._whole_bytes = 0, 0
        stream = rr.RecordingStream(
            APPLICATION, recording_id=self._recorder.recording_id, batcher_config=rr.ChunkBatcherConfig(flush_tick=2.0)
        )
        self._stream: rr.RecordingStream | None = stream
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            stream.save(self.path, default_blueprint=blueprint.blueprint(opened))
        except (OSError, RuntimeError) as error:
            raise InputError(f"{self.path} cannot be written ({error}): choose another folder to record to") from error
        self._guarded(lambda stream: send(stream, self._recorder.opening()))
        self._guarded(self._flush)

    @property
    def size_bytes(self) -> int:
        """On disk so far."""
        return self.path.stat().st_size if self.path.exists() else 0

    def write(self, event: Event) -> None:
        """Never raises because of the disk: see `failure`."""
        if self._stream is not None:
            batch = self._recorder.batch(event)
            self._guarded(lambda stream: send(stream, batch))
            self._since_flush += 1
            if self._since_flush >= FLUSH_EVERY:
                self._guarded(self._flush)
                self._since_flush = 0

    def close(self) -> None:
        """Ends the file properly. Calling it again does nothing."""
        self._guarded(self._flush)
        self._disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _guarded(self, action: Callable[[rr.RecordingStream], None]) -> None:
        if self._stream is None:
            return
        try:
            action(self._stream)
        except (OSError, RuntimeError, TimeoutError) as error:
            full = shutil.disk_usage(self.path.parent).free < FULL_BYTES
            why = "the disk is full: free some space" if full else f"of {error}: see to its folder"
            self.failure = f"{self.path} ends early because {why} and record again"
            self._disconnect()
            with suppress(OSError):  # readers refuse a file that ends within a message
                os.truncate(self.path, self._whole_bytes)

    def _flush(self, stream: rr.RecordingStream) -> None:
        stream.flush(timeout_sec=FLUSH_S)
        self._whole_bytes = self.size_bytes

    def _disconnect(self) -> None:
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None


class Mailbox:
    """Events on their way to a reader that may be slow; `put` never waits.

    It keeps at most `pictures` images: then the oldest events lose theirs. The rest of an event is what the history
    holds as well, and is delivered however late.
    """

    def __init__(self, pictures: int = PICTURES_WAITING) -> None:
        self.dropped = 0
        """Events that lost their images."""
        self._pictures = pictures
        self._bare: deque[Event] = deque()
        self._full: deque[Event] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def put(self, event: Event) -> None:
        with self._ready:
            self._full.append(event)
            if len(self._full) > self._pictures:
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


class LiveStream:
    """What browsers see. Its own thread turns events into entities and sends them; `write` only hands over."""

    def __init__(self) -> None:
        self.port = free_port()
        self.url = f"rerun+http://127.0.0.1:{self.port}/proxy"
        self._mailbox: Mailbox | None = None
        self._stream: rr.RecordingStream | None = None
        # The server outlives the runs, so that a viewer stays connected when another one opens.
        self._server = rr.RecordingStream(APPLICATION, send_properties=False)
        self._server.set_sinks(rr.GrpcServerSink("127.0.0.1", self.port, server_memory_limit=SERVER_MEMORY))

    @property
    def dropped(self) -> int:
        """Exposures of this run whose images the viewers miss, because they lagged."""
        return self._mailbox.dropped if self._mailbox else 0

    def open(self, opened: Opened) -> None:
        """Begins a new recording in the viewers, in place of the one before."""
        if self._mailbox:
            self._mailbox.close()
        recorder, self._mailbox = Recorder(opened), Mailbox()
        stream = self._stream = rr.RecordingStream(APPLICATION, recording_id=recorder.recording_id)
        arguments = (stream, self._mailbox, recorder)
        threading.Thread(target=self._run, args=arguments, daemon=True, name="live stream").start()

    def write(self, event: Event) -> None:
        """Returns at once, whatever the viewers do. Does nothing before `open`."""
        if self._mailbox:
            self._mailbox.put(event)

    def arrange(self, opened: Opened, hidden: Collection[str] = ()) -> None:
        """Lays the viewers out anew, without the hidden layers and methods (see blueprint.LAYERS)."""
        if self._stream:
            blueprint.send(self._stream, opened, hidden)

    def close(self) -> None:
        """Stops serving, without waiting for viewers; what is still on its way is lost."""
        if self._mailbox:
            self._mailbox.close()
        self._mailbox = self._stream = None
        threading.Thread(target=self._server.disconnect, daemon=True, name="live stream end").start()

    def _run(self, stream: rr.RecordingStream, mailbox: Mailbox, recorder: Recorder) -> None:
        stream.connect_grpc(self.url)
        blueprint.send(stream, recorder.opened)
        send(stream, recorder.opening())
        while (event := mailbox.take()) is not None:
            send(stream, recorder.batch(event))
        stream.disconnect()


def send(stream: rr.RecordingStream, batch: Batch) -> None:
    """Logs a batch at its instant, from this thread."""
    stream.set_time("exposure", sequence=batch.index)
    stream.set_time("time", duration=np.timedelta64(batch.since_start_ns, "ns"))
    for entry in batch.entries:
        if isinstance(entry, Columns):
            _send_columns(stream, entry)
        else:
            stream.log(entry.path, entry.value, static=entry.static)


def without_images(event: Event) -> Event:
    """The event with empty images: its pictures are not drawn, all else is."""
    if not isinstance(event, Stepped):
        return event
    time_ns, nothing = event.exposure.time_ns, np.zeros((0, 0), np.uint8)
    stereo = isinstance(event.exposure, StereoPair)
    return replace(event, exposure=StereoPair(time_ns, nothing, nothing) if stereo else VideoFrame(time_ns, nothing))


def free_port() -> int:
    """A port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _send_columns(stream: rr.RecordingStream, columns: Columns) -> None:
    trajectory = columns.trajectory
    times = [
        rr.TimeColumn("exposure", sequence=columns.indices),
        rr.TimeColumn("time", duration=(trajectory.times_ns - columns.first_ns).astype("timedelta64[ns]")),
    ]
    poses = rr.Transform3D.columns(translation=trajectory.translations, quaternion=trajectory.xyzw)
    stream.send_columns(columns.path, times, poses)
