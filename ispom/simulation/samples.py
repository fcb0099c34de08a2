"""What the shader looks at: one sample for a pixel within a face, several where faces meet; then their mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.simulation.noise import Values

ROOKS = np.array([[-0.375, 0.125], [0.125, 0.375], [0.375, -0.125], [-0.125, -0.375]], np.float32)
"""(4, 2) extra samples of an edge pixel [px]: all columns and all rows differ."""


def edges(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(H, W) whether any of the eight neighbours shows another face."""
    edge = np.zeros(faces.shape, bool)
    h, w = faces.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = slice(0, h - dy), slice(max(0, -dx), w - max(0, dx))
        there = slice(dy, h), slice(max(0, dx), w + min(0, dx))
        differs = faces[here] != faces[there]
        edge[here] |= differs
        edge[there] |= differs
    return edge


@dataclass(frozen=True, eq=False)
class Samples:
    """One look at each face that a pixel shows: first those of pixels within a face, then those of edge pixels."""

    inner: NDArray[np.intp]
    """(I,) pixels of an image read row by row."""
    outer: NDArray[np.intp]
    """(E,)"""
    starts: NDArray[np.intp]
    """(E,) where the samples of an edge pixel begin, after those I."""
    pixel: NDArray[np.intp]
    """(N,)"""
    face: NDArray[np.int32]
    dx: Values
    """(N,) from the pixel's centre [px]."""
    dy: Values
    share: Values
    """(N,) part of the pixel that shows this face, 0..1."""

    @staticmethod
    def of(faces: NDArray[np.int32], edge: NDArray[np.bool_], hits: NDArray[np.int32]) -> Samples:
        """Of the faces (H, W) behind centres, and those (E, R) that ROOKS of the edge pixels hit."""
        inner, outer, count = np.flatnonzero(~edge), np.flatnonzero(edge), len(ROOKS)
        # By face within a pixel; the lowest digits keep which of ROOKS it was.
        mixed = np.sort((hits + 1) * count + np.arange(count, dtype=np.int32), axis=1).ravel()
        face, which = mixed // count - 1, mixed % count
        first = np.diff(face, prepend=-2) != 0
        first[::count] = True
        runs = np.flatnonzero(first)
        alike = np.diff(runs, append=len(mixed)).astype(np.float32)
        dx, dy = (np.add.reduceat(a[which], runs) / alike if len(runs) else alike for a in ROOKS.T)
        still = np.zeros(len(inner), np.float32)
        return Samples(
            inner,
            outer,
            np.flatnonzero(runs % count == 0),
            np.concatenate([inner, outer[runs // count]]),
            np.concatenate([faces.ravel()[inner], face[runs]]),
            np.concatenate([still, dx]),
            np.concatenate([still, dy]),
            np.concatenate([still + 1, alike / count]),
        )

    def mean(self, colour: Values) -> Values:
        """(H W, 3) of the pixels, from the colours (N, 3) of all samples."""
        out = np.empty((len(self.inner) + len(self.outer), 3), np.float32)
        n = len(self.inner)
        out[self.inner] = colour[:n]
        if len(self.outer):
            out[self.outer] = np.add.reduceat(colour[n:] * self.share[n:, None], self.starts, axis=0)
        return out
