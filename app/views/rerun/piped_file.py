"""A file that Rerun writes through a pipe: whatever the disk does, the writer is never made to wait.

Rerun's own file sink waits for ever once the disk refused a write, in `flush` as in `disconnect`. A pipe that is always
emptied refuses nothing; what the disk does not take is dropped here, and `failure` says so.
"""

from __future__ import annotations

import os
import select
import time
from contextlib import suppress
from io import FileIO
from pathlib import Path
from threading import Condition, Thread

from ispom.io.whole import create_file

from .rrd import whole_bytes
from .streams import pipe_begins, pipe_ends

PIPES = Path("/dev/fd").exists()
"""Without (Windows) Rerun writes the file itself."""
_PIECE_BYTES = 1 << 20


class PipedFile:
    """An `.rrd` file and the place that Rerun is to write to."""

    def __init__(self, path: Path) -> None:
        """OSError where the file cannot be made."""
        self.path = path
        self.failure: OSError | None = None
        """What ended the file before its writer did. It ends with a whole message then."""
        self.progress_s = time.monotonic()
        """When the disk last took something."""
        self._thread: Thread | None = None
        self._changed = Condition()
        """Guards the two below, and is notified of each change."""
        self._source: int | None = None
        """The pipe's end that is read; None without a pipe, and once the writer has closed it."""
        self._storing = False
        self.target = str(path)
        """What the writer opens for writing."""
        file = create_file(path)
        if not PIPES:
            file.close()  # Rerun opens it by its name
        else:
            self._source, self._sink = os.pipe()
            pipe_begins()
            self.target = f"/dev/fd/{self._sink}"
            self._thread = Thread(target=self._copy, args=(self._source, file), name="recording file", daemon=True)
            self._thread.start()

    def opened(self) -> None:
        """The writer has opened its place, or never will: the file ends when the writer closes it."""
        if self._thread is not None:
            os.close(self._sink)

    def flush(self, timeout_s: float) -> None:
        """Waits until the disk took what the writer has written so far. TimeoutError where it does not answer."""
        with self._changed:
            if not self._changed.wait_for(self._is_idle, timeout_s):
                raise TimeoutError("the disk does not answer")

    def ended(self, timeout_s: float) -> bool:
        """Waits for the file's end, once the writer has closed it; whether it came."""
        if self._thread is None:
            self._cut()
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _copy(self, source: int, file: FileIO) -> None:
        try:
            with os.fdopen(source, "rb", buffering=0) as pipe, file:
                while piece := self._next(pipe):
                    if self.failure is None:
                        self._store(file, memoryview(piece))
                self._change(None, storing=False)
        finally:
            pipe_ends()

    def _next(self, pipe: FileIO) -> bytes:
        """What comes through the pipe. It counts as being stored before it leaves the pipe: `flush` misses nothing."""
        self._change(pipe.fileno(), storing=False)
        _poll(pipe.fileno(), None)
        self._change(pipe.fileno(), storing=True)
        return pipe.read(_PIECE_BYTES)

    def _is_idle(self) -> bool:
        return not self._storing and (self._source is None or not _poll(self._source, 0))

    def _change(self, source: int | None, storing: bool) -> None:
        with self._changed:
            self._source, self._storing = source, storing
            self._changed.notify_all()

    def _store(self, file: FileIO, piece: memoryview) -> None:
        try:
            while piece:
                piece = piece[file.write(piece) :]
            self.progress_s = time.monotonic()
        except OSError as error:
            self._cut()
            self.failure = error

    def _cut(self) -> None:
        """Readers refuse a file that ends within a message."""
        with suppress(OSError):
            os.truncate(self.path, whole_bytes(self.path))


def _poll(pipe: int, timeout_ms: int | None) -> bool:
    """Waits until a pipe holds something or its writer has closed it, for ever with None; whether that came."""
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    return bool(poll.poll(timeout_ms))
