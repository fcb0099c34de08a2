"""One mechanism for everything that packages can add: a built-in table, and the entry points of a group."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, Generic, Protocol, TypeVar

from ispom.errors import InputError


class Named(Protocol):
    """What a registry holds: a value with a name of its own."""

    @property
    def name(self) -> str: ...


Item = TypeVar("Item", bound=Named)
_REGISTRIES: list[Registry] = []


def named(reference: str, package: str | None = None) -> Any:
    """Returns what MODULE:NAME names; a module that begins with a dot is one of the `package`."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module, package), name)


class _Items(Mapping[str, Item]):
    """Values by name. One that is given as MODULE:NAME is imported when it is first asked for."""

    def __init__(self, items: Mapping[str, Any], kind: type[Item]) -> None:
        self._items, self._kind = dict(items), kind

    def __getitem__(self, name: str) -> Item:
        item = self._items[name]
        if isinstance(item, str):
            loaded = named(item)
            item = self._items[name] = loaded if isinstance(loaded, self._kind) else loaded()
        return item

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


class Registry(Generic[Item]):
    """Values of one kind by name: first the built-in ones, then those of installed packages, sorted.

    An entry point of the `group` names a value of this kind, or a function without arguments that returns one. One that
    fails, or whose name is taken, is skipped, and `faults` says so. Entry points are loaded at the first use.
    """

    def __init__(
        self, group: str, kind: type[Item], word: str, built_in: Iterable[Item] | Mapping[str, str], hint: str = ""
    ) -> None:
        """`word` is what messages call the kind, `hint` ends the message about an unknown name. `built_in` may name
        each value as MODULE:NAME, or a function that returns it: it is imported when it is first used, and the
        function is called again after a value was added to any registry, for it may depend on that."""
        self.group, self.word = group, word
        listed: Any = built_in if isinstance(built_in, Mapping) else {item.name: item for item in built_in}
        self.built_in = dict[str, Any](listed)
        self._kind, self._hint = kind, hint
        self._added: list[Item] = []
        self._items: Mapping[str, Item] | None = None
        self._faults: tuple[str, ...] = ()
        _REGISTRIES.append(self)

    def items(self) -> Mapping[str, Item]:
        """Returns all values by name, in the order in which they are listed everywhere."""
        if self._items is None:
            self._items, self._faults = self._load()
        return self._items

    def names(self) -> tuple[str, ...]:
        """Returns all names, in order."""
        return tuple(self.items())

    def get(self, name: str) -> Item:
        """Returns the value of this name. Raises InputError, with all names, where there is none."""
        if name not in self.items():
            also = f", {self._hint}" if self._hint else ""
            raise InputError(f"{name[:60]!r} is no {self.word}: choose from {', '.join(self.names())}{also}")
        return self.items()[name]

    def takes(self, item: object) -> bool:
        """Whether it is of the kind that this registry holds."""
        return isinstance(item, self._kind)

    def add(self, item: Item, replace: bool = False) -> None:
        """Adds a value for this process only, or replaces one that was added. Raises InputError where its name is
        taken."""
        if replace:
            self._added = [other for other in self._added if other.name != item.name]
            self.refresh()
        if item.name in self.items():
            raise InputError(f"{item.name} is the name of another {self.word}: choose another name")
        self._added.append(item)
        self.refresh()

    def remove(self, item: Item) -> None:
        """Removes a value that was added. Raises ValueError where it was not."""
        self._added.remove(item)
        self.refresh()

    def faults(self) -> tuple[str, ...]:
        """Returns a sentence about each entry point that was skipped."""
        self.items()
        return self._faults

    def refresh(self) -> None:
        """Looks for entry points again at the next use, as all registries do."""
        for registry in _REGISTRIES:
            registry._items = None

    def _load(self) -> tuple[Mapping[str, Item], tuple[str, ...]]:
        items, skipped = dict(self.built_in), []
        for entry in sorted(entry_points(group=self.group), key=lambda e: e.name):
            try:
                loaded = entry.load()
                item = loaded if isinstance(loaded, self._kind) else loaded()
            except Exception as fault:
                why = f"fails with {type(fault).__name__}: {fault}"
                skipped.append(f"{self.word} {entry.name!r} skipped: {entry.value} {why}")
                continue
            if not isinstance(item, self._kind) or item.name in items:
                skipped.append(f"{self.word} {entry.name!r} skipped: {entry.value} gives no {self.word} of a new name")
                continue
            items[item.name] = item
        items |= {item.name: item for item in self._added}
        return _Items(items, self._kind), tuple(skipped)


def faults() -> tuple[str, ...]:
    """Returns the faults of all registries of this process."""
    return tuple(fault for registry in _REGISTRIES for fault in registry.faults())
