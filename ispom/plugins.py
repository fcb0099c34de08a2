"""Tables of what installed packages can add to: built-in entries by name, and those of entry points of one group."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Generic, TypeVar

T = TypeVar("T")


class Table(Generic[T]):
    """Entries of one kind by name. Packages are looked for when the table is first read."""

    def __init__(self, group: str, kind: type[T], built_in: Iterable[tuple[str, T]]) -> None:
        self.group, self._kind = group, kind
        self._built_in = dict(built_in)
        self._found: tuple[Mapping[str, T], tuple[str, ...]] | None = None

    @property
    def entries(self) -> Mapping[str, T]:
        """By name: the built-in ones, then those of packages in the order of their names."""
        return self._all()[0]

    @property
    def faults(self) -> tuple[str, ...]:
        """One sentence for each entry of a package that was skipped."""
        return self._all()[1]

    def _all(self) -> tuple[Mapping[str, T], tuple[str, ...]]:
        if self._found is None:
            found, faults = dict(self._built_in), list[str]()
            for entry in sorted(entry_points(group=self.group), key=lambda e: e.name):
                try:
                    value = entry.load()
                    value = value() if isinstance(value, type) or not isinstance(value, self._kind) else value
                except Exception as fault:
                    reason = f"{entry.value} fails with {type(fault).__name__}: {fault}"
                    faults.append(f"{self.group} {entry.name!r} skipped: {reason}")
                    continue
                if not isinstance(value, self._kind) or entry.name in found:
                    faults.append(f"{self.group} {entry.name!r} skipped: {entry.value} gives no entry of a new name")
                    continue
                found[entry.name] = value
            self._found = MappingProxyType(found), tuple(faults)
        return self._found
