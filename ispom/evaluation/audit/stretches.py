"""Checks whether poses are missing under the cover of copies: frozen stretches, and stretches that are there twice."""

from __future__ import annotations

import numpy as np

from ispom.geometry import Array
from ispom.types import Trajectory

MIN_POSES = 5
"""Least number of equal poses in a row, or of copied ones: fewer are those of a logger that is faster than its
source."""
MIN_MOVED = 5.0
"""Least motion of the other trajectory meanwhile, in its own median steps: at rest, equal poses are right."""


def frozen(poses: Trajectory, other: Trajectory) -> list[tuple[int, int]]:
    """Returns first and last indices of stretches in which `poses` are all the same and the other ones move.

    Both hold associated poses.
    """
    same = np.append(False, _unchanged(poses))
    edges = np.flatnonzero(np.diff(np.append(np.append(False, same), False).astype(int)))
    steps = np.linalg.norm(np.diff(other.translations, axis=0), axis=1)
    moving = steps[steps > 0]
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        # The pose before the first equal step is the one that is repeated.
        first, last = int(begin) - 1, int(end) - 1
        moved = float(np.linalg.norm(other.translations[first : last + 1] - other.translations[first], axis=1).max())
        if last - first + 1 >= MIN_POSES and len(moving) and moved > MIN_MOVED * np.median(moving):
            found.append((first, last))
    return found


def _unchanged(poses: Trajectory) -> Array:
    """(N - 1,) whether a pose is exactly the one before."""
    still = (np.diff(poses.translations, axis=0) == 0).all(axis=1)
    return still & (abs(np.diff(poses.rotations, axis=0)) < 1e-12).all(axis=(1, 2))


def copied(poses: Trajectory) -> list[tuple[int, int]]:
    """Returns first and last indices of stretches that are copies of an earlier one of the same length."""
    seen: dict[bytes, int] = {}
    source = np.full(len(poses), -1)
    for i, key in enumerate(map(bytes, np.ascontiguousarray(poses.translations).view(np.uint8))):
        source[i] = seen.setdefault(key, i)
    apart = np.arange(len(poses)) - source
    found, first = [], None
    for i in range(len(poses) + 1):
        goes_on = i < len(poses) and apart[i] > 1 and first is not None and apart[i] == apart[first]
        if goes_on:
            continue
        if first is not None and i - first >= MIN_POSES and not _unchanged(poses.select(slice(first, i))).any():
            found.append((first, i - 1))
        first = i if i < len(poses) and apart[i] > 1 else None
    return found
