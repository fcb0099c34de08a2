"""Where a run is shown: a live stream that never makes the worker wait.

    live = LiveStream()                      # once; live.url is what the Rerun viewer connects to, live.port its port
    live.open(opened)                        # for each run: same port, the viewer follows
    for event in events:                     # Stepped ..., and Finished at the end
        live.write(event)
    live.close()

A stream that starts in the middle of a run is given the earlier events first; where their images are not at hand,
`without_images(event)` is enough for trajectories, clouds, plots and text.
"""

from __future__ import annotations

import socket
import threading
from collections import deque
from collections.abc import Collection

import numpy as np
import rerun as rr

from ..run.events import Event, Opened, without_images
from . import blueprint
from .recorder import Batch, Columns, Recorder

APPLICATION = "ispom"
PICTURES_WAITING = 30
"""Images on their way to the viewers before the oldest is given up: a second of video."""
SERVER_MEMORY = "512MiB"
"""How much of the run a browser that comes late is given."""


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
