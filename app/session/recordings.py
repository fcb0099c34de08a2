"""The recordings folder, and the one recording that is being written from the history."""

from __future__ import annotations

import logging
import re
from collections import deque
from pathlib import Path
from threading import Event, Thread

from ispom.errors import InputError, UnreadableImage

from ..rerun_log.file_recording import FileRecording
from ..run.events import Finished, Opened, Stepped, blank
from ..run.parts import part_of
from ..run.record import ExposureRecord
from .state import RecordedFile, Recording

log = logging.getLogger(__name__)
KEPT = 16
"""Exposures whose images wait in memory to be recorded."""
_PLAIN = re.compile(r"[\w][\w .()+-]{0,99}")


def recording_path(folder: Path, name: str, sequence: str) -> Path:
    """Where a recording of this name goes: never outside the folder, never over an existing file.

    An empty name is made up from the sequence's. InputError where the name is not a plain file name, or taken.
    """
    name = name.strip().removesuffix(".rrd")
    if not name:
        base = re.sub(r"[^\w]+", "-", sequence).strip("-") or "run"
        taken = (folder / f"{base}-{i}.rrd" for i in range(1, 10_000))
        return next(path for path in taken if not path.exists() and not part_of(path).exists())
    if not _PLAIN.fullmatch(name) or name.endswith("."):
        raise InputError(f"{name!r} is not a plain file name: use letters, digits, spaces and - _ . ( ) + only")
    path = folder / f"{name}.rrd"
    if path.exists():
        raise InputError(f"{path.name} exists already: give the recording another name")
    return path


def list_recordings(folder: Path) -> tuple[RecordedFile, ...]:
    """The finished recordings, newest first."""
    if not folder.is_dir():
        return ()
    files = sorted(folder.glob("**/*.rrd"), key=lambda path: -path.stat().st_mtime)
    return tuple(RecordedFile(path.relative_to(folder).as_posix(), path.stat().st_size) for path in files)


class RecordingWriter:
    """Writes a history into a file, from its first exposure on, in a thread of its own: a slow disk stops nobody."""

    def __init__(self, path: Path, opened: Opened, history: list[ExposureRecord]) -> None:
        """OSError or InputError where the file cannot be made."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self._sequence, self._history = path, opened.sequence, history
        self.failure: str | None = None
        """Why the recording is not whole, one sentence; None while all is well."""
        self._file = FileRecording(path, opened)
        self._written = 0
        self._end: int | None = None
        self._finished: Finished | None = None
        self._fresh: deque[Stepped] = deque(maxlen=KEPT)
        self._more = Event()
        self._hurry = False
        self._thread = Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def info(self) -> Recording:
        return Recording(self.path.name, self._file.size_bytes, self._written, self._end is not None)

    @property
    def done(self) -> bool:
        """Whether the file is closed."""
        return not self._thread.is_alive()

    def offer(self, event: Stepped) -> None:
        """The newest exposure of the history, with its images, so that they need not be read again."""
        self._fresh.append(event)
        self._more.set()

    def stop(self, finished: Finished | None) -> None:
        """Writes what the history holds by now and the final trajectories, where there are any; then closes."""
        if self._end is None:
            self._finished, self._end = finished, len(self._history)
            self._more.set()

    def close(self, timeout_s: float) -> None:
        """Closes the file within about this time, with what is written by then."""
        self.stop(None)
        self._thread.join(0.6 * timeout_s)
        self._hurry = True
        self._thread.join(0.4 * timeout_s)

    def _run(self) -> None:
        try:
            while not self._hurry:
                if self._written < (len(self._history) if self._end is None else self._end):
                    self._write(self._event(self._history[self._written]))
                    self._written += 1
                elif self._end is None:
                    self._more.wait(1.0)
                    self._more.clear()
                else:
                    break
            if self._finished is not None and not self._hurry:
                self._write(self._finished)
        except (InputError, OSError) as fault:
            self.failure = str(fault)
        except Exception as fault:
            log.exception("recording %s failed", self.path)
            self.failure = f"internal fault, please report it: {type(fault).__name__}: {fault}"
        self._file.close()
        self.failure = self.failure or self._file.failure

    def _write(self, event: Stepped | Finished) -> None:
        self._file.write(event)
        if self._file.failure:
            raise InputError(self._file.failure)

    def _event(self, record: ExposureRecord) -> Stepped:
        """With the images that are at hand, or read again."""
        fresh = next((event for event in tuple(self._fresh) if event.index == record.index), None)
        if fresh:
            return fresh
        try:
            return record.stepped(self._sequence[record.index])
        except UnreadableImage:  # it was left out of the run, too, or went missing since
            return record.stepped(blank(self._sequence, record.index))
