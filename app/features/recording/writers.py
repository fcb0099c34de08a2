"""The recordings that are being written: one of the run on the screen, and those that are still being closed."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from threading import Thread

from ispom.errors import InputError

from ...engine.events import Bookmark, Finished, Opened, Stepped
from ...engine.history.feed import Feed
from ...engine.history.history import History
from ...session.current_run import CurrentRun
from ...views.rerun.file_recording import FileRecording
from ...views.rerun.streams import release_streams
from .listing import recording_path, write_companions
from .state import Recording

log = logging.getLogger(__name__)


class RecordingWriter:
    """Writes a run into a file from its first frame on, whatever becomes of the session meanwhile."""

    def __init__(self, path: Path, opened: Opened, history: History, has_depth: Callable[[], bool]) -> None:
        """`history` is that of the run which `opened` began. OSError or InputError where the file cannot be made."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self.failure: str | None = None
        """Why the recording is not whole, one sentence; None while all is well."""
        self._opened = opened
        self._file = FileRecording(path, opened, has_depth)
        self._feed = Feed(opened, history, rereads=True)
        self._bookmarks: tuple[Bookmark, ...] = ()
        self._thread = Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def info(self) -> Recording:
        return Recording(self.path.name, self._file.size_bytes, self._feed.position, self._feed.ending)

    @property
    def done(self) -> bool:
        """Whether the file is closed."""
        return not self._thread.is_alive()

    def offer(self, event: Stepped) -> None:
        """The newest frame of the history, with its images, so that they need not be read again."""
        self._feed.offer(event)

    def stop(self, finished: Finished | None, bookmarks: tuple[Bookmark, ...] = ()) -> None:
        """Writes what the history holds by now, the final trajectories, where there are any, and the bookmarks; then
        closes."""
        self._bookmarks = bookmarks or self._bookmarks
        self._feed.finish(finished, ends=True)

    def close(self, timeout_s: float) -> None:
        """Closes the file within about this time. What is not written by then is given up, except for the final
        trajectories."""
        self.stop(self._feed.finished)
        self._thread.join(0.5 * timeout_s)
        self._feed.skip()
        self._thread.join(0.5 * timeout_s)

    def _run(self) -> None:
        try:
            while (event := self._feed.take()) is not None:
                self._file.write(event)
                if self._file.failure:
                    break
            for bookmark in self._bookmarks:
                self._file.write(bookmark)
        except (InputError, OSError) as fault:
            self.failure = str(fault)
        except Exception as fault:
            log.exception("recording %s failed", self.path)
            self.failure = f"internal fault, please report it: {type(fault).__name__}: {fault}"
        self._file.close()
        release_streams()
        self.failure = self.failure or self._file.failure
        if self.path.exists():
            write_companions(self.path, self._opened, self._feed.position, self._bookmarks)


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
        """Those whose files were closed since the last call."""
        found = [writer for writer in [self._open, *self._closing] if writer is not None and writer.done]
        self._closing = [writer for writer in self._closing if writer not in found]
        self._open = None if self._open in found else self._open
        return found

    def close(self, timeout_s: float) -> None:
        """Closes all files within about this time."""
        for writer in [*filter(None, [self._open]), *self._closing]:
            writer.close(timeout_s)
