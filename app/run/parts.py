"""Files and folders that are still being written: hidden names while they grow, and one writer at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from ispom.errors import InputError

PART, LOCK = ".part-", ".lock"


def part_of(path: Path) -> Path:
    """Where a file is while it grows."""
    return path.with_name(f"{PART}{path.name}")


def whole_of(part: Path) -> Path:
    """The name that a growing file gets when it is whole; other paths stay."""
    return part.with_name(part.name.removeprefix(PART))


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
        with suppress(OSError):  # a lock file that stays is nobody's
            place.unlink(missing_ok=True)
        lock.release()
