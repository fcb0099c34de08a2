"""A growing list as a value: adding shares what was there, so that every State of a run can be kept at no cost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")

WIDTH = 32
"""Items or blocks of one level."""


@dataclass(frozen=True, eq=False, repr=False)
class PersistentList(Generic[T]):
    """Items in the order in which they were added; equal only to itself.

    As a number is written in digits: level k holds fewer than WIDTH full blocks of WIDTH ** k items. Adding copies a
    bounded number of references, and nesting is as deep as there are levels, five for 33 million items: lists of any
    length can be copied, pickled and printed.
    """

    levels: tuple[tuple[Any, ...], ...] = ()
    """The newest items first; within a level the oldest block first."""

    def appended(self, item: T) -> PersistentList[T]:
        """With one more item."""
        levels, carried = list(self.levels), item
        for k, level in enumerate(levels):
            block = (*level, carried)
            if len(block) < WIDTH:
                levels[k] = block
                return PersistentList(tuple(levels))
            levels[k], carried = (), block
        return PersistentList((*levels, (carried,)))

    def extended(self, items: Iterable[T]) -> PersistentList[T]:
        """With more items, in their order."""
        longer = self
        for item in items:
            longer = longer.appended(item)
        return longer

    def part(self, start: int, stop: int) -> list[T]:
        """The items from `start` on before `stop`, in time for those and the nesting; fewer where there are no more."""
        items, begin = list[T](), 0
        for k, level in reversed(list(enumerate(self.levels))):
            items += _part(level, k, start - begin, stop - begin)
            begin += len(level) * WIDTH**k
        return items

    def __len__(self) -> int:
        return sum(len(level) * WIDTH**k for k, level in enumerate(self.levels))

    def __iter__(self) -> Iterator[T]:
        """Oldest first."""
        for k, level in reversed(list(enumerate(self.levels))):
            yield from _items(level, k)

    def __repr__(self) -> str:
        return f"PersistentList({len(self)} items)"


def _items(blocks: tuple[Any, ...], depth: int) -> Iterator[Any]:
    if depth == 0:
        yield from blocks
    else:
        for block in blocks:
            yield from _items(block, depth - 1)


def _part(blocks: tuple[Any, ...], depth: int, start: int, stop: int) -> list[Any]:
    """Of the items in blocks of WIDTH ** depth, those at start <= i < stop."""
    size = WIDTH**depth
    first, end = max(start // size, 0), min(-(-stop // size), len(blocks))
    if depth == 0:
        return list(blocks[first : max(end, first)])
    inner = (_part(blocks[i], depth - 1, start - i * size, stop - i * size) for i in range(first, end))
    return [item for part in inner for item in part]
