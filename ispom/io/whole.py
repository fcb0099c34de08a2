"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from ispom.errors import InputError


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes beside the place and renames; InputError where the disk does not take it, the old file staying then."""
    if not path.name:
        raise InputError(f"{path} is a folder: give the name of a file to write")
    part = path.with_name(f".part-{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(part, path)
    except OSError as error:
        _remove(part)
        raise InputError(
            f"{path} cannot be written ({error.strerror}): make room, or give another place to write to"
        ) from None


def _remove(part: Path) -> None:
    try:
        part.unlink(missing_ok=True)
    except OSError:  # its folder is no folder, or was taken away: nothing was written then
        return
