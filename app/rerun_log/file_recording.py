"""Where a run is kept: a file that misses nothing.

    with FileRecording(path, opened) as file:
        for event in events:                 # Stepped ..., and Finished at the end
            file.write(event)

`file.failure` says why a recording stopped on its own (disk full): the run goes on, what was written stays readable.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self

import rerun as rr

from ispom.errors import InputError

from ..run.events import Event, Opened
from . import blueprint
from .recorder import Recorder
from .streams import APPLICATION, send

FLUSH_S = 5.0
"""Longest wait for the disk."""
FULL_BYTES = 1 << 20
"""With less free space than this, it was for lack of space that writing failed."""
FLUSH_EVERY = 10
"""Events between two flushes of a file: what a crash may lose."""


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
