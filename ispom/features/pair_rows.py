"""On which rows matched features of a pair lie, and whether its two images are of one moment.

In a rectified pair v_right = v_left. An offset, a turn about the optical axis and another focal length each add a
part that is linear in the image; `RowModel` has these parts. What a model of the rig leaves over is noise of a third of
a pixel in images of one moment, and the camera's motion in images of two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ispom.features.descriptors import Features
from ispom.features.images import SEARCH_SIDE_PX
from ispom.features.sift import SIFT, SIFT_MATCHER
from ispom.geometry import Array
from ispom.types import Frame, Image, as_grey

FEATURES = 500
"""Number of features in each image."""
SAMPLES = 300
"""Random samples of three matches; with half of the matches wrong, one in eight is right."""
LEAST = 60
"""Least number of matches for a judgement."""
MOVED_PX, CLEAR = 0.8, 0.5
"""Images are of two moments where the rows of matches scatter by so much (median), and by less than this share of it
with the image before or after it."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Features of a left image that are found in a right one, both (M, 2) [px] from the middle of the image."""

    left: Array
    right: Array
    size: tuple[int, int]
    """(width, height) of the images."""

    def __len__(self) -> int:
        return len(self.left)

    @property
    def offsets(self) -> Array:
        """(M, 2) [px] to the right and downwards, in the right image."""
        return self.right - self.left


@dataclass(frozen=True, eq=False)
class Look:
    """The images of a pair, not longer than SEARCH_SIDE_PX, with their features as far as they are needed."""

    left_image: Image
    right_image: Image
    px: float = 1.0
    """Pixels of the given images per pixel of these."""

    @staticmethod
    def of(frame: Frame) -> Look:
        halvings = 0
        while max(frame.left.shape[:2]) / 2**halvings > SEARCH_SIDE_PX:
            halvings += 1
        left, right = (_halved(as_grey(image), halvings) for image in (frame.left, frame.right))
        return Look(left, right, frame.left.shape[1] / left.shape[1])

    @cached_property
    def left(self) -> Features:
        return features_of(self.left_image)

    @cached_property
    def right(self) -> Features:
        return features_of(self.right_image)

    @property
    def mirrored(self) -> Look:
        """The same, whose right image is mirrored left-right."""
        return Look(self.left_image, np.ascontiguousarray(self.right_image[:, ::-1]), self.px)

    def matches(self, other: Look | None = None) -> Matches:
        """Of the left image, in the right one, or that of another pair."""
        return matched(self.left, (other or self).right, self.left_image.shape[:2])


def _halved(image: Image, halvings: int) -> Image:
    if not halvings:
        return np.ascontiguousarray(image)
    size = max(image.shape[1] >> halvings, 1), max(image.shape[0] >> halvings, 1)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def features_of(image: Image) -> Features:
    """Returns the features of a grey image."""
    return SIFT.detect_and_describe(image, FEATURES)


def matched(left: Features, right: Features, shape: tuple[int, ...]) -> Matches:
    """Returns the features of an image that are found in another one of this shape (height, width)."""
    rows = SIFT_MATCHER.match(left, right)
    middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
    uv_left, uv_right = left.uv[rows[:, 0]] - middle, right.uv[rows[:, 1]] - middle
    return Matches(uv_left.astype(float), uv_right.astype(float), (shape[1], shape[0]))


@dataclass(frozen=True)
class RowModel:
    """v_right - v_left = lower_px + turn_rad * u_right + larger * v_left, from the middle of the image."""

    lower_px: float = 0.0
    turn_rad: float = 0.0
    """Clockwise."""
    larger: float = 0.0
    """-2 of an image that is upside down."""

    @staticmethod
    def of(matches: Matches, within_px: float) -> RowModel:
        """Returns the model that explains most matches within `within_px`, at least three; deterministic."""
        terms, rows = _terms(matches), matches.offsets[:, 1]
        if len(rows) < LEAST:
            return RowModel()
        picks = np.random.default_rng(0).integers(0, len(rows), (SAMPLES, 3))
        parts = terms[picks]
        sound = np.abs(np.linalg.det(parts)) > 1e-6
        found = np.linalg.solve(parts[sound], rows[picks[sound]][..., None])[..., 0]
        found = np.concatenate([[[float(np.median(rows)), 0.0, 0.0]], found])
        best = found[(np.abs(rows - found @ terms.T) <= within_px).sum(axis=1).argmax()]
        for _ in range(2):
            near = np.abs(rows - terms @ best) <= within_px
            best = np.linalg.lstsq(terms[near], rows[near], rcond=None)[0]
        longer = max(matches.size)
        return RowModel(float(best[0]), float(best[1]) / longer, float(best[2]) / longer)

    def residuals(self, matches: Matches) -> Array:
        """Returns what the model leaves over of the rows' offsets (M,) [px]."""
        longer = max(matches.size)
        return matches.offsets[:, 1] - _terms(matches) @ (self.lower_px, self.turn_rad * longer, self.larger * longer)


def _terms(matches: Matches) -> Array:
    """(M, 3)."""
    longer = max(matches.size)
    return np.column_stack([np.ones(len(matches)), matches.right[:, 0] / longer, matches.left[:, 1] / longer])


@dataclass(frozen=True)
class Moment:
    """By how many frames the right image shows a later moment than the left one of its pair, at a place."""

    later: int
    scatter_px: float
    """Median of the rows' residuals in the pairs as they are, in pixels of the images given,"""
    best_px: float
    """and in those of one moment."""


def moments(places: Sequence[tuple[Look, Look]], within_px: float) -> list[Moment | None]:
    """Returns of which moments the images are at each place, with two neighbouring pairs each; None: cannot tell.

    One model of the rig holds at all places: a pair of two moments has the rows of no rig.
    """
    tried: list[dict[int, Matches]] = []
    for first, second in places:
        by_lag = {0: first.matches(), 1: second.matches(first), -1: first.matches(second)}
        tried.append({lag: found for lag, found in by_lag.items() if len(found) >= LEAST})
    models = [RowModel.of(found, within_px) for by_lag in tried for found in by_lag.values()]
    scatters = [
        [{lag: float(np.median(np.abs(model.residuals(each)))) for lag, each in by_lag.items()} for by_lag in tried]
        for model in models
    ]
    if not scatters:
        return [None] * len(places)
    best = min(scatters, key=lambda one: sum(min(by_lag.values(), default=0.0) for by_lag in one))
    return [_moment(by_lag, look.px) for by_lag, (look, _) in zip(best, places, strict=True)]


def _moment(scatter: dict[int, float], px: float) -> Moment | None:
    if 0 not in scatter or len(scatter) == 1:
        return None
    lag = min(scatter, key=scatter.__getitem__)
    if lag != 0 and (scatter[0] < MOVED_PX or scatter[lag] > CLEAR * scatter[0]):
        return None
    others = [value for other, value in scatter.items() if other]
    if lag == 0 and min(others) < scatter[0] / CLEAR:
        return None
    return Moment(lag, px * scatter[0], px * scatter[lag])
