"""The folder in which numba keeps machine code, and whether what is needed is there.

A folder per version of the sources, of numba, Python and processor. When kernels are compiled, `mark_complete` lists
them, and the files with their digests; a later start that finds another digest deletes the folder, and compiles again.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import shutil
import time
from collections.abc import Iterable
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


def missing(kernels: Iterable[str]) -> frozenset[str]:
    """Which of these kernels are not known to be there, undamaged. A damaged folder is deleted.

    None where there is no folder: each process then compiles what it uses.
    """
    place = folder()
    if place is None:
        return frozenset()
    try:
        mark = json.loads((place / MARK).read_text())
        known, digests = frozenset[str](mark["kernels"]), dict[str, str](mark["files"])
        damaged = [name for name, digest in digests.items() if _digest(place / name) != digest]
    except FileNotFoundError as fault:
        if Path(fault.filename) == place / MARK:
            return frozenset(kernels)  # not yet
        known, damaged = frozenset(), [fault.filename]
    except (OSError, ValueError, AttributeError, TypeError, KeyError):
        known, damaged = frozenset(), [MARK]
    if damaged:
        log.warning("compiled code in %s is damaged (%s): deleted, it is compiled again", place, damaged[0])
        shutil.rmtree(place, ignore_errors=True)
        return frozenset(kernels)
    with suppress(OSError):
        os.utime(place)
    return frozenset(kernels) - known


def mark_complete(kernels: Iterable[str]) -> None:
    """Notes that these kernels are compiled, too, and deletes folders that no start has used for 90 days."""
    place = folder()
    if place is None:
        return
    with suppress(OSError):
        known = set(kernels)
        with suppress(OSError, ValueError, TypeError, KeyError):
            known.update(json.loads((place / MARK).read_text())["kernels"])
        digests = {str(path.relative_to(place)): _digest(path) for path in sorted(place.rglob("*.nb?"))}
        part = place / f"{MARK}.{os.getpid()}"
        part.write_text(json.dumps({"kernels": sorted(known), "files": digests}))
        os.replace(part, place / MARK)
        for other in place.parent.iterdir():
            if other != place and time.time() - other.stat().st_mtime > _UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)


def kept(kernels: Iterable[str]) -> frozenset[str]:
    """Those of these kernels that have machine code in the folder, whether marked or not: one that a start compiled
    before it was interrupted, for example."""
    place = folder()
    if place is None:
        return frozenset()
    # Numba names them `kernels.reduce_points-104.py311.nbi`, in the folder `window_` and a digest.
    files = {(path.parent.name.rpartition("_")[0], path.name.rsplit("-", 1)[0]) for path in place.rglob("*.nbi")}
    return frozenset(name for name in kernels if _place(name) in files)


def _place(kernel: str) -> tuple[str, str]:
    """Of `solvers.window.kernels.reduce_points`: the folder of its module, and its name in numba's file."""
    package, module, function = f"ispom.{kernel}".rsplit(".", 2)
    return package.rsplit(".", 1)[-1], f"{module}.{function}"


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
