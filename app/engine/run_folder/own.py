"""Signatures of run.yaml. They show which files this program wrote on this machine for this user, by a key that never
leaves the machine."""

from __future__ import annotations

import hmac
import os
import secrets
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from ispom.caches import cache_folder

KEY, KEY_BYTES = "run_key", 32
MARK = "# Written on this machine: "


def signed(text: str) -> str:
    """Returns the text with a signature as its last line; unchanged where no key can be stored."""
    key = _key()
    return text if key is None else f"{text}{MARK}{_code(key, text)}\n"


def is_signed(text: str) -> bool:
    """Returns whether `signed` returned this text on this machine, and no character was changed since."""
    before, mark, code = text.rpartition(MARK)
    key = _key() if mark else None
    return key is not None and hmac.compare_digest(f"{_code(key, before)}\n".encode(), code.encode())


def _code(key: bytes, text: str) -> str:
    return hmac.new(key, text.encode(), "sha256").hexdigest()


def _key() -> bytes | None:
    """Returns this user's key, and makes it if there is none. None where it cannot be stored, or others could read
    it."""
    folder = cache_folder("runs")
    if folder is None:
        return None
    path = folder / KEY
    try:
        if not path.exists():
            _make(path)
        status = path.lstat()
        private = stat.S_ISREG(status.st_mode) and (os.name == "nt" or not status.st_mode & 0o077)
        key = path.read_bytes() if private else b""
    except OSError:
        return None
    return key if len(key) == KEY_BYTES else None


def _make(path: Path) -> None:
    """Makes the key file atomically, and never replaces the key that another process made meanwhile."""
    number, made = tempfile.mkstemp(dir=path.parent)  # readable for its owner alone
    try:
        with os.fdopen(number, "wb") as file:
            file.write(secrets.token_bytes(KEY_BYTES))
        try:
            os.link(made, path)
        except FileExistsError:
            return
        except OSError:  # a disk without links
            os.replace(made, path)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(made)
