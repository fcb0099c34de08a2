"""Dialects of files: the formats of other programs, each recognised by its signature."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, Protocol, TypeVar


class Signed(Protocol):
    """The attributes of all dialects."""

    @property
    def title(self) -> str: ...

    @property
    def looked_for(self) -> str:
        """Description of the signature."""
        ...

    @property
    def order(self) -> int:
        """Dialects of a lower order are tried first."""
        ...

    @property
    def recognises(self) -> Callable[[Any], bool]: ...


D = TypeVar("D", bound=Signed)


def modules_of(package: str, path: Iterable[str]) -> dict[str, ModuleType]:
    """Returns the modules of a package that have a `DIALECT`, by the names of their dialects, sorted by title; `path`
    is the package's `__path__`."""
    found = [import_module(f"{package}.{module.name}") for module in pkgutil.iter_modules(path)]
    found = [module for module in found if hasattr(module, "DIALECT")]
    return {module.DIALECT.name: module for module in sorted(found, key=lambda m: m.DIALECT.title.lower())}


def matching(dialects: Sequence[D], content: object) -> list[D]:
    """Returns the dialects of the lowest order whose signature a file has: none, one, or several, which is
    ambiguous."""
    for order in sorted({each.order for each in dialects}):
        if found := [each for each in dialects if each.order == order and each.recognises(content)]:
            return found
    return []


def in_words(dialects: Iterable[Signed]) -> str:
    """Returns the titles of dialects with their signatures."""
    return " and of ".join(f"{each.title} ({each.looked_for})" for each in dialects)
