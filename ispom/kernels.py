"""`@kernel` and `@part`: functions that numba compiles, the same way in the whole package.

Numba's own cache keeps the machine code of a kernel from one start to the next. It looks at the kernel's file only, not
at the files of the functions that the kernel calls, so the code lies in a folder whose name is a digest of all sources.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ispom import compiled_code

_kernels: list[Any] = []
if not numba.config.CACHE_DIR and (_folder := compiled_code.folder()):  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_folder)  # type: ignore[attr-defined]


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator as `numba.njit(**options)`. A division by zero gives infinity, as in numpy.

    The machine code is kept where there is a folder for it.
    """
    keep = bool(numba.config.CACHE_DIR)  # type: ignore[attr-defined]

    def compiled(function: Callable[..., Any]) -> Any:
        own = {"error_model": "numpy", "cache": keep, "no_cfunc_wrapper": True}  # nothing calls a kernel from C
        kernel_function = numba.njit(**own | options)(function)
        _kernels.append(kernel_function)
        return kernel_function

    return compiled


def part(function: Callable[..., Any]) -> Any:
    """A decorator of a function that only kernels call.

    A product may be rounded once with the sum that it goes into (`contract`): the same on each run of one machine.

    Numba counts the references to a part's arrays in each call, unless LLVM sees that nothing is left to count: where
    the part has one exit, and uses each array after its last branch, too. So what is decided by one observation is
    decided by the caller (a fifth to two thirds of the time of a window's kernels).
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "forceinline": True}
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(**options)(function)


def read_only(values: NDArray) -> NDArray:
    """A view of the array that cannot be written to, or a copy where it is not contiguous.

    Numba compiles a kernel once more for arrays that are not contiguous, and for those that may not be written to: the
    images of a recording may not, and the first run over it would wait.
    """
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def kernels() -> tuple[Any, ...]:
    """All kernels of the modules imported so far."""
    return tuple(_kernels)


def compile_kernel(name: str, types: Iterable[Any]) -> None:
    """Compiles one kernel for these types of arguments, or finds that its machine code is kept.

    `name` is its module and function; a type is `float64` for a number, `float64 2` for an array of two dimensions,
    `float64 2 readonly` for one that may not be written to, and {class: types of its fields} for a named tuple.
    """
    module, function = name.rsplit(".", 1)
    getattr(import_module(f"ispom.{module}"), function).compile(tuple(map(_numba_type, types)))


def _numba_type(described: str | Mapping[str, Iterable[Any]]) -> Any:
    if not isinstance(described, str):
        ((name, fields),) = described.items()
        module, kind = name.rsplit(".", 1)
        tuple_class = getattr(import_module(f"ispom.{module}"), kind)
        return numba.types.BaseTuple.from_types(tuple(map(_numba_type, fields)), tuple_class)
    number, *array = described.split()
    kind = numba.from_dtype(np.dtype(number))
    return numba.types.Array(kind, int(array[0]), "C", readonly=array[1:] == ["readonly"]) if array else kind
