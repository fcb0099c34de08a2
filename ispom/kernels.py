"""`@kernel`: a function that numba compiles once, and that is kept as machine code from one start to the next.

Numba's own cache ends every start with a traceback where a file of it is damaged, fails where it finds no folder, and
does not see that a function which a kernel calls has changed. Here a file carries a digest of its bytes and is named
after all that it was made from; a damaged one is deleted and said to be; without a folder, nothing is kept.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite.binding import parse_bitcode
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numpy.typing import NDArray

from ispom.caches import cache_folder

NEWEST_KNOWN = 0, 68
"""Version of numba up to which `parts` is known to hold, from 0.61 on; with others parts are compiled as numba does by
itself, which takes longer."""
if numba.version_info.short <= NEWEST_KNOWN:
    from ispom import parts

log = logging.getLogger(__name__)
_DIGEST_BYTES = 16
_UNUSED_S = 90 * 24 * 3600.0
_SUFFIX = ".kernel"
_caches: dict[Dispatcher, KernelCache] = {}


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator as `numba.njit(**options)`; what is compiled is kept.

    A division by zero gives infinity, in all of them: what numba compiles for one it compiles anew for another with
    other options, and each check of a divisor takes its time.
    """
    options = {"error_model": "numpy"} | options

    def compiled(function: Callable[..., Any]) -> Dispatcher:
        dispatcher: Any = numba.njit(**options)(function)
        dispatcher._cache = _caches[dispatcher] = KernelCache(dispatcher.py_func)  # in place of `cache=True`
        return dispatcher

    return compiled


