"""Where things are kept from one start to the next, on machines whose home cannot be written to as well."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

import platformdirs


def cache_folder(name: str) -> Path | None:
    """A writable folder `name`: in the user's cache, else a private one below the system's for temporary files.

    None where neither can be had. Nobody else may write to it: code is loaded from there.
    """
    for parent in (_user_cache, _private_temporary):
        with suppress(OSError, RuntimeError):  # RuntimeError: the user has no home at all
            folder = parent() / name
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    return None


def _user_cache() -> Path:
    return platformdirs.user_cache_path("ispom", appauthor=False)


def _private_temporary() -> Path:
    """Made by this user for this user alone: a folder of that name that somebody else laid there is not taken."""
    if not hasattr(os, "getuid"):
        return Path(tempfile.gettempdir()) / "ispom"  # Windows: each user has a folder for temporary files
    folder = Path(tempfile.gettempdir()) / f"ispom-{os.getuid()}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise PermissionError(f"{folder} is not a private folder of this user")
    return folder
