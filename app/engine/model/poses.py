"""Poses by time, as values: a new one shares all but the blocks that changed, so every version may be kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import FrameName, Trajectory

POSES_PER_BLOCK = 100
QUIET = 200
"""Number of frames without a change after which a block keeps its earlier version when it changes again."""


@dataclass(frozen=True, eq=False)
class Times:
    """The times of the frames so far, each once, and the first frame at each. Versions share their arrays."""

    count: int
    _times_ns: NDArray[np.int64]
    """(C,) the first `count` are filled, increasing."""
    _indices: NDArray[np.int64]
    """(C,); -1 where not filled."""

    @staticmethod
    def none() -> Times:
        return Times(0, np.zeros(0, np.int64), np.zeros(0, np.int64))

    def with_exposure(self, index: int, time_ns: int) -> Times:
        """Returns the times with those of frame `index`, which is not before the others."""
        n = self.count
        if n and time_ns <= self._times_ns[n - 1]:
            return self
        times_ns, indices = self._times_ns, self._indices
        if n == len(indices) or indices[n] >= 0:  # no room, or taken by another version
            room = np.full(max(n, POSES_PER_BLOCK), -1, np.int64)
            times_ns, indices = (np.concatenate([a[:n], room]) for a in (times_ns, indices))
        times_ns[n], indices[n] = time_ns, index
        return Times(n + 1, times_ns, indices)

    def rows(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """(N,) places of these times of frames."""
        return np.clip(np.searchsorted(self._times_ns[: self.count], times_ns), 0, max(self.count - 1, 0))

    def rows_until(self, index: int) -> int:
        """Returns the number of times of the frames up to this one."""
        return int(np.searchsorted(self._indices[: self.count], index, side="right"))

    def times_ns(self, rows: NDArray[np.int64] | slice) -> NDArray[np.int64]:
        return self._times_ns[: self.count][rows]

    def indices(self, rows: NDArray[np.int64] | slice) -> NDArray[np.int64]:
        """The frames at these rows."""
        return self._indices[: self.count][rows]


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """The poses at POSES_PER_BLOCK successive times of the run."""

    rotations: Array
    """(K, 3, 3)."""
    positions: Array
    """(K, 3)."""
    known: NDArray[np.bool_]
    """(K,)."""
    key: NDArray[np.bool_]
    """(K,) whether it is a keyframe."""
    since: int
    """The frame whose change began this version."""
    changed: int
    """The frame of the latest change."""
    earlier: PoseBlock | None = None
    """The version before `since`; None where it had no pose."""

    @staticmethod
    def empty(index: int) -> PoseBlock:
        k = POSES_PER_BLOCK
        return PoseBlock(
            np.zeros((k, 3, 3)), np.zeros((k, 3)), np.zeros(k, bool), np.zeros(k, bool), since=index, changed=index
        )

    def writable(self, index: int) -> PoseBlock:
        """A copy, to be changed by frame `index` before anybody else sees it."""
        rested = index - self.changed > QUIET
        return PoseBlock(
            self.rotations.copy(),
            self.positions.copy(),
            self.known.copy(),
            self.key.copy(),
            since=index if rested else self.since,
            changed=index,
            earlier=self if rested else self.earlier,
        )


@dataclass(frozen=True, eq=False)
class PoseHistory:
    """The latest pose of one method at every frame, in its own world."""

    blocks: tuple[PoseBlock, ...] = ()
    frame: FrameName = "rig"
    starts: tuple[int, ...] = ()
    """Rows at which segments begin. Nothing joins a segment to the poses before it, so no line is drawn between
    them."""

    def with_poses(self, rows: NDArray[np.int64], poses: Trajectory, index: int) -> PoseHistory:
        """Returns the history with poses at these rows (N,) of the run's times, which frame `index` gave."""
        if not len(poses):
            return self
        blocks = list(self.blocks)
        for b, inside, at in _by_block(rows):
            block = self._changing(blocks, b, index)
            block.rotations[inside], block.positions[inside] = poses.rotations[at], poses.translations[at]
            block.known[inside] = True
        return replace(self, blocks=tuple(blocks), frame=poses.frame)

    def with_key_frame(self, row: int, index: int) -> PoseHistory:
        blocks = list(self.blocks)
        self._changing(blocks, row // POSES_PER_BLOCK, index).key[row % POSES_PER_BLOCK] = True
        return replace(self, blocks=tuple(blocks))

    def with_start(self, row: int) -> PoseHistory:
        """Returns the history with a segment that begins at a row."""
        return self if row in self.starts else replace(self, starts=(*self.starts, row))

    @staticmethod
    def _changing(blocks: list[PoseBlock], b: int, index: int) -> PoseBlock:
        while len(blocks) <= b:
            blocks.append(PoseBlock.empty(index))
        blocks[b] = blocks[b].writable(index)
        return blocks[b]

    def drawn_blocks(self) -> set[int]:
        """Returns the blocks with poses."""
        return {b for b, block in enumerate(self.blocks) if block.known.any()}

    def changed_blocks(self, before: PoseHistory) -> set[int]:
        """Returns the blocks whose line changed. The line of a block starts at the last pose of the block before."""
        found: set[int] = set()
        for b, block in enumerate(self.blocks):
            if b >= len(before.blocks) or before.blocks[b] is not block:
                found |= {b, b + 1}
        return {b for b in found if b < len(self.blocks) and self.blocks[b].known.any()}

    def lines(self, block: int) -> list[Array]:
        """Polylines (K, 3), the first joined to the pose before the block, one for each segment."""
        first = block * POSES_PER_BLOCK
        rows = np.flatnonzero(self.blocks[block].known) + first
        before = self._last_known(first)
        joined = [] if before is None else [self.position(before)[None]]
        rows = rows if before is None else np.concatenate([[before], rows])
        xyz = np.concatenate([*joined, self.blocks[block].positions[self.blocks[block].known]])
        parts = np.split(xyz, sorted(np.searchsorted(rows, self.starts).tolist()))
        return [part for part in parts if len(part)]

    def key_frame_rows(self, block: int) -> NDArray[np.int64]:
        """Returns rows (K,) of keyframes with a pose."""
        found = self.blocks[block]
        return np.flatnonzero(found.known & found.key) + block * POSES_PER_BLOCK

    def key_frames(self, block: int, outlines: Array) -> Array:
        """(K * L, P, 3): L polylines of P points, given in the frame (L, P, 3), at each of the block's keyframes."""
        found, rows = self.blocks[block], self.key_frame_rows(block) - block * POSES_PER_BLOCK
        rotations, positions = found.rotations[rows, None], found.positions[rows, None, None]
        placed = outlines[None] @ rotations.transpose(0, 1, 3, 2) + positions
        return placed.reshape(-1, *outlines.shape[1:])

    def position(self, row: int) -> Array:
        """(3,) of a known pose."""
        return self.blocks[row // POSES_PER_BLOCK].positions[row % POSES_PER_BLOCK]

    def pose(self, row: int) -> Pose:
        """Returns the pose of a row that has one."""
        block, at = self.blocks[row // POSES_PER_BLOCK], row % POSES_PER_BLOCK
        return Pose(block.rotations[at], block.positions[at])

    def trajectory(self, times: Times) -> Trajectory:
        """All known poses."""
        rows = np.flatnonzero(np.concatenate([np.zeros(0, bool), *(block.known for block in self.blocks)]))
        rotations = np.concatenate([np.zeros((0, 3, 3)), *(block.rotations for block in self.blocks)])[rows]
        positions = np.concatenate([np.zeros((0, 3)), *(block.positions for block in self.blocks)])[rows]
        return Trajectory(times.times_ns(rows), rotations, positions, self.frame)

    def second_before(self, times: Times, time_ns: int) -> tuple[int, Array] | None:
        """Time [ns] and position (3,) of the last pose at least a second before, or None."""
        end = int(np.searchsorted(times.times_ns(slice(None)), time_ns - 10**9, side="right"))
        row = self._last_known(end)
        return None if row is None else (int(times.times_ns(slice(row, row + 1))[0]), self.position(row))

    def last_known(self) -> int | None:
        """The row of the last pose."""
        return self._last_known(len(self.blocks) * POSES_PER_BLOCK)

    def _last_known(self, end: int) -> int | None:
        """The last row with a pose before row `end`."""
        for b in range(min((end - 1) // POSES_PER_BLOCK, len(self.blocks) - 1), -1, -1):
            known = np.flatnonzero(self.blocks[b].known[: end - b * POSES_PER_BLOCK])
            if len(known):
                return int(known[-1]) + b * POSES_PER_BLOCK
        return None


def _by_block(rows: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int64]]]:
    """(block, rows within it, their places in `rows`)."""
    blocks = rows // POSES_PER_BLOCK
    for b in np.unique(blocks):
        at = np.flatnonzero(blocks == b)
        yield int(b), rows[at] % POSES_PER_BLOCK, at
