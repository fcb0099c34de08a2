"""The keyframes by which a place is found again: a bounded number of them, ranked by similarity to an image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.features.descriptors import SEARCH_SIDE_PX
from ispom.features.interfaces import Descriptor, Features
from ispom.geometry import Array, Pose
from ispom.types import Image

MAX_KEYFRAMES = 48
"""Their images are 30 MB at most; of more keyframes the older ones are thinned out evenly."""
RECENT = 8
"""Number of the newest ones that are all kept: after a short gap they show most of what is seen again."""
FEATURES = 2000
"""Described in an image."""
CANDIDATES = 2
"""Keyframes of the most similar appearance that are compared with an image, after the newest one. At the next frame the
next ones follow: a frame takes a bounded time, and several frames compare all keyframes."""
NEIGHBOURS = (1, 3, 6)
"""Steps back to the keyframes with which one triangulates its features, where there is one camera."""
COARSE_PX = (40, 30)
"""Size of the blurred images by which keyframes are ranked (Klein & Murray 2008, section 4)."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """What a camera, or a pair, saw from a known pose."""

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
    descriptor: Descriptor | None = None
    """That made the features: after a fork it may be another one."""
    segment: int = 0
    """The segment in whose world its pose is."""

    @staticmethod
    def of(
        time_ns: int,
        camera_from_world: Pose,
        images: tuple[Image, ...],
        covariance: Array | None,
        motion: Array | None = None,
        moving: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None,
        segment: int = 0,
    ) -> Keyframe:
        """With the images reduced where they are large."""
        height, width = images[0].shape
        reduction = min(1.0, SEARCH_SIDE_PX / max(height, width))
        if reduction < 1:
            size = (round(width * reduction), round(height * reduction))
            # At every keyframe, so it must be quick; by less than half, hence without much aliasing.
            images = tuple(np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_LINEAR), np.uint8) for i in images)
        reduction = images[0].shape[1] / width
        return Keyframe(time_ns, camera_from_world, images, reduction, covariance, motion, moving, segment=segment)

    @cached_property
    def appearance(self) -> NDArray[np.float32]:
        """See `appearance_of`; of the first image."""
        return appearance_of(self.images[0])

    def reduced(self, uv: Array) -> Array:
        """Pixels (N, 2) of the camera as those of the reduced images."""
        return (uv + 0.5) * self.reduction - 0.5

    def described(self, descriptor: Descriptor) -> Keyframe:
        """With features of this kind."""
        if self.is_described(descriptor):
            return self
        found = descriptor.detect_and_describe(self.images[0], FEATURES)
        uv = ((found.uv + 0.5) / self.reduction - 0.5).astype(np.float32)
        return replace(self, features=replace(found, uv=uv), descriptor=descriptor)

    def is_described(self, descriptor: Descriptor) -> bool:
        return self.features is not None and self.descriptor == descriptor


@dataclass(frozen=True, eq=False)
class KeyframeDatabase:
    """A value: each change returns another one."""

    keyframes: tuple[Keyframe, ...] = ()
    """By time."""

    def with_keyframe(self, keyframe: Keyframe) -> KeyframeDatabase:
        """With one more; where that is too many, without the older one that has its neighbours nearest in time."""
        kept = (*self.keyframes, keyframe)
        if len(kept) > MAX_KEYFRAMES:
            gone = most_crowded([p.time_ns for p in kept[: MAX_KEYFRAMES - RECENT]])
            kept = (*kept[:gone], *kept[gone + 1 :])
        return KeyframeDatabase(kept)

    def with_poses(self, camera_from_world: Mapping[int, Pose]) -> KeyframeDatabase:
        """With newer poses of those at these times."""
        return KeyframeDatabase(
            tuple(
                replace(p, camera_from_world=camera_from_world[p.time_ns]) if p.time_ns in camera_from_world else p
                for p in self.keyframes
            )
        )

    def with_features(self, keyframe: Keyframe) -> KeyframeDatabase:
        """With the features of this one, which is one of them; as they are, where it is not."""
        found = {"features": keyframe.features, "descriptor": keyframe.descriptor}
        return KeyframeDatabase(
            tuple(replace(k, **found) if k.time_ns == keyframe.time_ns else k for k in self.keyframes)
        )

    def at(self, time_ns: int) -> Keyframe | None:
        return next((p for p in self.keyframes if p.time_ns == time_ns), None)

    def neighbours(self, keyframe: Keyframe) -> tuple[Keyframe, ...]:
        """Returns some of the same segment before a keyframe; those after it, where there are none."""
        same = [k for k in self.keyframes if k.segment == keyframe.segment]
        i = sum(k.time_ns < keyframe.time_ns for k in same)
        index = [i - n for n in NEIGHBOURS if i >= n] or [i + n for n in NEIGHBOURS if i + n < len(same)]
        return tuple(same[j] for j in sorted(index))

    def query(self, grey: Image, turn: int) -> tuple[Keyframe, ...]:
        """Returns the newest keyframe, and of the others CANDIDATES that look most like an image: at each
        `turn`, counted from 0, the next ones."""
        others = self.keyframes[:-1]
        order = ranked(appearance_of(grey), [p.appearance for p in others])
        chosen = [order[(i + CANDIDATES * turn) % len(order)] for i in range(CANDIDATES)] if order else []
        return (*self.keyframes[-1:], *(others[i] for i in dict.fromkeys(chosen)))


def ranked(appearance: Array, others: Sequence[Array]) -> list[int]:
    """Returns the indices of appearances, the most similar first."""
    similarity = np.array([float((other * appearance).sum()) for other in others])
    return np.argsort(-similarity, kind="stable").tolist()


def most_crowded(positions: Sequence[float]) -> int:
    """Returns the index of the one, neither the first nor the last, whose neighbours are nearest to each other: what is
    given up where there are too many."""
    along = np.asarray(positions)
    return 1 + int(np.argmin(along[2:] - along[:-2]))


def appearance_of(grey: Image) -> NDArray[np.float32]:
    """Returns the image blurred, of mean 0 and norm 1: the product of two says how similar images look."""
    small = cv2.GaussianBlur(cv2.resize(grey, COARSE_PX, interpolation=cv2.INTER_AREA).astype(np.float32), (0, 0), 1.0)
    small -= small.mean()
    return small / max(float(np.linalg.norm(small)), 1e-9)
