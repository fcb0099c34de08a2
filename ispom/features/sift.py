"""Correspondence by descriptors (Lowe 2004): survives metres between two images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.types import Image


@dataclass(frozen=True, eq=False)
class Features:
    uv: NDArray[np.float32]
    """(N, 2) [px]."""
    descriptors: NDArray[np.float32]
    """(N, 128), RootSIFT (Arandjelovic & Zisserman 2012); (N, 0) of points that are tracked."""

    def __len__(self) -> int:
        return len(self.uv)

    @property
    def described(self) -> bool:
        return self.descriptors.shape[1] > 0

    def after(self, uv: NDArray[np.float32]) -> Features:
        """With places (M, 2) before these, whose descriptors match none."""
        blank = np.zeros((len(uv), self.descriptors.shape[1]), np.float32)
        return Features(np.concatenate([uv, self.uv]), np.concatenate([blank, self.descriptors]))


SEARCH_SIDE_PX = 800
"""Images whose longer side is longer are searched at this size: as accurate on real drives, and much faster."""


ROWS_AT_ONCE = 512
"""Descriptors compared at a time with all of the other image: the whole table would take some 70 MB."""


def detect_and_describe(grey: Image, count: int) -> Features:
    """The `count` strongest SIFT features of an image, each place once."""
    height, width = grey.shape
    factor = min(1.0, SEARCH_SIDE_PX / max(grey.shape))
    size = (round(width * factor), round(height * factor))
    searched = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    keypoints, descriptors = cv2.SIFT.create(nfeatures=count, contrastThreshold=0.02).detectAndCompute(searched, None)
    if descriptors is None or not len(keypoints):
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32))
    stretch = np.array([width / size[0], height / size[1]])
    uv = ((np.array([k.pt for k in keypoints]) + 0.5) * stretch - 0.5).astype(np.float32)
    _, first = np.unique(uv, axis=0, return_index=True)
    keep = np.sort(first)
    root = np.sqrt(descriptors[keep] / np.maximum(descriptors[keep].sum(1, keepdims=True), 1e-9))
    return Features(uv[keep], root.astype(np.float32))


def match_near(a: Features, b: Features, expected: Array, distance_px: float, alike: float) -> NDArray[np.int64]:
    """Index pairs (M, 2): of each feature of `a` the most similar of `b` around where it is `expected` (N, 2) [px].

    Each of `b` once. Similarity is the product of the descriptors, at least `alike`. NaN is expected nowhere.
    """
    return each_once(*all_near(a, b, expected, distance_px, alike))


def all_near(
    a: Features, b: Features, expected: Array, distance_px: float, alike: float
) -> tuple[NDArray[np.int64], Array]:
    """The same with some of `b` several times: index pairs (M, 2), and their similarity (M,)."""
    pairs, best = np.zeros((0, 2), np.int64), np.zeros(0)
    for start in range(0, len(a), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        similarity = a.descriptors[rows] @ b.descriptors.T
        near = ((expected[rows, None] - b.uv[None]) ** 2).sum(axis=2) < distance_px**2
        similarity[~near] = -1
        nearest = similarity.argmax(axis=1) if len(b) else np.zeros(0, np.int64)
        score = similarity[np.arange(len(nearest)), nearest]
        good = score > alike
        pairs = np.concatenate([pairs, np.stack([start + np.flatnonzero(good), nearest[good]], axis=1)])
        best = np.concatenate([best, score[good]])
    return pairs, best


def each_once(pairs: NDArray[np.int64], similarity: Array) -> NDArray[np.int64]:
    """Of index pairs (M, 2) the most similar one of each second index."""
    order = np.argsort(-similarity, kind="stable")
    _, first = np.unique(pairs[order, 1], return_index=True)
    return pairs[np.sort(order[first])]


def match(a: Features, b: Features, max_ratio: float = 0.9) -> NDArray[np.int64]:
    """Index pairs (M, 2) of mutual nearest neighbours that pass the ratio test."""
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2), np.int64)
    to_b, clear = np.zeros(len(a), np.int64), np.zeros(len(a), bool)
    to_a, best_of_b, columns = np.zeros(len(b), np.int64), np.full(len(b), -np.inf, np.float32), np.arange(len(b))
    for start in range(0, len(a), ROWS_AT_ONCE):
        similarity = a.descriptors[start : start + ROWS_AT_ONCE] @ b.descriptors.T
        row = np.ascontiguousarray(similarity.T).argmax(1)
        better = similarity[row, columns] > best_of_b
        to_a[better], best_of_b[better] = start + row[better], similarity[row, columns][better]
        rows = np.arange(len(similarity))
        nearest = similarity.argmax(1)
        best = similarity[rows, nearest]
        similarity[rows, nearest] = -1
        # Unit vectors: squared distance is 2 - 2 similarity, and the ratio test compares distances.
        clear[start + rows] = (1 - best) < max_ratio**2 * (1 - similarity.max(1))
        to_b[start + rows] = nearest
    good = clear & (to_a[to_b] == np.arange(len(a)))
    return np.stack([np.flatnonzero(good), to_b[good]], axis=1)