def part(function: Callable[..., Any]) -> Any:
    """A decorator of a function that only ever becomes part of kernels, and cannot be called from Python.

    It may read and fill arrays but makes none: references are not counted in it (a fifth of the time of small loops).
    Products may be rounded once with the sum that they go into (`contract`): the same on each run of one machine. A
    division by zero gives infinity.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "forceinline": True, "_nrt": False}
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    if numba.version_info.short <= NEWEST_KNOWN:
        options |= {"pipeline_class": parts.PartCompiler}
    return numba.njit(**options)(function)


def read_only(values: NDArray) -> NDArray:
    """A view of them, or a copy where they have gaps, for kernels that only read it.

    Numba compiles a kernel anew for arrays with gaps, and for those that may (not) be written to: a recording's images
    may not, and the first run over it would wait.
    """
    found = np.ascontiguousarray(values).view()
    found.flags.writeable = False
    return found


def kernels() -> list[Dispatcher]:
    """All kernels of the modules imported so far, but for those that only become part of others."""
    return [found for found in _caches if found.targetoptions.get("inline") != "always"]


def is_kept(found: Dispatcher) -> bool:
    """Whether machine code of the kernel, as its source is now and for this processor, is there and undamaged."""
    return any(_whole(path) is not None for path in _caches[found].files())


def kept_share() -> float:
    """How much of the machine code of all kernels is kept, 0..1, by the length of what it is made from."""
    folder = _folder()
    present = {name.rpartition("-")[0] for name in os.listdir(folder) if name.endswith(_SUFFIX)} if folder else set()
    lengths = {_caches[found]._name: len(found.py_func.__code__.co_code) for found in kernels()}
    return sum(lengths[name] for name in lengths if name in present) / max(sum(lengths.values()), 1)


def may_keep() -> bool:
    """Whether there is a folder to keep machine code in."""
    return _folder() is not None


def remove_unused() -> None:
    """Deletes what no start has loaded for a quarter of a year: code of older sources and of other processors."""
    folder = _folder()
    for path in folder.glob(f"*{_SUFFIX}*") if folder else ():
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _UNUSED_S:
                path.unlink()


class KernelCache(_Cache):
    """What numba asks for the machine code of one function."""

    def __init__(self, function: FunctionType) -> None:
        self._function, self._enabled = function, True
        _source(function.__code__.co_filename)  # as it is now: it may be edited while this process runs

    @property
    def cache_path(self) -> str | None:
        folder = _folder()
        return None if folder is None else str(folder)

    def files(self) -> list[Path]:
        """Of any signature."""
        folder = _folder()
        return [] if folder is None else sorted(folder.glob(f"{self._name}-*{_SUFFIX}"))

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        path = self._path(sig)
        if path is None or not self._enabled or (content := _whole(path)) is None:
            return None
        target_context.refresh()
        try:
            state = pickle.loads(content)  # noqa: S301 (only we write there)
            found = CompileResult._rebuild(target_context, *state)
            _let_module_go(found.library, *state[0])
        except Exception as fault:
            _delete(path, f"cannot be loaded ({type(fault).__name__}: {fault})")
            return None
        with suppress(OSError):
            os.utime(path)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        path = self._path(sig)
        if path is None or not self._enabled or data.library.has_dynamic_globals:
            return
        content = dumps(data._reduce())
        try:
            handle, part = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
        except OSError as fault:
            log.warning("compiled code cannot be kept in %s: %s", path.parent, fault)
            return
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_digest(content) + content)
            os.replace(part, path)
        except OSError as fault:
            with suppress(OSError):
                os.unlink(part)
            log.warning("compiled code cannot be kept in %s: %s", path.parent, fault)

    def enable(self) -> None:
        self._enabled = True

    def disable(self) -> None:
        self._enabled = False

    def flush(self) -> None:
        for path in self.files():
            path.unlink(missing_ok=True)

    def _path(self, sig: Any) -> Path | None:
        folder = _folder()
        return None if folder is None else folder / f"{self._name}-{_digest(str(sig).encode()).hex()}{_SUFFIX}"

    @cached_property
    def _name(self) -> str:
        """The function, and a digest of all that its machine code depends on but its signature."""
        made_from = [numba.__version__, sys.version, _processor()]
        own = _source(__file__), _source(str(Path(__file__).with_name("parts.py")))
        inputs = [repr(made_from).encode(), *own, *_sources(self._function, set())]
        return f"{self._function.__module__}.{self._function.__qualname__}-{_digest(b''.join(inputs)).hex()}"


def _sources(function: FunctionType, seen: set[FunctionType]) -> Iterator[bytes]:
    """The file of a function, the numbers it takes from its module, and the same of all kernels that it calls."""
    seen.add(function)
    yield _source(function.__code__.co_filename)
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, Dispatcher) and value.py_func not in seen:
            yield from _sources(value.py_func, seen)
        elif isinstance(value, np.ndarray):
            yield value.tobytes()
        elif isinstance(value, int | float | complex | str | tuple):
            yield f"{name} = {value!r}".encode()


def _let_module_go(library: Any, name: str, kind: str, code: tuple[bytes, bytes]) -> None:
    """Of code that is loaded, LLVM holds what it was made from, too: half a megabyte each.

    Only another kernel that calls this one and is compiled anew needs that: it is read again then.
    """
    library._shared_module = None
    library._get_module_for_linking = partial(parse_bitcode, code[1])


@cache
def _processor() -> str:
    return repr(cpu_target.target_context.codegen().magic_tuple())  # type: ignore[attr-defined]


@lru_cache
def _source(path: str) -> bytes:
    return _digest(Path(path).read_bytes())


@cache
def _folder() -> Path | None:
    if numba.config.CACHE_DIR:  # type: ignore[attr-defined]
        folder = Path(numba.config.CACHE_DIR) / "ispom"  # type: ignore[attr-defined]
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            return folder
    return cache_folder("kernels")


def _whole(path: Path) -> bytes | None:
    """What a file holds, or None where there is none; one that is damaged is deleted, and said to be."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as fault:
        log.warning("compiled code %s cannot be read (%s): it is compiled again", path, fault)
        return None
    digest, content = raw[:_DIGEST_BYTES], raw[_DIGEST_BYTES:]
    if content and _digest(content) == digest:
        return content
    _delete(path, "is damaged")
    return None


def _delete(path: Path, why: str) -> None:
    log.warning("compiled code %s %s: deleted, it is compiled again", path, why)
    with suppress(OSError):
        path.unlink()


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()
