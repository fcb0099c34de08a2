"""The recording of one run, written in a thread of its own: a slow disk stops nobody."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from threading import Thread

from ispom.errors import InputError

from ...engine.events import Bookmark, Finished, Opened, Stepped
from ...engine.history.feed import Feed
from ...engine.history.history import History
from ...views.rerun.file_recording import FileRecording
from ...views.rerun.streams import release_streams
from .companions import write_companions
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
