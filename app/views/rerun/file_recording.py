"""Records a run into a file, without loss.

    with FileRecording(path, opened) as file:
        for event in events:                 # Stepped ..., and Finished at the end
            file.write(event)

`file.failure` says why a recording stopped on its own (disk full): the run goes on, what was written stays readable.
"""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Thread
from typing import Self

import rerun as rr

from ispom.errors import InputError
from ispom.io.whole import part_of

from ...engine.events import Bookmark, Event, Opened
from ...engine.run_folder.run_folder import locked
from . import blueprint
from .piped_file import PIPES, PipedFile
from .recorder import Recorder
from .streams import APPLICATION, send

RESERVE_BYTES = 32 << 20
"""Free space of the disk below which a recording ends, because the run's results must still be written."""
FLUSH_EVERY, FLUSH_EVERY_S = 10, 0.5
"""Events and seconds between two flushes of a file. A crash loses at most these."""
WAIT_S = 0.5
"""Longest wait for the disk at a time, during which no signal is seen."""
CLOSE_S = 3.0
"""Longest wait for the disk when a recording is closed, in all."""
POLL_S = 0.05
STALLED_S = 10.0
"""Time without any progress of the disk after which the recording gives up."""


class FileRecording:
    """One `.rrd` file. While it grows it has a hidden name (`part_of`) and is readable at any time, even after a crash.
    `close` writes its index and gives it its final name."""

    def __init__(self, path: Path, opened: Opened, has_depth: Callable[[], bool] = lambda: False) -> None:
        """Raises InputError where the file cannot be written, or another process is writing it."""
        self.path = Path(path)
        self.failure: str | None = None
        """Why the recording stopped on its own, one sentence; None while all is well."""
        self._recorder = Recorder(opened, has_depth)
        self._since_flush, self._flushed_s = 0, time.monotonic()
        self._part = part_of(self.path)
        self._stack = ExitStack()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stack.enter_context(locked(self.path))
            if self._part.exists():
                raise InputError(f"{self.path} was not finished: `ispom repair` it first, or choose another name")
            self._file = PipedFile(self._part)
        except (OSError, InputError) as error:
            self._stack.close()
            if isinstance(error, InputError):
                raise
            raise InputError(f"{self.path} cannot be written ({error}): choose another folder to record to") from error
        self._stream = self._connected(opened)
        self._guarded(lambda stream: send(stream, self._recorder.opening()))
        self._guarded(self._flush)

    @property
    def size_bytes(self) -> int:
        """Returns the size on disk so far. It looks for both names, because another thread may rename the file."""
        for path in (self._part, self.path):
            with suppress(FileNotFoundError):
                return path.stat().st_size
        return 0

    def write(self, event: Event | Bookmark) -> None:
        """Writes an event. It never raises because of the disk: see `failure`."""
        if self._stream is not None:
            batch = self._recorder.batch(event)
            self._guarded(lambda stream: send(stream, batch))
            self._since_flush += 1
            if self._since_flush >= FLUSH_EVERY or time.monotonic() > self._flushed_s + FLUSH_EVERY_S:
                self._guarded(self._flush)

    def close(self, overdue: Callable[[], bool] = lambda: False) -> None:
        """Ends the file properly. Calling it again does nothing.

        It waits up to `CLOSE_S` for a disk that does not answer, or until `overdue`, which is called repeatedly,
        returns true.
        """
        self._end(overdue)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connected(self, opened: Opened) -> rr.RecordingStream:
        batching = rr.ChunkBatcherConfig(flush_tick=FLUSH_EVERY_S)
        stream = rr.RecordingStream(APPLICATION, recording_id=self._recorder.recording_id, batcher_config=batching)
        try:
            with blueprint.released(blueprint.blueprint(opened, is_alone=True)) as layout:
                stream.save(self._file.target, default_blueprint=layout)
        except (OSError, RuntimeError) as error:
            self._stack.close()
            raise InputError(f"{self.path} cannot be written ({error}): choose another folder to record to") from error
        finally:
            self._file.opened()
        return stream

    def _guarded(self, action: Callable[[rr.RecordingStream], None]) -> None:
        if self._stream is None:
            return
        try:
            action(self._stream)
        except (OSError, RuntimeError, TimeoutError) as error:
            if not PIPES or time.monotonic() > self._file.progress_s + STALLED_S:
                self._fail(f"of {error}: see to its folder")
        if self._file.failure is not None:
            self._fail(_because(self._file.failure))

    def _flush(self, stream: rr.RecordingStream) -> None:
        self._since_flush, self._flushed_s = 0, time.monotonic()
        stream.flush(timeout_sec=WAIT_S)
        self._file.flush(max(0.0, self._flushed_s + WAIT_S - time.monotonic()))
        if shutil.disk_usage(self._part.parent).free < RESERVE_BYTES:
            self._fail(_FULL)

    def _fail(self, why: str) -> None:
        self.failure = self.failure or f"{self.path} ends early because {why} and record again"
        self._end()

    def _end(self, overdue: Callable[[], bool] = lambda: False) -> None:
        """Closes the stream, without waiting long for a disk that does not answer, and gives the file its name."""
        if self._stream is None:
            return
        closing = Thread(target=self._stream.disconnect, name="recording end", daemon=True)
        self._stream = None
        closing.start()
        if not self._ended(closing, overdue):
            self.failure = (
                self.failure or f"{self.path} has no index because the disk does not answer: see to its folder"
            )
        elif self._file.failure is not None:
            self._fail(_because(self._file.failure))
        try:
            os.replace(self._part, self.path)
        except OSError as error:
            self.failure = self.failure or f"{self._part} cannot be renamed ({error.strerror}): see to its folder"
        self._stack.close()

    def _ended(self, closing: Thread, overdue: Callable[[], bool]) -> bool:
        """Waits until all is on the disk, and returns whether that happened."""
        until = time.monotonic() + CLOSE_S
        while True:
            closing.join(POLL_S)
            if not closing.is_alive() and self._file.ended(POLL_S):
                return True
            if time.monotonic() > until or overdue():
                return False


_FULL = "the disk is full: free some space"


def _because(error: OSError) -> str:
    return _FULL if error.errno in (errno.ENOSPC, errno.EDQUOT) else f"of {error}: see to its folder"
