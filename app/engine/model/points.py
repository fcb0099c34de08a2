"""Points of the scene by id, as values: a new one shares all but the blocks that changed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Landmarks

POINTS_PER_BLOCK = 1000
NEW_PER_STEP = 400
"""Most new points of one step that a thinned map takes; of more it takes every n-th."""
HALVED_EVERY = 20_000
"""Number of points after which a thinned map takes half as many of the new ones, and after as many again a quarter."""


@dataclass(frozen=True, eq=False)
class PointBlock:
    """Up to POINTS_PER_BLOCK points, in the order in which they came."""

    ids: NDArray[np.int64]
    xyz: Array
    """(K, 3) in the method's world, as found last."""
    rgb: NDArray[np.uint8]
    """(K, 3)."""
    born: NDArray[np.int64]
    """(K,) the frame that gave each point first."""


@dataclass(frozen=True, eq=False)
class PointMap:
    """The landmarks of one method at their newest positions. Points without a finite position are not taken."""

    thinned: bool = False
    """Whether the map is for drawing. Then it has only a part of the points of a long run, and positions are
    float32."""
    count: int = 0
    blocks: tuple[PointBlock, ...] = ()
    _rows: dict[int, int] = field(default_factory=dict)
    """By id: the row of the point. Versions of the map share it; each uses its first `count` rows only."""

    def with_points(self, found: Landmarks, index: int) -> PointMap:
        """Returns the map with the points that frame `index` found or revised."""
        finite = np.isfinite(found.xyz_in_world).all(1)
        if not finite.any():
            return self
        ids = found.ids.tolist()
        known = self._rows if len(self._rows) == self.count else {i: r for i, r in self._rows.items() if r < self.count}
        new = list(dict.fromkeys(ids[i] for i in np.flatnonzero(finite).tolist() if ids[i] not in known))
        for i in self._taken(new):
            known[i] = len(known)
        rows = np.fromiter((known.get(i, -1) for i in ids), np.int64, len(ids))
        at = np.flatnonzero(finite & (rows >= 0))
        return replace(self, count=len(known), blocks=self._changed(rows[at], found, at, index), _rows=known)

    def _taken(self, new: list[int]) -> list[int]:
        if not self.thinned:
            return new
        share = 1 << (self.count // HALVED_EVERY)
        new = [i for i in new if i % share == 0]
        return new[:: max(1, -(-len(new) // NEW_PER_STEP))]

    def _changed(
        self, rows: NDArray[np.int64], found: Landmarks, at: NDArray[np.int64], index: int
    ) -> tuple[PointBlock, ...]:
        blocks, which = list(self.blocks), rows // POINTS_PER_BLOCK
        for b in np.unique(which).tolist():
            chosen = which == b
            inside, source = rows[chosen] % POINTS_PER_BLOCK, at[chosen]
            old = blocks[b] if b < len(blocks) else _empty(np.float32 if self.thinned else np.float64)
            size = max(len(old.ids), int(inside.max()) + 1)
            block = PointBlock(*(_grown(a, size) for a in (old.ids, old.xyz, old.rgb, old.born)))
            block.ids[inside] = found.ids[source]
            block.xyz[inside], block.rgb[inside] = found.xyz_in_world[source], found.rgb[source]
            block.born[len(old.ids) :] = index
            blocks[b : b + 1] = [block]
        return tuple(blocks)

    def changed_blocks(self, before: PointMap) -> set[int]:
        return {b for b, x in enumerate(self.blocks) if b >= len(before.blocks) or before.blocks[b] is not x}

    def landmarks(self) -> Landmarks:
        """All points, by increasing id."""
        if not self.blocks:
            return Landmarks.empty()
        ids = np.concatenate([block.ids for block in self.blocks])
        order = np.argsort(ids)
        xyz, rgb = (np.concatenate([getattr(b, name) for b in self.blocks]) for name in ("xyz", "rgb"))
        return Landmarks(ids[order], xyz[order], rgb[order])


def _empty(kind: type) -> PointBlock:
    return PointBlock(np.zeros(0, np.int64), np.zeros((0, 3), kind), np.zeros((0, 3), np.uint8), np.zeros(0, np.int64))


def _grown(array: np.ndarray, size: int) -> np.ndarray:
    """Returns a copy with `size` rows; those without a value are 0."""
    return np.concatenate([array, np.zeros((size - len(array), *array.shape[1:]), array.dtype)])
