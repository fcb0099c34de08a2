"""`@kernel`: a function that numba compiles once, and that is kept as machine code from one start to the next.

Numba's own cache ends every start with a traceback where a file of it is damaged, fails where it finds no folder, and
does not see that a function which a kernel calls has changed. Here a file carries a digest of its bytes and is named
after all that it was made from; a damaged one is deleted and said to be; without a folder, nothing is kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
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

from ispom import kept_code
from ispom.kept_code import SUFFIX, digest

NEWEST_KNOWN = 0, 68
"""Version of numba up to which `operators`, `parts` and `runtime` are known to hold, from 0.61 on; with others numba
does as it does by itself, which takes longer."""
if numba.version_info.short <= NEWEST_KNOWN:
    from ispom import operators, parts, runtime

    runtime.keep_runtime()
    operators.remember_types()
    parts.overloads_become_parts()
    parts.link_each_part_once()
_caches: dict[Dispatcher, KernelCache] = {}


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator as `numba.njit(**options)`; what is compiled is kept.

    A division by zero gives infinity, in all of them: what numba compiles for one it compiles anew for another with
    other options, and each check of a divisor takes its time.
    """
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, **_compiler("KernelCompiler")} | options

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
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, **_compiler("PartCompiler")}
    return numba.njit(**options)(function)


def _compiler(name: str) -> dict[str, Any]:
    """The option that has numba compile by one of `parts`."""
    return {"pipeline_class": getattr(parts, name)} if numba.version_info.short <= NEWEST_KNOWN else {}


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
    return any(kept_code.whole(path) is not None for path in _caches[found].files())


def kept_share() -> float:
    """How much of the machine code of all kernels is kept, 0..1, by what it takes to compile it.

    That is about the length of the kernel with all that it calls, also where others call it, too.
    """
    folder = kept_code.folder()
    present = {name.rpartition("-")[0] for name in os.listdir(folder) if name.endswith(SUFFIX)} if folder else set()
    lengths = {_caches[found]._name: _length(found.py_func) for found in kernels()}
    return sum(lengths[name] for name in lengths if name in present) / max(sum(lengths.values()), 1)


def _length(function: FunctionType) -> int:
    return sum(len(one.__code__.co_code) for one in _called(function, set()))


def may_keep() -> bool:
    """Whether there is a folder to keep machine code in."""
    return kept_code.folder() is not None


class KernelCache(_Cache):
    """What numba asks for the machine code of one function."""

    def __init__(self, function: FunctionType) -> None:
        self._function, self._enabled = function, True
        _source(function.__code__.co_filename)  # as it is now: it may be edited while this process runs

    @property
    def cache_path(self) -> str | None:
        folder = kept_code.folder()
        return None if folder is None else str(folder)

    def files(self) -> list[Path]:
        """Of any signature."""
        folder = kept_code.folder()
        return [] if folder is None else sorted(folder.glob(f"{self._name}-*{SUFFIX}"))

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        path = self._path(sig)
        if path is None or not self._enabled or not path.exists():
            return None
        target_context.refresh()

        def rebuilt(state: Any) -> CompileResult:
            found = CompileResult._rebuild(target_context, *state)
            _let_module_go(found.library, *state[0])
            return found

        return kept_code.loaded(path, rebuilt)

    def save_overload(self, sig: Any, data: Any) -> None:
        path = self._path(sig)
        if path is None or not self._enabled or data.library.has_dynamic_globals:
            return
        kept_code.save(path, dumps(data._reduce()))

    def enable(self) -> None:
        self._enabled = True

    def disable(self) -> None:
        self._enabled = False

    def flush(self) -> None:
        for path in self.files():
            path.unlink(missing_ok=True)

    def _path(self, sig: Any) -> Path | None:
        folder = kept_code.folder()
        return None if folder is None else folder / f"{self._name}-{digest(str(sig).encode()).hex()}{SUFFIX}"

    @cached_property
    def _name(self) -> str:
        """The function, and a digest of all that its machine code depends on but its signature."""
        own = _source(__file__), _source(str(Path(__file__).with_name("parts.py")))
        inputs = [_made_for(), *own, *_sources(self._function)]
        return f"{self._function.__module__}.{self._function.__qualname__}-{digest(b''.join(inputs)).hex()}"


def _called(function: FunctionType, seen: set[FunctionType]) -> Iterator[FunctionType]:
    """A function, and all kernels and parts that it calls."""
    seen.add(function)
    yield function
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, Dispatcher) and value.py_func not in seen:
            yield from _called(value.py_func, seen)


def _sources(function: FunctionType) -> Iterator[bytes]:
    """The file of a function, the numbers it takes from its module, and the same of all kernels that it calls."""
    for one in _called(function, set()):
        yield _source(one.__code__.co_filename)
        for name in one.__code__.co_names:
            value = one.__globals__.get(name)
            if isinstance(value, np.ndarray):
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
def _made_for() -> bytes:
    return kept_code.made_for(cpu_target.target_context.codegen())  # type: ignore[attr-defined]


@lru_cache
def _source(path: str) -> bytes:
    return digest(Path(path).read_bytes())
