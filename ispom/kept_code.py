"""Files of machine code: each carries a digest of its bytes; a damaged one is deleted and said to be.

Without a folder, nothing is kept.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

from ispom.caches import cache_folder

log = logging.getLogger(__name__)
SUFFIX = ".kernel"
_DIGEST_BYTES = 16
_UNUSED_S = 90 * 24 * 3600.0
T = TypeVar("T")


@cache
def folder() -> Path | None:
    """Where they are; None where there is no place for them."""
    if numba.config.CACHE_DIR:  # type: ignore[attr-defined]
        found = Path(numba.config.CACHE_DIR) / "ispom"  # type: ignore[attr-defined]
        with suppress(OSError):
            found.mkdir(parents=True, exist_ok=True)
            return found
    return cache_folder("kernels")


def made_for(codegen: Any) -> bytes:
    """What all machine code depends on: numba, Python, and the processor that numba compiles for."""
    return repr([numba.__version__, sys.version, repr(codegen.magic_tuple())]).encode()


def loaded(path: Path, rebuilt: Callable[[Any], T]) -> T | None:
    """What `rebuilt` makes of the values in a file; None where there is none, or a damaged one."""
    content = whole(path)
    if content is None:
        return None
    try:
        found = rebuilt(pickle.loads(content))  # noqa: S301 (only we write there)
    except Exception as fault:
        _delete(path, f"cannot be loaded ({type(fault).__name__}: {fault})")
        return None
    with suppress(OSError):
        os.utime(path)
    return found


def save(path: Path, pickled: bytes) -> None:
    """Whole or not at all: a folder that takes nothing is said to."""
    try:
        handle, part = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    except OSError as fault:
        log.warning("compiled code cannot be kept in %s: %s", path.parent, fault)
        return
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(digest(pickled) + pickled)
        os.replace(part, path)
    except OSError as fault:
        with suppress(OSError):
            os.unlink(part)
        log.warning("compiled code cannot be kept in %s: %s", path.parent, fault)


def whole(path: Path) -> bytes | None:
    """What a file holds, or None where there is none; one that is damaged is deleted, and said to be."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as fault:
        log.warning("compiled code %s cannot be read (%s): it is compiled again", path, fault)
        return None
    found, content = raw[:_DIGEST_BYTES], raw[_DIGEST_BYTES:]
    if content and digest(content) == found:
        return content
    _delete(path, "is damaged")
    return None


def remove_unused() -> None:
    """Deletes what no start has loaded for a quarter of a year: code of older sources and of other processors."""
    place = folder()
    for path in place.glob(f"*{SUFFIX}*") if place else ():
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _UNUSED_S:
                path.unlink()


def digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()


def _delete(path: Path, why: str) -> None:
    log.warning("compiled code %s %s: deleted, it is compiled again", path, why)
    with suppress(OSError):
        path.unlink()
