"""Saved states of a run, within a budget of memory. Any other state is reached by replay from the one before it.

A state is kept every `interval` frames. Whenever the states no longer fit, every second one is discarded and the
interval doubles, so they stay evenly spread over the run. Replay is exact, because runs are bit-identical.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..model.run_model import RunModel, Tally
from ..playback import Snapshot

INTERVAL = 8
"""Frames from one checkpoint to the next at first. At most as many are replayed to reach a frame."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run before the frame `snapshot.position`, with what is known of it then."""

    snapshot: Snapshot
    model: RunModel
    tally: Tally


class Checkpoints:
    """The kept states of one run. One thread offers it the state after each frame."""

    def __init__(self, budget_bytes: int, interval: int = INTERVAL, checkpoints: Iterable[Checkpoint] = ()) -> None:
        """`checkpoints` are those that are taken over from another run, in their order."""
        self._budget_bytes = budget_bytes
        self.interval = interval
        self._by_position = {checkpoint.snapshot.position: checkpoint for checkpoint in checkpoints}
        """By position, increasing."""
        self._count()
        self._thin()

    def __len__(self) -> int:
        return len(self._by_position)

    def offer(self, position: int, make: Callable[[], Checkpoint]) -> None:
        """Keeps the run as it is before frame `position`, where one is due."""
        if position % self.interval or position in self._by_position:
            return
        checkpoint = self._by_position[position] = make()
        self.used_bytes += size_bytes(checkpoint, self._seen)
        self._thin()

    def nearest(self, position: int) -> Checkpoint | None:
        """Returns the last checkpoint at or before a position; None without one."""
        return next((self._by_position[p] for p in reversed(self._by_position) if p <= position), None)

    def until(self, position: int) -> Checkpoints:
        """Returns the checkpoints up to a position, for another run that is the same up to there."""
        checkpoints = (checkpoint for at, checkpoint in self._by_position.items() if at <= position)
        return Checkpoints(self._budget_bytes, self.interval, checkpoints)

    def limit(self, budget_bytes: int) -> None:
        """Changes the budget, and discards what does not fit."""
        self._budget_bytes = budget_bytes
        self._thin()

    def _thin(self) -> None:
        while self.used_bytes > self._budget_bytes and len(self._by_position) > 1:
            at_least = float(self.used_bytes)  # of which each halving leaves half, and all that they share
            while at_least > self._budget_bytes and len(self._by_position) > 1:
                at_least /= 2
                self.interval *= 2
                self._by_position = {p: kept for p, kept in self._by_position.items() if p % self.interval == 0}
            self._count()

    def _count(self) -> None:
        self._seen: set[int] = set()
        """Ids of the objects that were counted; the checkpoints keep them alive."""
        self.used_bytes = sum(size_bytes(kept, self._seen) for kept in self._by_position.values())
        """Memory of all checkpoints; objects that they share count once."""


def size_bytes(value: Any, seen: set[int]) -> int:
    """Returns about the memory of a value, without objects whose ids are in `seen`. Adds the ids of its objects to
    `seen`."""
    total, waiting = 0, [value]
    while waiting:
        item = waiting.pop()
        if item is None or isinstance(item, bool | int | float | str | type) or id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            total += 100
            if isinstance(item.base, np.ndarray):
                waiting.append(item.base)
            else:
                total += item.nbytes
        else:
            total += sys.getsizeof(item)
            waiting += _inside(item)
    return total


def _inside(item: Any) -> Iterable[Any]:
    """Returns the objects inside an object, if it is of a kind that states consist of."""
    if isinstance(item, Mapping):
        return [*item.keys(), *item.values()]
    if isinstance(item, tuple | list | set | frozenset):
        return item
    own = list(vars(item).values()) if hasattr(item, "__dict__") and not callable(item) else []
    slots = getattr(type(item), "__slots__", ())
    return own + [getattr(item, s) for s in ((slots,) if isinstance(slots, str) else slots) if hasattr(item, s)]
