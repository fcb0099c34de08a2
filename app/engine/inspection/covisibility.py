"""Which keyframes saw the same tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.types import TrackStatus

from ..history.history import Records
from ..history.series import Series
from .sightings import Seen, seen_by

MOST_KEY_FRAMES = 24


@dataclass(frozen=True, eq=False)
class Covisibility:
    """The covisibility of the keyframes of one method."""

    indices: tuple[int, ...]
    """(K,) their frames, increasing."""
    shared: NDArray[np.int64]
    """(K, K) number of tracks that two keyframes see; on the diagonal, the number that one sees."""

    def neighbours(self, index: int) -> list[tuple[int, int]]:
        """Returns (frame, number of shared tracks) of the keyframes that share tracks with this one, the most first."""
        row = self.shared[self.indices.index(index)]
        found = [(i, int(n)) for i, n in zip(self.indices, row, strict=True) if i != index and n]
        return sorted(found, key=lambda item: -item[1])


def key_frames(series: Series, method: str, index: int) -> list[int]:
    """The frames up to `index` that the method made keyframes, increasing."""
    name = f"{method}.key_frame"
    return np.flatnonzero(series.values(name, 0, index + 1) == 1).tolist() if name in series.quantities else []


def around(key_frames: Sequence[int], index: int, most: int = MOST_KEY_FRAMES) -> list[int]:
    """Returns `most` successive keyframes with the one at `index` in the middle, or as near to it as possible."""
    at = int(np.searchsorted(key_frames, index))
    start = max(0, min(at - most // 2, len(key_frames) - most))
    return list(key_frames[start : start + most])


def seen_at(records: Records, method: str, indices: Sequence[int]) -> list[Seen]:
    """Returns the tracks at these frames, without frames that have none."""
    found = (seen_by(records[i], method) for i in indices)
    return [seen for seen in found if seen is not None and len(seen.tracks)]


def covisibility(views: Sequence[Seen]) -> Covisibility:
    """Returns the covisibility of keyframes, given oldest first. A keyframe in which a track ended did not see it."""
    ids = [seen.tracks.ids[seen.tracks.status < TrackStatus.LOST] for seen in views]
    known, column = np.unique(np.concatenate([np.zeros(0, np.int64), *ids]), return_inverse=True)
    table = np.zeros((len(views), len(known)), np.float32)
    table[np.repeat(np.arange(len(views)), [len(i) for i in ids]), column] = 1
    return Covisibility(tuple(seen.index for seen in views), np.rint(table @ table.T).astype(np.int64))
