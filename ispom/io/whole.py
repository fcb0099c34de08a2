"""Files that appear whole or not at all: they grow under a hidden name, and get their own when they are complete."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from io import FileIO
from pathlib import Path

from ispom.errors import InputError

PART = ".part-"
WRITING = os.O_WRONLY | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
WRITING |= getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""How a file is opened that is made where it is missing, and never through a link."""


def part_of(path: Path) -> Path:
    """Returns the name of a file while it is written."""
    return path.with_name(f"{PART}{path.name}")


def whole_of(path: Path) -> Path:
    """Returns the name that a growing file gets when it is complete; that of any other file is its own."""
    return path.with_name(path.name.removeprefix(PART))


def create_file(path: Path) -> FileIO:
    """Returns a new, empty file to write to, in place of any file there. Raises OSError where it cannot be made.

    A link is replaced, never followed: a folder from others may hold links to the user's own files.
    """
    path.unlink(missing_ok=True)
    return FileIO(os.open(path, os.O_EXCL | WRITING, 0o666), "wb")


def append_to_file(path: Path) -> FileIO:
    """Returns a file, made where it is missing, to write to after what it has: a log. Raises InputError where it cannot
    be opened, or is a link."""
    try:
        if path.is_symlink():  # Windows has no O_NOFOLLOW
            raise OSError(errno.ELOOP, "it is a link")
        return FileIO(os.open(path, os.O_APPEND | WRITING, 0o666), "ab")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): give another file") from None


def require_no_links(folder: Path, path: Path) -> None:
    """Raises InputError where a folder between `folder` and `path` is a link: a file would be written elsewhere."""
    for parent in path.parents:
        if parent == folder or folder not in parent.parents:
            return
        if parent.is_symlink():
            raise InputError(f"{parent} is a link to another folder: remove it, or give another place to write to")


def write_whole(path: Path, content: str | bytes) -> None:
    """Makes or replaces a file. Raises InputError where the disk does not take it, the old file staying then."""
    if not path.name:
        raise InputError(f"{path} is a folder: give the name of a file to write")
    try:
        replace_whole(path, content)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): make room, or give another place to write to"
        ) from None


def replace_whole(path: Path, content: str | bytes) -> None:
    """Writes as `write_whole`, but raises OSError where the disk is full or read-only; escapes names that are no
    UTF-8."""
    part = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        left = memoryview(content.encode(errors="backslashreplace") if isinstance(content, str) else content)
        with create_file(part) as file:
            while left:
                left = left[file.write(left) :]
        os.replace(part, path)
    except OSError:
        with suppress(OSError):  # its folder is no folder, or was taken away: nothing was written then
            part.unlink(missing_ok=True)
        raise
