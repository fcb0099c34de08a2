"""How long tracks lived, and why they ended."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.types import TrackStatus

from .sightings import Seen


@dataclass(frozen=True, eq=False)
class Lifetimes:
    """The tracks of some frames of one camera, in the order in which they began."""

    indices: NDArray[np.int64]
    """(E,) the frames, increasing."""
    ids: NDArray[np.int64]
    """(N,)."""
    first: NDArray[np.int64]
    """(N,) place among the frames of the first that has the track."""
    last: NDArray[np.int64]
    """(N,) the same of the last."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus in the last."""


def lifetimes(exposures: Iterable[Seen]) -> Lifetimes:
    """Of these frames, oldest first."""
    views = list(exposures)
    none = np.zeros(0, np.int64)
    ids = np.concatenate([none, *(seen.tracks.ids for seen in views)])
    status = np.concatenate([none.astype(np.uint8), *(seen.tracks.status for seen in views)])
    places = np.repeat(np.arange(len(views)), [len(seen.tracks) for seen in views])
    found, first = np.unique(ids, return_index=True)
    last = len(ids) - 1 - np.unique(ids[::-1], return_index=True)[1]
    order = np.lexsort([found, places[last], places[first]])
    indices = np.array([seen.index for seen in views], np.int64)
    return Lifetimes(
        indices, found[order], places[first][order], places[last][order], status[last][order].astype(np.uint8)
    )


def endings(of: Lifetimes) -> dict[TrackStatus, int]:
    """How many ended for which reason, the most first; those that go on are not among them."""
    counts = np.bincount(of.status, minlength=len(TrackStatus))
    found = {status: int(counts[status]) for status in TrackStatus if status.dropped and counts[status]}
    return dict(sorted(found.items(), key=lambda item: -item[1]))
