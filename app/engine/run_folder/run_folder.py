"""The folder of a run. It is complete, or has a marker that says that it is not. A folder with anything else is never
changed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Self

from filelock import FileLock, Timeout

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.whole import PART, part_of, replace_whole
from ispom.methods import names

from ..outputs import is_signed, mark_text, signature

LOCK = ".lock"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Locks this file or folder against other writers. The lock of a killed process ends with it.

    InputError where somebody else is writing; OSError where the disk does not take the lock.
    """
    place = path / LOCK if path.is_dir() else path.with_name(f".{path.name}{LOCK}")
    lock = FileLock(place)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise InputError(f"{path} is being written by another run: wait for its end, or choose another name") from None
    try:
        yield
    finally:
        with suppress(OSError):  # a lock file that is not removed locks nothing
            place.unlink(missing_ok=True)
        lock.release()


def is_locked(path: Path) -> bool:
    """Whether somebody is writing this file, or into this folder. OSError as `locked`."""
    try:
        with locked(path):
            return False
    except InputError:
        return True


MARKER = "INCOMPLETE"
"""The file that marks a run as incomplete; its first line says why."""
RUN, RIG, TRUTH, METRICS = "run.yaml", "rig.yaml", "truth.tum", "metrics.json"
CORRECTED_RIG = "rig_corrected.yaml"
"""The rig as the methods corrected it; only where they did."""
NOTES = "notes.yaml"
"""A note, and bookmarks, of a person who looked at the run."""
THUMBNAIL = "thumbnail.jpg"
LANDMARKS, STEPS, DECISIONS, RECORDING = "landmarks.npz", "steps.csv", "decisions.csv", "run.rrd"
EVENTS = "events.csv"
JOURNAL = "poses.csv"
"""Of a run that goes on; see journal.py."""


def trajectory_file(method: str) -> str:
    return f"{method}.tum"


def segment_file(method: str, number: int | str) -> str:
    """Returns the name of the file with the poses of one segment, counted from 1. Only trajectories with several
    segments have such files."""
    return f"{method}_segment_{number}.tum"


class RunFolder:
    """The folder into which one process writes one run. Each file appears complete or not at all; the marker is removed
    last."""

    def __init__(self, path: Path, fresh: bool = True) -> None:
        """Claims a new or empty folder, or that of an incomplete run, whose files are removed.

        InputError, before anything is touched, where the folder holds a complete run or anything that is not of a
        run, where another process writes to it, or where it cannot be made.
        """
        self.path = path
        self._unwritten: dict[str, str] = {}
        self._claim = ExitStack()
        try:
            if fresh:
                path.mkdir(parents=True, exist_ok=True)
                _require_free(path)
            self._claim.enter_context(locked(path))
            if fresh:
                for entry in _require_free(path):
                    entry.unlink()
                self._mark("The run has not ended, or was killed.")
        except (OSError, ValueError) as error:
            self._claim.close()
            reason = error.strerror if isinstance(error, OSError) else error
            raise InputError(f"{path} cannot be created ({reason}): give another folder") from None
        except InputError:
            self._claim.close()
            raise

    @staticmethod
    def new(path: Path) -> RunFolder:
        """Returns a new folder of this name, with a number at its end if that exists. InputError as `__init__`."""
        exists(path.parent)  # or a link to nothing, in which nothing can be made
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            for number in count(1):
                candidate = path if number == 1 else path.with_name(f"{path.name}-{number}")
                with suppress(FileExistsError):
                    candidate.mkdir()
                    return RunFolder(candidate)
        except OSError as error:
            raise InputError(f"{path} cannot be created ({error.strerror}): give another folder") from None
        raise AssertionError("there are always more numbers")

    @staticmethod
    def reopened(path: Path) -> RunFolder:
        """Returns the folder of an incomplete run, unchanged. InputError where another process writes to it."""
        return RunFolder(path, fresh=False)

    @property
    def reason(self) -> str:
        """Why the run is not complete. OSError where that cannot be read."""
        return next(iter(mark_text(self.path / MARKER).splitlines()), "")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Lets others write here."""
        self._claim.close()

    def write(self, name: str, content: str | bytes) -> None:
        """Writes a file. If that fails, `problem` says so."""
        try:
            replace_whole(self.path / name, content)
        except OSError as error:
            self.missed(name, error)

    def missed(self, name: str, error: OSError) -> None:
        """Remembers that a file could not be written, or not to its end."""
        self._unwritten[name] = error.strerror or str(error)

    @property
    def problem(self) -> str | None:
        """Which files could not be written, in one sentence; None where all were."""
        if not self._unwritten:
            return None
        names, reasons = ", ".join(self._unwritten), ", ".join(dict.fromkeys(self._unwritten.values()))
        return f"{self.path / names} cannot be written ({reasons}): make room, or give another folder"

    def part(self, name: str) -> Path:
        """Returns the path of a file while it grows; `keep` gives it its final name."""
        return part_of(self.path / name)

    def keep(self, name: str) -> None:
        """Gives a grown file its name, if there is one."""
        if self.part(name).exists():
            os.replace(self.part(name), self.path / name)

    def failed(self, reason: str) -> None:
        """Writes into the marker why the run is not complete. If that fails, the marker is unchanged."""
        with suppress(OSError):
            self._mark(reason)

    def complete(self) -> None:
        (self.path / MARKER).unlink()

    def _mark(self, reason: str) -> None:
        signed = f"{signature('run')}, which removes this file when the run is complete."
        replace_whole(self.path / MARKER, f"{reason}\n{signed}\n")


def is_incomplete(path: Path) -> bool:
    """Returns whether `ispom run` wrote to this folder and did not finish. OSError where the marker cannot be read."""
    return is_signed(path / MARKER, "run")


def is_unfinished(path: Path) -> bool:
    """Returns whether this is the folder of a run that was killed or is still going on, so its files are not final.

    False for anything else, and for what cannot be read.
    """
    try:
        return is_incomplete(path) and any(entry.name.startswith((PART, JOURNAL)) for entry in path.iterdir())
    except (OSError, ValueError):
        return False


def ended_early(path: Path) -> str:
    """Returns the line about a run that was stopped, or killed and then repaired, with the number of its frames. Empty
    for other runs, for runs whose files are not final, and where the line cannot be read."""
    try:
        stopped = is_incomplete(path) and not is_unfinished(path) and (path / METRICS).exists()
        return next(iter(mark_text(path / MARKER).splitlines()), "") if stopped else ""
    except OSError:
        return ""


def _require_free(path: Path) -> list[Path]:
    """Returns the files of an earlier, incomplete run, without the lock. InputError where there is any other file."""
    present = [entry for entry in sorted(path.iterdir()) if entry.name != LOCK]
    if not present:
        return []
    if not is_incomplete(path):
        if (path / RUN).exists():
            raise InputError(f"{path} holds a complete run: give a new or empty folder, or remove it first")
        raise InputError(f"{path} is not empty (it holds {present[0].name}): give a new or empty folder")
    own = {MARKER, RUN, RIG, CORRECTED_RIG, TRUTH, METRICS, LANDMARKS, STEPS, DECISIONS, EVENTS, RECORDING, THUMBNAIL}
    own |= set(map(trajectory_file, names()))
    segments = [segment_file(method, "*") for method in names()]
    foreign = [
        entry
        for entry in present
        if not entry.is_file()
        or not (entry.name in own or entry.name.startswith(PART) or any(map(entry.match, segments)))
    ]
    if foreign:
        raise InputError(f"{path} holds more than an incomplete run ({foreign[0].name}): give a new or empty folder")
    return present
