"""States of a run to go on from: some of them, within a budget of memory. Any other is reached by replay from there.

The rule: one at every `interval` frames; whenever they no longer fit, every second is given up and the interval
doubles, so that they stay evenly spread over the run. Replay is exact, for runs are bit-identical.
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
    """Offered to by one thread, after each frame."""

    def __init__(self, budget_bytes: int, interval: int = INTERVAL, checkpoints: Iterable[Checkpoint] = ()) -> None:
        """It may begin with those `kept` of another run, in their order."""
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
        """The last one at or before a position."""
        return next((self._by_position[p] for p in reversed(self._by_position) if p <= position), None)

    def until(self, position: int) -> Checkpoints:
        """Another's: these up to a position, for a run that is the same up to there."""
        checkpoints = (checkpoint for at, checkpoint in self._by_position.items() if at <= position)
        return Checkpoints(self._budget_bytes, self.interval, checkpoints)

    def limit(self, budget_bytes: int) -> None:
        """Another budget from now on; what does not fit is given up."""
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
        """Of memory, what they share counted once."""


def size_bytes(value: Any, seen: set[int]) -> int:
    """About what the value takes in memory, without the objects whose ids are in `seen`, to which its own are added."""
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
    """What an object holds, where it is one that States are made of."""
    if isinstance(item, Mapping):
        return [*item.keys(), *item.values()]
    if isinstance(item, tuple | list | set | frozenset):
        return item
    own = list(vars(item).values()) if hasattr(item, "__dict__") and not callable(item) else []
    slots = getattr(type(item), "__slots__", ())
    return own + [getattr(item, s) for s in ((slots,) if isinstance(slots, str) else slots) if hasattr(item, s)]
