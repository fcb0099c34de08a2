"""Atomic writing of files: a file is written under a hidden name, and renamed when it is complete."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from contextlib import suppress
from io import FileIO
from pathlib import Path

from ispom.errors import InputError

PART = ".part-"
WRITING = os.O_WRONLY | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
WRITING |= getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Flags that create a missing file, and do not follow a link."""


def part_of(path: Path) -> Path:
    """Returns the name of a file while it is written."""
    return path.with_name(f"{PART}{path.name}")


def whole_of(path: Path) -> Path:
    """Returns the final name of a file that is being written; any other path unchanged."""
    return path.with_name(path.name.removeprefix(PART))


def create_file(path: Path) -> FileIO:
    """Opens a new, empty file for writing, in place of any file of that name. Raises OSError where that fails.

    A link is replaced, never followed: an untrusted folder may contain links to the user's own files.
    """
    path.unlink(missing_ok=True)
    return FileIO(os.open(path, os.O_EXCL | WRITING, 0o666), "wb")


def append_to_file(path: Path) -> FileIO:
    """Opens a file for appending, as for a log, and creates it where it is missing. Raises InputError where it cannot
    be opened, or is a link."""
    try:
        if path.is_symlink():  # Windows has no O_NOFOLLOW
            raise OSError(errno.ELOOP, "it is a link")
        return FileIO(os.open(path, os.O_APPEND | WRITING, 0o666), "ab")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): give another file") from None


def require_no_links(folder: Path, path: Path) -> None:
    """Raises InputError where a folder between `folder` and `path` is a link, through which a file would be written
    elsewhere."""
    for parent in path.parents:
        if parent == folder or folder not in parent.parents:
            return
        if parent.is_symlink():
            raise InputError(f"{parent} is a link to another folder: remove it, or give another place to write to")


def write_whole(path: Path, content: str | bytes) -> None:
    """Creates or replaces a file. Raises InputError where that fails, and keeps the old file then."""
    if not path.name:
        raise InputError(f"{path} is a folder: give the name of a file to write")
    try:
        replace_whole(path, content)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): make room, or give another place to write to"
        ) from None


def replace_whole(path: Path, content: str | bytes) -> None:
    """Writes as `write_whole`, but raises OSError where the disk is full or read-only; escapes characters that are not
    UTF-8."""
    _replace(path, [content])


def write_parts(path: Path, parts: Iterable[str | bytes]) -> None:
    """Writes as `write_whole`, one part after the other, so that only one is in memory."""
    try:
        _replace(path, parts)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): make room, or give another place to write to"
        ) from None


def _replace(path: Path, parts: Iterable[str | bytes]) -> None:
    part = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with create_file(part) as file:
            for content in parts:
                left = memoryview(content.encode(errors="backslashreplace") if isinstance(content, str) else content)
                while left:
                    left = left[file.write(left) :]
        os.replace(part, path)
    except OSError:
        with suppress(OSError):  # the folder is missing, so that nothing was written
            part.unlink(missing_ok=True)
        raise
