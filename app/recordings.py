"""The recordings folder, and the one recording that is being written from the history."""

from __future__ import annotations

import re
import time
from pathlib import Path

from ispom.errors import InputError

from .playback import Finished, Opened, Stepped
from .state import Moment, RecordedFile, Recording

_PLAIN = re.compile(r"[\w][\w .()+-]{0,99}")


def recording_path(folder: Path, name: str, sequence: str) -> Path:
    """Where a recording of this name goes: never outside the folder, never over an existing file.

    An empty name is made up from the sequence's. InputError where the name is not a plain file name, or taken.
    """
    name = name.strip().removesuffix(".rrd")
    if not name:
        base = re.sub(r"[^\w]+", "-", sequence).strip("-") or "run"
        taken = (folder / f"{base}-{i}.rrd" for i in range(1, 10_000))
        return next(path for path in taken if not path.exists())
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


class Writer:
    """Writes the history into a file, from its first exposure on, a little at a time; images are read again."""

    def __init__(self, path: Path, opened: Opened) -> None:
        """OSError or InputError where the file cannot be made."""
        from .streams import FileRecording

        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self._sequence = path, opened.sequence
        self._file = FileRecording(path, opened)
        self._written = 0
        self._end: int | None = None
        self._fresh: Stepped | None = None

    @property
    def info(self) -> Recording:
        return Recording(self.path.name, self._file.size_bytes, self._written, self.stopping)

    @property
    def stopping(self) -> bool:
        return self._end is not None

    def stop(self, count: int) -> None:
        """No more than the first `count` exposures will be written."""
        self._end = count if self._end is None else min(count, self._end)

    def complete(self, history: list[Moment]) -> bool:
        """Whether all that there is to write is written."""
        return self._written >= min(len(history), self._end if self._end is not None else len(history))

    def offer(self, event: Stepped) -> None:
        """The newest event with its images, so that they need not be read again where its turn comes next."""
        self._fresh = event

    def write(self, history: list[Moment], seconds: float) -> None:
        """At least one exposure, where any is left, and more while time is left.

        Raises OSError where the file cannot take more, InputError where an image cannot be read again.
        """
        until = time.monotonic() + seconds
        while not self.complete(history):
            event, moment = self._fresh, history[self._written]
            if event is None or event.index != moment.index:
                event = moment.stepped(self._sequence[moment.index])
            self._file.write(event)
            if self._file.failure:
                raise InputError(self._file.failure)
            self._written += 1
            if time.monotonic() >= until:
                break

    def close(self, finished: Finished | None) -> None:
        """Ends the file, with the final trajectories where there are any. InputError where that cannot be written."""
        if finished is not None:
            self._file.write(finished)
        self._file.close()
        if self._file.failure:
            raise InputError(self._file.failure)
