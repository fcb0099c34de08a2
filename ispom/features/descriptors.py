"""Matches descriptors by similarity, tracks by them, and wraps OpenCV's detectors and descriptors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.interfaces import Allowed, Descriptor, Detector, Features, FrontEnd, Matcher
from ispom.features.klt import Klt
from ispom.geometry import Array
from ispom.types import Image, TrackStatus

MAX_RATIO = 0.8
"""Largest ratio of the distances of the best and the second best descriptor (Lowe 2004, section 7.1)."""
SEARCH_SIDE_PX = 800
"""Longer side [px] to which larger images are reduced for detection: as accurate on real drives, and much faster."""
MIN_SIDE_PX = 16
"""Shorter side [px] below which an image has no features."""
ROWS_AT_ONCE = 512
"""Number of descriptors compared at a time with all of the other image; a full table would take some 70 MB."""
PADDING_PX = 48
"""Width [px] of the border added by repeating the last pixels: at least half of the widest patch."""
CANDIDATES_PER_POINT = 16
"""Number of keypoints detected per point needed, from which well-distributed points are chosen. The strongest keypoints
repeat corners on the eight levels of a pyramid, and lie where contrast is high: of a texture whose other half has a
third of the contrast, ORB has no point there with 4 or 8, and nearly half of its share with 16."""
GUIDED_RADIUS = 0.05
"""Radius of a guided search, relative to the longer side of the image: 32 px at 640."""
MAX_REFINEMENT_PX = 3.0
"""Largest correction [px] of a match by alignment: detectors repeat a point to about a pixel."""


def dot_product(a: NDArray, b: NDArray) -> NDArray[np.float32]:
    """Returns the similarity (N, M) of unit vectors: 1 minus half of their squared Euclidean distance."""
    return _unit(a) @ _unit(b).T


def hamming_similarity(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Returns the similarity (N, M) of packed bits: 1 minus twice the share of differing bits, about 0 if unrelated.

    It equals the dot product of the bits as +-1, scaled to unit vectors.
    """
    signs = [2 * np.unpackbits(d, axis=1).astype(np.float32) - 1 for d in (a, b)]
    return signs[0] @ signs[1].T / np.float32(max(signs[0].shape[1], 1))


def _unit(descriptors: NDArray) -> NDArray[np.float32]:
    return descriptors.astype(np.float32) / 255.0 if descriptors.dtype == np.uint8 else descriptors


