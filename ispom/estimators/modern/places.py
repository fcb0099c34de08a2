"""Places that key frames saw, kept to find a lost camera again: reduced images, described once that is needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import SEARCH_SIDE_PX, match_near
from ispom.features.interfaces import Descriptor, Features, Matcher
from ispom.geometry import Array, Pose
from ispom.types import Camera, Image

MAX_PLACES = 48
"""Images of so many are some 30 MB at most; where there are more, older ones are thinned out evenly."""
RECENT = 8
"""So many of the newest are all kept: after a short gap they show most of what is seen again."""
FEATURES = 2000
"""Described in an image."""
MOST_ALIKE = 2
"""So many places that look most like the image are compared with it, after the newest one; at the next exposure, if
that shows nothing either, the next ones: an exposure takes a bounded time, and several compare all places."""
BESIDE = (1, 3, 6)
"""So many key frames away are those with which what one shows is intersected, where there is one camera."""
MIN_SHARE = 0.25
"""Of the points that two images seem to have in common, those that agree with a pose: fewer agree by chance."""
MOST_NEARER = 4.0
"""Ratio of the depths of a point in two images, either way, beyond which descriptors do not match any more: a pose so
far off that all points are one agrees with anything."""
MIN_CONFIRMED = 0.1
"""Of the features that a pose brings into sight, those that are found there: a wrong pose finds 3-6 % of them by
chance, a right one 10-14 % where 20-25 m of road lie between two images of it, and more where less."""
MIN_OVER_CHANCE, CHANCE_TRIALS = 3.0, 2
"""A smaller share confirms a pose if the matches, less the few that any pose is fitted to, exceed those of chance in
the same two images by this factor; chance is measured in this number of trials. In sim:indoor chance matches 4-8 % of
the features, which leaves the decision to the share above; in photos of an object with wide steps 1 %, where right
poses find 7-10 %."""
MIN_BESIDE_DENSEST = 0.25
"""Of such a smaller share, what must lie outside the quarter of the features where most of it lies: one thing that
stands elsewhere as well is no place."""
COARSE_PX = (40, 30)
"""Size of the blurred images by which places are sorted (Klein & Murray 2008, section 4)."""


@dataclass(frozen=True, eq=False)
class Place:
    """What was seen from a key frame."""

    time_ns: int
    camera_from_world: Pose
    images: tuple[Image, ...]
    """Grey, of the camera or of both cameras of a pair; of at most SEARCH_SIDE_PX."""
    reduction: float
    """Their pixels per pixel of the camera's."""
    covariance: Array | None = None
    """(6, 6) of camera_from_world's left twist."""
    motion: Array | None = None
    """(12,) of camera_from_world, as of rolling.mean_rates; of a pair."""
    moving: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
    """Of one camera with a rolling shutter: where tracks were (M, 2) [px], and how fast (M, 2) [px/s]."""
    features: Features | None = None
    """Of the first image, at the camera's pixels, once they were needed."""

    @staticmethod
    def of(
        time_ns: int,
        camera_from_world: Pose,
        images: tuple[Image, ...],
        covariance: Array | None,
        motion: Array | None = None,
        moving: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None,
    ) -> Place:
        """With the images reduced where they are large."""
        height, width = images[0].shape
        reduction = min(1.0, SEARCH_SIDE_PX / max(height, width))
        if reduction < 1:
            size = (round(width * reduction), round(height * reduction))
            # At every key frame, so it must be quick; by less than half, hence without much aliasing.
            images = tuple(np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_LINEAR), np.uint8) for i in images)
        return Place(time_ns, camera_from_world, images, images[0].shape[1] / width, covariance, motion, moving)

    def reduced(self, uv: Array) -> Array:
        """Pixels (N, 2) of the camera as those of the reduced images."""
        return (uv + 0.5) * self.reduction - 0.5

    def described(self, descriptor: Descriptor) -> Place:
        """With its features."""
        if self.features is not None:
            return self
        found = descriptor.detect_and_describe(self.images[0], FEATURES)
        uv = ((found.uv + 0.5) / self.reduction - 0.5).astype(np.float32)
        return replace(self, features=replace(found, uv=uv))


