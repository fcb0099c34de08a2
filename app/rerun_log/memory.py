"""What the recorder remembers of a run: trajectories and clouds, in blocks, so that only changes are logged again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Frame, Landmarks, Trajectory

POSES_PER_BLOCK = 100
POINTS_PER_BLOCK = 1000
NEW_POINTS_PER_STEP = 400
"""Of more new landmarks in one step, every n-th is shown."""


class PoseHistory:
    """The latest pose of one method at every exposure, the revised ones replaced."""

    def __init__(self, times_ns: NDArray[np.int64]) -> None:
        self.frame: Frame = "rig"
        self.drawn_frame: Frame | None = None
        """Of the camera as it is drawn now; None before the first pose."""
        self._times = np.unique(times_ns)
        self._index = np.searchsorted(times_ns, self._times)
        n = len(self._times)
        self._rotations, self._positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
        self._known, self._key = np.zeros(n, bool), np.zeros(n, bool)

    def know(self, index: int, time_ns: int) -> None:
        """Takes in an exposure of a live source, whose times were not known before."""
        if not len(self._times) or time_ns > self._times[-1]:
            self._times, self._index = np.append(self._times, time_ns), np.append(self._index, index)
            self._rotations = np.concatenate([self._rotations, np.zeros((1, 3, 3))])
            self._positions = np.concatenate([self._positions, np.zeros((1, 3))])
            self._known, self._key = np.append(self._known, False), np.append(self._key, False)

    def indices(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) of the first exposures at these times of the sequence."""
        return self._index[self._rows(times_ns)]

    def update(self, poses: Trajectory) -> set[int]:
        """Takes poses in; the blocks whose line changed."""
        if not len(poses):
            return set()
        self.frame, rows = poses.frame, self._rows(poses.times_ns)
        self._rotations[rows], self._positions[rows], self._known[rows] = poses.rotations, poses.translations, True
        # A block's line starts at the last pose of the block before, so the one after a change changes too.
        touched = np.unique(rows // POSES_PER_BLOCK)
        return {int(b) for b in {*touched, *(touched + 1)} if self._known[_span(b)].any()}

    def mark(self, time_ns: int) -> set[int]:
        """Makes this exposure a key frame; the block it is in."""
        row = int(self._rows(np.array([time_ns]))[0])
        self._key[row] = True
        return {row // POSES_PER_BLOCK} if self._known[row] else set()

    def all_blocks(self) -> set[int]:
        return {int(b) for b in np.unique(np.flatnonzero(self._known) // POSES_PER_BLOCK)}

    def line(self, block: int) -> Array:
        """(K, 3), joined to the block before."""
        before = np.flatnonzero(self._known[: block * POSES_PER_BLOCK])[-1:]
        here = np.flatnonzero(self._known[_span(block)]) + block * POSES_PER_BLOCK
        return self._positions[np.concatenate([before, here])]

    def key_frames(self, block: int, outlines: Array) -> Array:
        """(K * L, P, 3): L polylines of P points, given in the frame (L, P, 3), at each of the block's key frames."""
        rows = np.flatnonzero((self._known & self._key)[_span(block)]) + block * POSES_PER_BLOCK
        placed = outlines[None] @ self._rotations[rows, None].transpose(0, 1, 3, 2) + self._positions[rows, None, None]
        return placed.reshape(-1, *outlines.shape[1:])

    def second_before(self, time_ns: int) -> tuple[int, Array] | None:
        """Time [ns] and position (3,) of the last pose at least a second before, or None."""
        rows = np.flatnonzero(self._known[: np.searchsorted(self._times, time_ns - 10**9, side="right")])
        return (int(self._times[rows[-1]]), self._positions[rows[-1]]) if len(rows) else None

    def _rows(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.clip(np.searchsorted(self._times, times_ns), 0, len(self._times) - 1)


class Cloud:
    """The landmarks of one method, those revised replaced by id."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}
        self._xyz, self._rgb = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
        self._changed: set[int] = set()

    def update(self, found: Landmarks) -> None:
        finite = np.isfinite(found.xyz_in_world).all(1)
        ids, known = found.ids.tolist(), self._row
        new = [ids[i] for i in np.flatnonzero(finite).tolist() if ids[i] not in known]
        for i in new[:: max(1, -(-len(new) // NEW_POINTS_PER_STEP))]:
            known[i] = len(known)
        self._grow(len(known))
        rows = np.fromiter((known.get(i, -1) for i in ids), np.int64, len(ids))
        shown = finite & (rows >= 0)
        self._xyz[rows[shown]], self._rgb[rows[shown]] = found.xyz_in_world[shown], found.rgb[shown]
        self._changed |= {int(b) for b in np.unique(rows[shown] // POINTS_PER_BLOCK)}

    def changed(self) -> set[int]:
        """The blocks changed since this was last asked."""
        changed, self._changed = self._changed, set()
        return changed

    def points(self, block: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """xyz (K, 3) in the method's world, rgb (K, 3)."""
        span = slice(block * POINTS_PER_BLOCK, min((block + 1) * POINTS_PER_BLOCK, len(self._row)))
        return self._xyz[span].copy(), self._rgb[span].copy()

    def _grow(self, count: int) -> None:
        if count > len(self._xyz):
            extra = max(count - len(self._xyz), len(self._xyz), POINTS_PER_BLOCK)
            self._xyz = np.concatenate([self._xyz, np.zeros((extra, 3), np.float32)])
            self._rgb = np.concatenate([self._rgb, np.zeros((extra, 3), np.uint8)])


def _span(block: int) -> slice:
    return slice(int(block) * POSES_PER_BLOCK, (int(block) + 1) * POSES_PER_BLOCK)
