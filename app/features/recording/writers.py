"""The recordings that are being written: one of the run on the screen, and those that are still being closed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ispom.errors import InputError

from ...engine.events import Bookmark, Finished, Stepped
from ...session.current_run import CurrentRun
from .listing import recording_path
from .state import Recording
from .writer import RecordingWriter


class Writers:
    """Each writer holds its own run: another run may begin while its file is being closed."""

    def __init__(self, folder: Path, has_depth: Callable[[], bool]) -> None:
        """`has_depth`: whether the depth of stereo pairs is recorded now."""
        self.folder, self._has_depth = folder, has_depth
        self._open: RecordingWriter | None = None
        self._closing: list[RecordingWriter] = []

    @property
    def busy(self) -> bool:
        return self._open is not None or bool(self._closing)

    def start(self, name: str, run: CurrentRun) -> None:
        """Begins to record a run from its first frame on. InputError where a recording is open, the name is none, or
        the file cannot be written."""
        if self._open is not None:
            raise InputError(f"{self._open.path.name} is being recorded: stop it before the next one")
        try:
            path = recording_path(self.folder, name, run.opened.sequence.name)
            self._open = RecordingWriter(path, run.opened, run.history, self._has_depth)
        except OSError as fault:
            raise InputError(
                f"{self.folder} cannot be written ({fault.strerror}): free it or choose another"
            ) from fault

    def offer(self, event: Stepped) -> None:
        """The newest frame of the run that is being recorded."""
        if self._open is not None:
            self._open.offer(event)

    @property
    def recording(self) -> bool:
        """Whether new frames are being recorded."""
        return self._open is not None

    def stop(self, finished: Finished | None, bookmarks: tuple[Bookmark, ...] = ()) -> None:
        """The file is closed when all of the run so far, and its bookmarks, are written, which may take a while."""
        writer, self._open = self._open, None  # by the worker, or by whoever closes the session without it
        if writer is not None:
            self._closing.append(writer)
            writer.stop(finished, bookmarks)

    def info(self) -> Recording | None:
        """How it goes: the open recording's, else the oldest of those that are being closed."""
        writers = [*filter(None, [self._open]), *self._closing]
        return writers[0].info if writers else None

    def ended(self) -> list[RecordingWriter]:
        """Those whose files were closed since this was asked last."""
        found = [writer for writer in [self._open, *self._closing] if writer is not None and writer.done]
        self._closing = [writer for writer in self._closing if writer not in found]
        self._open = None if self._open in found else self._open
        return found

    def close(self, timeout_s: float) -> None:
        """Closes all files within about this time."""
        for writer in [*filter(None, [self._open]), *self._closing]:
            writer.close(timeout_s)
