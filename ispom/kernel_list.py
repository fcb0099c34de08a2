"""What numba has to compile for each method: the kernels, the types they are called with, and how long that takes.

The file `kernels.json` is written by `python -m tests.kernel_list`, and a test holds it equal to what the methods run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

FILE = "kernels.json"


class Listed(msgspec.Struct, frozen=True):
    """One kernel with the types of its arguments."""

    name: str
    """Module and function, such as `solvers.window.kernels.reduce_points`."""
    seconds: float
    """CPU time of compiling it, on the machine that wrote the list."""
    methods: tuple[str, ...]
    """Those that run it themselves; what they ask is under the names of the methods that they ask."""
    types: Any
    """As `ispom.kernels.compile_kernel` takes them."""


@cache
def kernel_list() -> dict[str, Listed]:
    """All kernels by name."""
    listed = msgspec.convert(json.loads(files("ispom").joinpath(FILE).read_text(encoding="utf-8")), list[Listed])
    return {each.name: each for each in listed}


def kernels_of(methods: Iterable[str]) -> frozenset[str]:
    """The names of the kernels that these methods run; those that they ask are to be among them."""
    chosen = set(methods)
    return frozenset(each.name for each in kernel_list().values() if not chosen.isdisjoint(each.methods))