@dataclass(frozen=True, eq=False)
class Places:
    kept: tuple[Place, ...] = ()
    """By time."""

    def with_place(self, place: Place) -> Places:
        """With one more; where that is too many, without the older one that has its neighbours nearest in time."""
        kept = (*self.kept, place)
        if len(kept) > MAX_PLACES:
            times = np.array([p.time_ns for p in kept[: MAX_PLACES - RECENT]])
            gone = 1 + int(np.argmin(times[2:] - times[:-2]))
            kept = (*kept[:gone], *kept[gone + 1 :])
        return Places(kept)

    def revised(self, camera_from_world: Mapping[int, Pose]) -> Places:
        """With newer poses of those at these times."""
        return Places(
            tuple(
                replace(p, camera_from_world=camera_from_world[p.time_ns]) if p.time_ns in camera_from_world else p
                for p in self.kept
            )
        )

    def with_features(self, place: Place) -> Places:
        """With the features of this one, which is one of them; as they are, where it is not."""
        return Places(
            tuple(replace(p, features=place.features) if p.time_ns == place.time_ns else p for p in self.kept)
        )

    def at(self, time_ns: int) -> Place | None:
        return next((p for p in self.kept if p.time_ns == time_ns), None)

    def before(self, time_ns: int) -> tuple[Place, ...]:
        """Some before this time; those after it, where there are none."""
        i = sum(p.time_ns < time_ns for p in self.kept)
        index = [i - k for k in BESIDE if i >= k] or [i + k for k in BESIDE if i + k < len(self.kept)]
        return tuple(self.kept[j] for j in sorted(index))

    def alike(self, grey: Image, turn: int) -> tuple[Place, ...]:
        """The newest place, and those of the others that look most like the image: at each `turn` the next ones."""
        others, image = self.kept[:-1], coarse(grey)
        likeness = np.array([float((coarse(p.images[0]) * image).sum()) for p in others])
        order = np.argsort(-likeness, kind="stable")
        chosen = order[(np.arange(MOST_ALIKE) + MOST_ALIKE * turn) % max(len(order), 1)] if len(order) else order
        return (*self.kept[-1:], *(others[i] for i in dict.fromkeys(chosen.tolist())))


def in_sight(camera: Camera, near: Array, uv: Array) -> Array:
    """Places (N, 2) [px] of points (N, 3) in a camera, NaN for those out of its image."""
    inside = (near[:, 2] > 0) & (uv > 0).all(axis=1) & (uv < (camera.width - 1, camera.height - 1)).all(axis=1)
    return np.where(inside[:, None], uv, np.nan)


def plausible(agreeing: NDArray[np.bool_], depth_before: Array, depth_now: Array) -> NDArray[np.bool_]:
    """Which (N,) of the points that agree with a pose can do so, with their depths (N,) in both images: none where
    they are too small a share."""
    ratio = depth_now / np.maximum(depth_before, 1e-9)
    good = agreeing & (ratio < MOST_NEARER) & (ratio > 1 / MOST_NEARER)
    return good if good.mean() >= MIN_SHARE else np.zeros(len(good), bool)


def confirmed(
    matched: NDArray[np.int64], expected: Array, fewest: int, chance: Callable[[], float] | None = None
) -> bool:
    """Whether enough features are found where a pose expects them.

    `expected` (N, 2) [px] is where the pose puts the features, NaN where it puts them out of the image; `matched` (M,)
    are those found there. A share of them is enough; a smaller one where it is far more than `chance`, the number that
    a wrong pose would match, and is not one thing that may stand elsewhere as well.
    """
    if len(matched) < fewest:
        return False
    if len(matched) >= MIN_CONFIRMED * np.isfinite(expected[:, 0]).sum():
        return True
    if chance is None or _share_beside_densest(matched, expected) < MIN_BESIDE_DENSEST:
        return False
    return len(matched) >= fewest + MIN_OVER_CHANCE * chance()


def matches_by_chance(matcher: Matcher, then: Features, now: Features, expected: Array, distance_px: float) -> float:
    """How many features would be matched if each were expected where another one is: what a wrong pose would match."""
    inside, rng, found = np.flatnonzero(np.isfinite(expected[:, 0])), np.random.default_rng(0), list[int]()
    for _ in range(CHANCE_TRIALS):
        elsewhere = np.full_like(expected, np.nan)
        elsewhere[inside] = expected[rng.permutation(inside)]
        found.append(len(match_near(matcher, then, now, elsewhere, distance_px)))
    return float(np.mean(found))


def _share_beside_densest(matched: NDArray[np.int64], expected: Array) -> float:
    """The share of the matches outside the densest quarter of the image, of 4 x 4 cells of as many features each."""
    inside = np.flatnonzero(np.isfinite(expected[:, 0]))
    column, cell = np.zeros(len(expected), int), np.zeros(len(expected), int)
    column[inside] = _quarters(expected[inside, 0])
    for i in range(4):
        own = inside[column[inside] == i]
        cell[own] = 4 * i + _quarters(expected[own, 1])
    counts = np.sort(np.bincount(cell[matched], minlength=16))
    return float(counts[:12].sum() / max(counts.sum(), 1))


def _quarters(values: Array) -> NDArray[np.int64]:
    """(N,) 0 for the least quarter of the values to 3 for the greatest."""
    return 4 * np.argsort(np.argsort(values, kind="stable"), kind="stable") // max(len(values), 1)


def coarse(grey: Image) -> Array:
    """Blurred, of mean 0 and norm 1: the product of two says how much images look alike."""
    small = cv2.GaussianBlur(cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA).astype(np.float32), (0, 0), 1.0)
    small -= small.mean()
    return small / max(float(np.linalg.norm(small)), 1e-9)
