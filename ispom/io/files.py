"""Opens files that the user names safely: only regular files, of bounded size, inside a root where one is set."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from io import BufferedReader
from pathlib import Path

from ispom.errors import InputError

MAX_BYTES = 64 << 20
"""Largest size of a text file: more than a day of poses at 10 Hz."""
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
Places = tuple[Path, ...] | None
"""Folders and files outside of which nothing is opened; None sets no bound."""
_BOUNDS: ContextVar[Places] = ContextVar("bounds", default=None)
_CONFINED: ContextVar[Places] = ContextVar("confined", default=None)


@contextmanager
def bounded(places: tuple[Path, ...] | None) -> Iterator[None]:
    """Forbids opening files outside of these folders and files in its context, links followed; None sets no bound."""
    resolved = None if places is None else tuple(Path(os.path.realpath(place)) for place in places)
    token = _BOUNDS.set(resolved)
    try:
        yield
    finally:
        _BOUNDS.reset(token)


@contextmanager
def confined(places: Places) -> Iterator[None]:
    """Does the same for paths that an untrusted file names; a `bounded` in its context does not lift it."""
    resolved = None if places is None else tuple(Path(os.path.realpath(place)) for place in places)
    token = _CONFINED.set(resolved)
    try:
        yield
    finally:
        _CONFINED.reset(token)


_READ: list[set[Path]] = []
"""The sets of all `noted` that go on."""


@contextmanager
def noted() -> Iterator[set[Path]]:
    """Collects the regular files that are opened in its context, by any thread, as the paths by which they were named:
    what a recording consists of."""
    found = set[Path]()
    _READ.append(found)
    try:
        yield found
    finally:
        _READ[:] = [each for each in _READ if each is not found]


def confinement() -> Places:
    """Returns the argument of the current `confined`, for work that is done later."""
    return _CONFINED.get()


def inside(path: Path) -> bool:
    """Returns whether the bounds, if any are set, allow the path."""
    set_bounds = [places for places in (_BOUNDS.get(), _CONFINED.get()) if places is not None]
    return all(is_below(path, places) for places in set_bounds)


def is_below(path: Path, places: tuple[Path, ...]) -> bool:
    """Returns whether the path is one of these places or below one, links followed."""
    try:
        real = Path(os.path.realpath(path))
        return any(real.is_relative_to(os.path.realpath(place)) for place in places)
    except (OSError, ValueError):
        return False


def expanded(path: str | Path) -> Path:
    """Returns the path with the home folder in place of ~; unchanged for a user who does not exist."""
    return Path(os.path.expanduser(path))


def exists(path: Path) -> bool:
    """Returns whether the path exists and may be opened.

    Raises InputError where that cannot be determined, and for a dangling link, which is likely a mistake.
    """
    if not inside(path):
        return False
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        if path.is_symlink():
            raise InputError(
                f"{path} is a link to {os.readlink(path)}, which is missing: restore or remove it"
            ) from None
        return False
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    return True


def is_folder(path: Path) -> bool:
    """Returns whether the path is a folder. Raises InputError as `exists`."""
    return exists(path) and path.is_dir()


def names(folder: Path) -> list[str]:
    """Returns the sorted contents of a folder. Raises InputError where it is none or cannot be read."""
    _require_inside(folder)
    try:
        return sorted(os.listdir(folder))
    except FileNotFoundError:
        raise _missing(folder) from None
    except (OSError, ValueError) as error:
        raise _unreadable(folder, error) from None


def require_file(path: Path) -> int:
    """Returns the size [bytes] of a regular file. Raises InputError where there is none, or a pipe, socket, device
    or folder."""
    _require_inside(path)
    try:
        status = path.stat()
    except FileNotFoundError:
        raise _missing(path) from None
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    if not stat.S_ISREG(status.st_mode):
        kind = _KINDS.get(stat.S_IFMT(status.st_mode), "no regular file")
        raise InputError(f"{path} is {kind}: give a regular file in its place")
    for found in _READ:
        found.add(path)
    return status.st_size


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Returns the content of a regular file. Raises InputError where it cannot be read or is longer than max_bytes."""
    size = require_file(path)
    content = read_head(path, max_bytes + 1) if size <= max_bytes else b""
    if max(size, len(content)) > max_bytes:
        raise InputError(
            f"{path} is larger than {max_bytes >> 10} kB, more than such a file holds: give the right file"
        )
    return content


def read_head(path: Path, count: int) -> bytes:
    """Returns the first `count` bytes of a regular file, or all it has. Raises InputError where it cannot be read."""
    with opened(path) as file:
        return file.read(count)


@contextmanager
def opened(path: Path) -> Iterator[BufferedReader]:
    """Opens a regular file for reading. Raises InputError where it is none, or cannot be read now or while it is
    open."""
    require_file(path)
    try:
        # Opened without blocking, and checked again: the file may have been replaced by a pipe since the first check.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(number, "rb") as file:
            if not stat.S_ISREG(os.fstat(number).st_mode):
                raise InputError(f"{path} is not a regular file: give a regular file in its place")
            yield file
    except OSError as error:
        raise _unreadable(path, error) from None


def sha256_of(path: Path) -> str:
    """Returns the SHA-256 of a regular file, as hexadecimal digits. Raises InputError where it cannot be read."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _require_inside(path: Path) -> None:
    confined_to = _CONFINED.get()
    if confined_to is not None and not is_below(path, confined_to):
        raise InputError(f"{path} is outside of {confined_to[0]}, whose files name it: give it on the command line")
    if not inside(path):
        raise InputError(f"{path} is outside of the folder that --root allows: give a path inside")


def _missing(path: Path) -> InputError:
    if path.is_symlink():
        return InputError(f"{path} is a link to {os.readlink(path)}, which is missing: restore or remove it")
    return InputError(f"{path} is missing: restore the file or correct the path")


def _unreadable(path: Path, error: OSError | ValueError) -> InputError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a valid path"
    return InputError(f"{path} cannot be read ({reason}): check the path and its permissions")
