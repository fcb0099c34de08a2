"""Row differences of matched features in a pair, and whether its two images are of the same time.

In a rectified pair v_right = v_left. An offset, a rotation about the optical axis and another focal length each add a
term that is linear in the image coordinates, see `RowModel`. The residuals of a model of the rig are noise of a third
of a pixel in images of the same time, and the camera's motion in images of different times.
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

MAX_FEATURES = 500
"""Number of features in each image."""
RANSAC_SAMPLES = 300
"""Number of random samples of three matches; with half of the matches wrong, one in eight is right."""
MIN_MATCHES = 60
"""Least number of matches for a judgement."""
LEVEL_PX, LEVEL_SHARE = 2.0, 0.6
"""Largest residual of a match's row offset [px], and the least share of matches within it; with fewer the images do not
show the same scene."""
FLIP_TOLERANCE = 0.2
"""Largest difference of `larger` from -2 in images that are upside down, and from 0 in others."""
LEVELLED_PX, LEVELLED_DEG = 10.0, 2.0
"""Largest row offset in the centre of the image, and largest rotation about each axis, that `stereo` and what builds on
it correct by themselves: the largest prior standard deviations that their settings allow. Beyond them the linear model
is off by a third of a pixel, and a pair that was moved so far has no known baseline either."""
MIN_SCATTER_PX, MAX_SCATTER_RATIO = 0.8, 0.5
"""Least median scatter of the rows of matches in images of different times, and its largest ratio with the image before
or after, which has the same time."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched features of a left and a right image, both (M, 2) [px] from the middle of the image."""

    left: Array
    right: Array
    size: tuple[int, int]
    """(width, height) of the images."""

    def __len__(self) -> int:
        return len(self.left)

    @property
    def offsets(self) -> Array:
        """Offsets (M, 2) [px] to the right and down, in the right image."""
        return self.right - self.left


@dataclass(frozen=True, eq=False)
class Look:
    """The images of a pair, reduced to SEARCH_SIDE_PX, with features that are computed on demand."""

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
        """The same with the right image mirrored left-right."""
        return Look(self.left_image, np.ascontiguousarray(self.right_image[:, ::-1]), self.px)

    def matches(self, other: Look | None = None) -> Matches:
        """Returns the matches of the left image with the right one, or with that of another pair."""
        return matched(self.left, (other or self).right, self.left_image.shape[:2])


def _halved(image: Image, halvings: int) -> Image:
    if not halvings:
        return np.ascontiguousarray(image)
    size = max(image.shape[1] >> halvings, 1), max(image.shape[0] >> halvings, 1)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def features_of(image: Image) -> Features:
    """Returns the features of a grey image."""
    return SIFT.detect_and_describe(image, MAX_FEATURES)


def matched(left: Features, right: Features, shape: tuple[int, ...]) -> Matches:
    """Returns the matches of the features of two images of this shape (height, width)."""
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
    """Relative difference of the focal lengths; -2 for a right image that is upside down."""

    @staticmethod
    def of(matches: Matches, within_px: float) -> RowModel:
        """Returns the model with most matches within `within_px`, at least three. Deterministic."""
        terms, rows = _terms(matches), matches.offsets[:, 1]
        if len(rows) < MIN_MATCHES:
            return RowModel()
        picks = np.random.default_rng(0).integers(0, len(rows), (RANSAC_SAMPLES, 3))
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
        """Returns the residuals (M,) of the row offsets [px]."""
        longer = max(matches.size)
        return matches.offsets[:, 1] - _terms(matches) @ (self.lower_px, self.turn_rad * longer, self.larger * longer)


def _terms(matches: Matches) -> Array:
    """Returns (M, 3)."""
    longer = max(matches.size)
    return np.column_stack([np.ones(len(matches)), matches.right[:, 0] / longer, matches.left[:, 1] / longer])


@dataclass(frozen=True)
class Moment:
    """The time difference between the images of a pair."""

    later: int
    """Number of frames by which the right image is later than the left one."""
    scatter_px: float
    """Median row residual of the given pairs, in pixels of the given images."""
    best_px: float
    """Median row residual of pairs of the same time."""


def moments(places: Sequence[tuple[Look, Look]], within_px: float) -> list[Moment | None]:
    """Returns the time difference at each place, which has two neighbouring pairs; None where it is not determined.

    One model of the rig is valid at all places; the rows of pairs of different times fit no rig.
    """
    tried: list[dict[int, Matches]] = []
    for first, second in places:
        by_lag = {0: first.matches(), 1: second.matches(first), -1: first.matches(second)}
        tried.append({lag: found for lag, found in by_lag.items() if len(found) >= MIN_MATCHES})
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
    if lag != 0 and (scatter[0] < MIN_SCATTER_PX or scatter[lag] > MAX_SCATTER_RATIO * scatter[0]):
        return None
    others = [value for other, value in scatter.items() if other]
    if lag == 0 and min(others) < scatter[0] / MAX_SCATTER_RATIO:
        return None
    return Moment(lag, px * scatter[0], px * scatter[lag])
