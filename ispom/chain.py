"""A growing list as a value: adding shares what was there, so that every State of a run can be kept at no cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Chain(Generic[T]):
    """An item and the Chain before it; None is the empty one."""

    item: T
    before: Chain[T] | None = None


def in_order(chain: Chain[T] | None) -> Iterator[T]:
    """The items, oldest first."""
    items = []
    while chain is not None:
        items.append(chain.item)
        chain = chain.before
    return reversed(items)
