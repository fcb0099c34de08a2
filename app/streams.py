"""Where batches go: a file that misses nothing, and a live stream that never makes the worker wait.

    recorder = Recorder(opened)                          # share one, and images are encoded once
    live = LiveStream()                                  # live.url: what the Rerun viewer connects to
    live.open(opened, recorder)                          # again for another run: same port, the viewer follows
    file = FileRecording(path, opened, recorder)         # at any time: it begins with what is known so far
    for event in events: live.write(event); file.write(event)        # Stepped and Finished
    file.close(); live.close()

Headless, `with FileRecording(path, opened) as file: file.write(event)` is all. `file.failure` says why a recording
stopped on its own (disk full): the run goes on, and what was written stays readable.
"""

from __future__ import annotations

import socket
import threading
from collections import deque
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Self

import numpy as np
import rerun as rr

from ispom.errors import InputError

from . import blueprint
from .playback import Opened
from .recorder import Batch, Columns, Entry, Event, Recorder

APPLICATION = "ispom"
FLUSH_S = 5.0
"""Longest wait for a disk or a viewer."""
FLUSH_EVERY = 10
"""Batches between two flushes of a file: what a crash may lose."""
SERVER_MEMORY = "384MiB"
"""What a browser that comes late can be given again."""
Stamped = tuple[Batch, Entry | Columns]


def send(stream: rr.RecordingStream, items: Collection[Stamped]) -> None:
    """Logs entries, each at the instant of its batch, from this thread."""
    now = None
    for batch, entry in items:
        if isinstance(entry, Columns):
            _send_columns(stream, entry)
            continue
        if batch is not now:
            now = batch
            stream.set_time("exposure", sequence=batch.index)
            stream.set_time("time", duration=np.timedelta64(batch.since_start_ns, "ns"))
        stream.log(entry.path, entry.value, static=entry.static)


def stamped(batch: Batch) -> list[Stamped]:
    return [(batch, entry) for entry in batch.entries]


class FileRecording:
    """One `.rrd` file. It is readable at any moment, also after a crash; `close` writes its index."""

    def __init__(self, path: Path, opened: Opened, recorder: Recorder | None = None) -> None:
        """InputError where the file cannot be written."""
        self.path = Path(path)
        self.failure: str | None = None
        """Why the recording stopped on its own, one sentence; None while all is well."""
        self._recorder = recorder or Recorder(opened)
        stream = rr.RecordingStream(APPLICATION, recording_id=self._recorder.recording_id)
        self._stream: rr.RecordingStream | None = stream
        self._writes = 0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            stream.save(self.path, default_blueprint=blueprint.blueprint(opened))
        except (OSError, RuntimeError) as error:
            raise InputError(f"{self.path} cannot be written ({error}): choose another folder to record to") from error
        self._write(self._recorder.opening())
        self._write(self._recorder.so_far())

    @property
    def size_bytes(self) -> int:
        """On disk so far."""
        try:
            return self.path.stat().st_size
        except OSError:
            return 0

    def write(self, event: Event) -> None:
        """Never raises because of the disk: see `failure`."""
        self._write(self._recorder.batch(event))

    def close(self) -> None:
        """Ends the file properly. Calling it again does nothing."""
        self._guarded(lambda stream: stream.flush(timeout_sec=FLUSH_S))
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, batch: Batch) -> None:
        self._writes += 1
        self._guarded(lambda stream: send(stream, stamped(batch)))
        if self._writes % FLUSH_EVERY == 0:
            self._guarded(lambda stream: stream.flush(timeout_sec=FLUSH_S))

    def _guarded(self, action: Callable[[rr.RecordingStream], None]) -> None:
        if self._stream is None:
            return
        try:
            action(self._stream)
        except Exception as error:
            self.failure = f"{self.path} could not be written on ({error}): free some space and record again"
            self._stream.disconnect()
            self._stream = None


class Mailbox:
    """Batches on their way to a reader that may be slow: bounded, and `put` never waits.

    Full, it gives up the oldest batch, but what that said last about an entity is kept and delivered first; only what
    may be missed (pictures) is lost. So it holds at most `capacity` batches and one value per entity.
    """

    def __init__(self, capacity: int) -> None:
        self.dropped = 0
        """Batches that lost their pictures."""
        self._capacity = capacity
        self._batches: deque[Batch] = deque()
        self._kept: dict[tuple[str, type], Stamped] = {}
        self._ready = threading.Condition()
        self._closed = False

    def put(self, batch: Batch) -> None:
        with self._ready:
            self._batches.append(batch)
            if len(self._batches) > self._capacity:
                self.dropped += 1
                for oldest, entry in stamped(self._batches.popleft()):
                    if not entry.droppable:
                        self._kept[entry.path, type(getattr(entry, "value", entry))] = (oldest, entry)
            self._ready.notify()

    def close(self) -> None:
        """No more is delivered; `take` returns None."""
        with self._ready:
            self._closed = True
            self._ready.notify()

    def take(self) -> list[Stamped] | None:
        """What is next, waiting for it; None once closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._closed or self._kept or self._batches)
            if self._closed:
                return None
            kept, self._kept = list(self._kept.values()), {}
            return kept or stamped(self._batches.popleft())


class LiveStream:
    """What browsers see. A thread of its own sends; the worker only fills the mailbox."""

    def __init__(self, capacity: int = 60) -> None:
        self.port = free_port()
        self.url = f"rerun+http://127.0.0.1:{self.port}/proxy"
        self._capacity = capacity
        self._mailbox = Mailbox(capacity)
        self._recorder: Recorder | None = None
        self._stream: rr.RecordingStream | None = None
        # The server outlives the runs, so that a viewer stays connected when another run opens.
        self._server = rr.RecordingStream(APPLICATION, send_properties=False)
        self._server.set_sinks(rr.GrpcServerSink("127.0.0.1", self.port, server_memory_limit=SERVER_MEMORY))

    @property
    def dropped(self) -> int:
        """Batches of this run that lost their pictures because the viewer lagged."""
        return self._mailbox.dropped

    def open(self, opened: Opened, recorder: Recorder | None = None) -> None:
        """Begins a new recording in the viewer, in place of the one before."""
        self._mailbox.close()
        self._recorder = recorder or Recorder(opened)
        self._mailbox = Mailbox(self._capacity)
        self._mailbox.put(self._recorder.opening())
        self._mailbox.put(self._recorder.so_far())
        stream = self._stream = rr.RecordingStream(APPLICATION, recording_id=self._recorder.recording_id)
        threading.Thread(target=self._run, args=(stream, self._mailbox, opened), daemon=True, name="live").start()

    def write(self, event: Event) -> None:
        """Returns at once, whatever the viewers do. Nothing happens before `open`."""
        if self._recorder is not None:
            self._mailbox.put(self._recorder.batch(event))

    def arrange(self, opened: Opened, hidden: Collection[str] = ()) -> None:
        """Lays the viewer out anew, without the hidden layers and methods (see blueprint.LAYERS)."""
        if self._stream is not None:
            blueprint.send(self._stream, opened, hidden)

    def close(self) -> None:
        """Stops serving; what is still on its way is lost."""
        self._mailbox.close()
        self._recorder = None
        threading.Thread(target=self._server.disconnect, daemon=True).start()

    def _run(self, stream: rr.RecordingStream, mailbox: Mailbox, opened: Opened) -> None:
        stream.connect_grpc(self.url, default_blueprint=blueprint.blueprint(opened))
        blueprint.send(stream, opened)
        while (items := mailbox.take()) is not None:
            send(stream, items)
        stream.disconnect()


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
