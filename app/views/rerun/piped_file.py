"""A file that Rerun writes through a pipe, so that it never waits for the disk.

Rerun's own file sink waits for ever after a failed write, in `flush` and in `disconnect`. A pipe that is always emptied
refuses nothing. Data that cannot be written are discarded here, and `failure` says so.
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
"""Whether pipes have names. Without them (Windows) Rerun writes the file itself."""
_PIECE_BYTES = 1 << 20


class PipedFile:
    """An `.rrd` file, and the path `target` to which Rerun writes."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where the file cannot be made."""
        self.path = path
        self.failure: OSError | None = None
        """The error that ended the file before its writer did. The file ends with a complete message then."""
        self.progress_s = time.monotonic()
        """Time of the last write to the disk."""
        self._thread: Thread | None = None
        self._changed = Condition()
        """Guards `_source` and `_storing`, and is notified of each change."""
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
        """Must be called when the writer has opened `target`, or never will. The file then ends when the writer closes
        it."""
        if self._thread is not None:
            os.close(self._sink)

    def flush(self, timeout_s: float) -> None:
        """Waits until all data of the writer so far are on the disk. TimeoutError where it does not answer."""
        with self._changed:
            if not self._changed.wait_for(self._is_idle, timeout_s):
                raise TimeoutError("the disk does not answer")

    def ended(self, timeout_s: float) -> bool:
        """Waits for the file's end after the writer has closed it, and returns whether it came."""
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
        """Returns the next bytes of the pipe. They count as being stored before they leave it, so that `flush` waits
        for them."""
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
        """Cuts the file after its last complete message, because readers refuse others."""
        with suppress(OSError):
            os.truncate(self.path, whole_bytes(self.path))


def _poll(pipe: int, timeout_ms: int | None) -> bool:
    """Waits until a pipe has data or its writer has closed it, with None for ever; returns whether that happened."""
    poll = select.poll()
    poll.register(pipe, select.POLLIN)
    return bool(poll.poll(timeout_ms))
