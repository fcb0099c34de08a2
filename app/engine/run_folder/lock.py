"""One writer at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from ispom.errors import InputError

LOCK = ".lock"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keeps others from writing this file, or into this folder. A killed process holds nothing.

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
        with suppress(OSError):  # a lock file that stays behind is nobody's
            place.unlink(missing_ok=True)
        lock.release()


def is_locked(path: Path) -> bool:
    """Whether somebody is writing this file, or into this folder. OSError as `locked`."""
    try:
        with locked(path):
            return False
    except InputError:
        return True