@dataclass(frozen=True)
class SimilarityMatcher:
    """A Matcher that compares descriptors by a similarity such as `dot_product`."""

    similarity: Callable[[NDArray, NDArray], NDArray[np.float32]]
    min_similarity: float
    """Least similarity of a match."""
    max_ratio: float
    """Largest ratio of 1 - similarity of the best and the second best match. For unit vectors this is the squared ratio
    of distances, for bits the ratio of Hamming distances."""

    def match(self, a: Features, b: Features) -> NDArray[np.int64]:
        """Returns mutual nearest neighbours that pass the ratio test, see Matcher."""
        if len(a) < 2 or len(b) < 2 or _differ(a, b):
            return np.zeros((0, 2), np.int64)
        to_b, clear = np.zeros(len(a), np.int64), np.zeros(len(a), bool)
        to_a, best_of_b, columns = np.zeros(len(b), np.int64), np.full(len(b), -np.inf, np.float32), np.arange(len(b))
        for start in range(0, len(a), ROWS_AT_ONCE):
            similarity = self.similarity(a.descriptors[start : start + ROWS_AT_ONCE], b.descriptors)
            row = np.ascontiguousarray(similarity.T).argmax(1)
            better = similarity[row, columns] > best_of_b
            to_a[better], best_of_b[better] = start + row[better], similarity[row, columns][better]
            rows = np.arange(len(similarity))
            nearest = similarity.argmax(1)
            best = similarity[rows, nearest]
            similarity[rows, nearest] = -1
            clear[start + rows] = (1 - best) < self.max_ratio * (1 - similarity.max(1))
            to_b[start + rows] = nearest
        good = clear & (to_a[to_b] == np.arange(len(a)))
        return np.stack([np.flatnonzero(good), to_b[good]], axis=1)

    def match_where(self, a: Features, b: Features, allowed: Allowed) -> tuple[NDArray[np.int64], Array]:
        """See Matcher."""
        pairs, best = np.zeros((0, 2), np.int64), np.zeros(0)
        for start in range(0, 0 if not len(b) or _differ(a, b) else len(a), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            similarity = self.similarity(a.descriptors[rows], b.descriptors)
            similarity[~allowed(rows)] = -1
            nearest = similarity.argmax(axis=1)
            score = similarity[np.arange(len(nearest)), nearest]
            good = score > self.min_similarity
            pairs = np.concatenate([pairs, np.stack([start + np.flatnonzero(good), nearest[good]], axis=1)])
            best = np.concatenate([best, score[good]])
        return pairs, best


def _differ(a: Features, b: Features) -> bool:
    """Returns whether the descriptors are of two kinds, as after a fork with another front end."""
    return a.descriptors.shape[1] != b.descriptors.shape[1]


def near(expected: Array, uv: Array, distance_px: float) -> Allowed:
    """Allows points (M, 2) within a distance of each expected position (N, 2) [px]; none for NaN."""
    return lambda rows: ((expected[rows, None] - uv[None]) ** 2).sum(axis=2) < distance_px**2


def on_lines(lines: Array, x: Array, distance: float) -> Allowed:
    """Allows points (M, 2) within a distance of each line (N, 3), whose first two entries have norm 1."""
    homogeneous = np.column_stack([x, np.ones(len(x))]).T
    return lambda rows: np.abs(lines[rows] @ homogeneous) < distance


def match_near(matcher: Matcher, a: Features, b: Features, expected: Array, distance_px: float) -> NDArray[np.int64]:
    """Returns index pairs (M, 2) of the most similar features near the expected positions (N, 2) [px] of `a` in `b`;
    each feature occurs once."""
    return each_once(*matcher.match_where(a, b, near(expected, b.uv, distance_px)))


def each_once(pairs: NDArray[np.int64], similarity: Array) -> NDArray[np.int64]:
    """Returns, for each second index of pairs (M, 2), the pair with the largest similarity (M,)."""
    order = np.argsort(-similarity, kind="stable")
    _, first = np.unique(pairs[order, 1], return_index=True)
    return pairs[np.sort(order[first])]


class KeypointFeatures(Protocol):
    """The used methods of cv2.Feature2D."""

    def detect(self, image: Image, mask: None, /) -> Sequence[cv2.KeyPoint]: ...

    def compute(self, image: Image, keypoints: Sequence[cv2.KeyPoint], /) -> tuple[Sequence[cv2.KeyPoint], Any]: ...

    def detectAndCompute(self, image: Image, mask: None, /) -> tuple[Sequence[cv2.KeyPoint], Any]: ...


@dataclass(frozen=True)
class OpenCvFeatures:
    """A Detector and a Descriptor that wrap a feature of OpenCV, such as `cv2.ORB.create`, or one with its methods."""

    create: Callable[[int], KeypointFeatures]
    """Creates the OpenCV object for a number of keypoints."""
    length: int
    """Number of entries of a descriptor."""
    keypoint_px: float
    """Diameter [px] assigned to points that it did not detect itself."""
    normalised: Callable[[NDArray], NDArray] | None = None
    """Converts descriptors to unit vectors (N, length); None for bits."""

    def detect(
        self, grey: Image, count: int, occupied: NDArray[np.float32], min_distance_px: float
    ) -> NDArray[np.float32]:
        """See Detector."""
        wanted = count - len(occupied)
        if wanted <= 0 or min(grey.shape) < MIN_SIDE_PX:
            return np.zeros((0, 2), np.float32)
        searched, stretch = _reduced(grey)
        keypoints = self.create(CANDIDATES_PER_POINT * count).detect(searched, None)
        strength = np.array([k.response for k in keypoints])
        uv = _at_size(np.array([k.pt for k in keypoints]).reshape(-1, 2), stretch)
        strongest = uv[np.argsort(-strength, kind="stable")]
        return _spread(strongest, grey.shape, count, np.asarray(occupied, float), min_distance_px)

    def detect_and_describe(self, grey: Image, count: int) -> Features:
        """See Descriptor."""
        if min(grey.shape) < MIN_SIDE_PX:
            return self._features(np.zeros((0, 2), np.float32), None)
        searched, stretch = _reduced(grey)
        keypoints, descriptors = self.create(count).detectAndCompute(searched, None)
        if descriptors is None or not len(keypoints):
            return self._features(np.zeros((0, 2), np.float32), None)
        uv = _at_size(np.array([k.pt for k in keypoints]), stretch)
        _, first = np.unique(uv, axis=0, return_index=True)
        keep = np.sort(first)
        return self._features(uv[keep], descriptors[keep])

    def describe(self, grey: Image, uv: NDArray[np.float32]) -> Features:
        """See Descriptor."""
        if not len(uv) or not grey.size:
            return self._features(uv, None)
        searched, stretch = _reduced(grey)
        padded = np.pad(searched, PADDING_PX, mode="edge")
        inside = np.clip((uv + 0.5) / stretch - 0.5, 0, np.array(searched.shape[::-1]) - 1.0) + PADDING_PX
        keypoints = [cv2.KeyPoint(u, v, self.keypoint_px, 0.0, 1.0, 0, i) for i, (u, v) in enumerate(inside.tolist())]
        found, descriptors = self.create(len(uv)).compute(padded, keypoints)
        every = np.zeros((len(uv), self.length), np.uint8 if descriptors is None else descriptors.dtype)
        if descriptors is not None:
            every[[k.class_id for k in found]] = descriptors
        return self._features(uv, every)

    def _features(self, uv: NDArray[np.float32], descriptors: NDArray | None) -> Features:
        if descriptors is None:
            kind = np.uint8 if self.normalised is None else np.float32
            return Features(uv, np.zeros((len(uv), self.length), kind))
        return Features(uv, descriptors if self.normalised is None else self.normalised(descriptors))


def _reduced(grey: Image) -> tuple[Image, Array]:
    """Returns the image, reduced for detection, and its pixels per reduced pixel (2,)."""
    height, width = grey.shape
    factor = min(1.0, SEARCH_SIDE_PX / max(grey.shape))
    size = (max(round(width * factor), 1), max(round(height * factor), 1))
    searched = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(searched, np.uint8), np.array([width / size[0], height / size[1]])


def _at_size(uv: Array, stretch: Array) -> NDArray[np.float32]:
    return ((uv + 0.5) * stretch - 0.5).astype(np.float32)


def _spread(
    strongest: NDArray[np.float32], shape: tuple[int, ...], count: int, occupied: Array, min_distance_px: float
) -> NDArray[np.float32]:
    """Selects points (M, 2) from points (K, 2), the strongest first, that keep the least distance.

    They fill nearly square cells evenly, up to `count` points including the occupied ones (N, 2).
    """
    height, width = shape
    side = np.sqrt(width * height / max(count / 5, 1))
    cells = np.array([max(1, round(width / side)), max(1, round(height / side))])
    share, filled = int(np.ceil(count / cells.prod())), np.zeros(cells, int)
    cell_of = np.clip(np.concatenate([occupied, strongest]) * cells / (width, height), 0, cells - 1).astype(int)
    chosen, n = np.concatenate([occupied, np.empty((count - len(occupied), 2))]), len(occupied)
    np.add.at(filled, tuple(cell_of[:n].T), 1)
    for point, (column, row) in zip(strongest, cell_of[len(occupied) :], strict=True):
        if n == count:
            break
        if filled[column, row] >= share or (((chosen[:n] - point) ** 2).sum(axis=1) < min_distance_px**2).any():
            continue
        chosen[n] = point
        filled[column, row] += 1
        n += 1
    return chosen[len(occupied) : n].astype(np.float32)


@dataclass(frozen=True)
class DescriptorTracker:
    """A Tracker that matches points by descriptors over the whole image, then aligns the patches around them."""

    detector: Detector
    descriptor: Descriptor
    matcher: Matcher
    guided: bool = False
    """Whether to search near the predictions only."""
    count: int = 1500
    """Number of points of the second image that are compared."""
    refine: Klt = field(default_factory=lambda: Klt(levels=0))

    def track(
        self, start: Image, end: Image, uv: NDArray[np.float32], predicted: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """See Tracker."""
        status, found = np.full(len(uv), TrackStatus.LOST, np.uint8), np.array(uv, np.float32)
        if not len(uv):
            return found, status
        there = self.detector.detect(end, self.count, np.zeros((0, 2), np.float32), 2.0)
        before, now = self.descriptor.describe(start, uv), self.descriptor.describe(end, there)
        if self.guided and predicted is not None:
            pairs = match_near(self.matcher, before, now, predicted, GUIDED_RADIUS * max(end.shape))
        else:
            pairs = self.matcher.match(before, now)
        if not len(pairs):
            return found, status
        mine, matched = pairs[:, 0], there[pairs[:, 1]]
        refined, aligned = self.refine.track(start, end, uv[mine], matched)
        close = (aligned == TrackStatus.ALIVE) & (np.linalg.norm(refined - matched, axis=1) < MAX_REFINEMENT_PX)
        found[mine] = np.where(close[:, None], refined, matched)
        status[mine] = TrackStatus.ALIVE
        return found, status


def descriptor_front_end(name: str, reference: str, features: OpenCvFeatures, matcher: Matcher) -> FrontEnd:
    """Returns the front end that detects, tracks and relocalises by one kind of features."""
    tracker = DescriptorTracker(features, features, matcher)
    return FrontEnd(name, reference, features, tracker, replace(tracker, guided=True), features, matcher)
