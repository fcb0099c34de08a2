"""Files that appear whole or not at all: they grow under a hidden name, and get their own when they are complete."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from ispom.errors import InputError

PART = ".part-"


def part_of(path: Path) -> Path:
    """Where a file is while it grows."""
    return path.with_name(f"{PART}{path.name}")


def whole_of(path: Path) -> Path:
    """The name that a growing file gets when it is complete; that of any other file is its own."""
    return path.with_name(path.name.removeprefix(PART))


def write_whole(path: Path, content: str | bytes) -> None:
    """Makes or replaces a file; InputError where the disk does not take it, the old file staying then."""
    if not path.name:
        raise InputError(f"{path} is a folder: give the name of a file to write")
    try:
        replace_whole(path, content)
    except OSError as error:
        raise InputError(
            f"{path} cannot be written ({error.strerror}): make room, or give another place to write to"
        ) from None


def replace_whole(path: Path, content: str | bytes) -> None:
    """As `write_whole`, but OSError where the disk does not take it. Names in a text that are no UTF-8 are escaped."""
    part = part_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content.encode(errors="backslashreplace") if isinstance(content, str) else content)
        os.replace(part, path)
    except OSError:
        with suppress(OSError):  # its folder is no folder, or was taken away: nothing was written then
            part.unlink(missing_ok=True)
        raise
