"""The folder in which numba keeps machine code, and whether all of it is there.

A folder per version of the sources, of numba, Python and processor. When everything is compiled, `mark_complete` lists
the files with their digests; a later start that finds another digest deletes the folder, and compiles again.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import shutil
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite.binding as llvm
import numba

from ispom.caches import cache_folder

log = logging.getLogger(__name__)
MARK = "complete.json"
USES_KERNELS = b"from ispom.kernels import"
_UNUSED_S = 90 * 24 * 3600.0


@cache
def folder() -> Path | None:
    """The folder for this version of the sources, or None where nothing can be written."""
    parent = cache_folder("kernels")
    return None if parent is None else parent / _version()


def is_complete() -> bool:
    """Whether the machine code of every kernel is there, undamaged. A damaged folder is deleted.

    True, too, where there is no folder: each process then compiles what it uses.
    """
    place = folder()
    if place is None:
        return True
    try:
        digests = json.loads((place / MARK).read_text())
        damaged = [name for name, digest in digests.items() if _digest(place / name) != digest]
    except FileNotFoundError as fault:
        if Path(fault.filename) == place / MARK:
            return False  # not yet
        damaged = [fault.filename]
    except (OSError, ValueError, AttributeError):
        damaged = [MARK]
    if damaged:
        log.warning("compiled code in %s is damaged (%s): deleted, it is compiled again", place, damaged[0])
        shutil.rmtree(place, ignore_errors=True)
        return False
    with suppress(OSError):
        os.utime(place)
    return True


def mark_complete() -> None:
    """Notes that every kernel is compiled, and deletes folders that no start has used for 90 days."""
    place = folder()
    if place is None:
        return
    with suppress(OSError):
        digests = {str(path.relative_to(place)): _digest(path) for path in sorted(place.rglob("*.nb?"))}
        part = place / f"{MARK}.{os.getpid()}"
        part.write_text(json.dumps(digests))
        os.replace(part, place / MARK)
        for other in place.parent.iterdir():
            if other != place and time.time() - other.stat().st_mtime > _UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)


def kept() -> int:
    """How many functions have machine code in the folder."""
    place = folder()
    return 0 if place is None else sum(1 for _ in place.rglob("*.nbi"))


def _version() -> str:
    """A digest of all files that use kernels and their place, numba, Python, and the processor."""
    made_for = [__file__, numba.__version__, platform.python_version(), llvm.get_host_cpu_name()]
    hashed = hashlib.blake2b(repr(made_for).encode(), digest_size=12)
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        content = path.read_bytes()
        if USES_KERNELS in content or path.name == "kernels.py":
            hashed.update(content)
    return hashed.hexdigest()


def _digest(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
